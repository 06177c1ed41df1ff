"""An effect on every joint, with a magnitude of its own on each."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_leg import JOINTS, RUBS, recorded

from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Fitter, Point, Start
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.search import on_each, ranking
from tiago_mj.gap.search.state import State
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.subset import Subset


@pytest.fixture(scope="module")
def leg(tmp_path_factory):
    """A search whose best explanation is one friction on every joint, of a leg with another one on each."""
    folder = tmp_path_factory.mktemp("leg")
    trials = recorded(folder)
    predict, _ = predictor(plant_of(trials, model=folder / "leg.xml"), trials, threads=1)
    pool = hypotheses.candidates(predict.plant, ["coulomb_friction"])
    none = np.zeros((0, *predict.data.value.shape))
    full = Fitter(predict, Subset((0, 1)), predict.data, np.ones(len(predict.data.channels)), (), none)
    every = next(one for one in pool if one.target is None)
    fits = full.fit_all([Start((), np.zeros(0)), Start((every,), np.array([0.4]))])
    return State(full, full, tuple(fits), np.zeros(0), Point((), np.zeros(0), np.zeros(0)), pool=tuple(pool))


def test_one_friction_for_all_joints_gives_way_to_one_on_each_where_it_leaves_a_gap(leg):
    assert ranking.leaves_a_gap(leg.best, replays=True)
    spent = replace(leg, full=replace(leg.full, out_of_time=lambda: True))  # its budget
    best = on_each.target(spent, lambda: False).best
    found = {part.target[0]: value for part, value in zip(best.parts, best.values, strict=True)}
    assert [found[name] for name in JOINTS] == pytest.approx(RUBS, rel=0.1)
    assert best.evidence > leg.best.evidence + 100
    assert ranking.size(best) == 1  # what all joints have is one effect


def test_one_friction_that_leaves_no_gap_is_kept(leg, monkeypatch):
    monkeypatch.setattr(ranking, "REMAINING_DISCREPANCY", np.inf)
    assert on_each.target(leg, lambda: False) is leg


def test_nothing_is_fitted_once_the_time_is_over(leg):
    assert on_each.target(leg, lambda: True) is leg


def test_an_effect_on_all_and_on_some_once_more_is_told_on_each():
    """Seven joints with a friction of their own, and one for all beside six more of them, are one model."""

    def fit(evidence, *targets, effect="coulomb_friction"):
        return SimpleNamespace(parts=[SimpleNamespace(effect=effect, target=t) for t in targets], evidence=evidence)

    joints = [(f"joint_{k}",) for k in range(7)]
    each, twice = fit(100.0, *joints), fit(102.0, None, *joints[1:])
    other = fit(103.0, None, ("joint_1",), effect="viscous_friction")
    assert ranking.each_once([other, twice, each]) == [other, each]
    assert ranking.each_once([twice, fit(90.0, *joints)])[0] is twice  # far likelier: something shows in it
    assert ranking.each_once([fit(102.0, None, *joints[:3]), each])[0].parts[0].target is None  # fewer numbers
