"""A magnitude that ends at a bound which is an estimate is fitted with a wider one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_mounting import searched

from tiago_mj.gap.inference.fit import Fitted, Start
from tiago_mj.gap.inference.hypotheses import candidates
from tiago_mj.gap.search import wider


def test_a_magnitude_at_an_estimated_bound_is_fitted_with_a_wider_one(tmp_path):
    fitter, (part,) = searched(tmp_path, {"mass": 0.5})
    narrow = replace(part, high=0.2)
    (held,) = fitter.fit_all([Start((narrow,), np.array([0.1]))])
    assert held.values[0] == 0.2, "the fit would not go to its bound, so that this test shows nothing"
    (free,) = wider.fitted(fitter, [held])
    assert free.values[0] == pytest.approx(0.5, abs=0.02)
    assert free.parts[0].high == pytest.approx(0.8)
    assert not free.parts[0].at_edge(float(free.values[0]))
    assert wider.fitted(fitter, [free]) == [free]


def test_along_a_motion_bounds_of_the_project_s_own_robots_are_estimates_too(tmp_path, monkeypatch):
    """An arm of TIAGo's with 116 N·m·s/rad of viscous friction, of which 60 were the bound, was told to have 60 beside
    an encoder's scale of 0.72."""
    fitter, (part,) = searched(tmp_path, {"mass": 0.5})
    own = replace(fitter.predict, plant=replace(fitter.predict.plant, environment={"id": "a robot of the project"}))
    fitter = replace(fitter, predict=own)
    (held,) = fitter.fit_all([Start((replace(part, high=0.2),), np.array([0.1]))])
    assert wider.fitted(fitter, [held]) == [held], "where commands are replayed the library's bounds were chosen for it"
    monkeypatch.setattr(type(own), "replays", False)
    (free,) = wider.fitted(fitter, [held])
    assert free.values[0] > 0.4


def test_a_bound_of_the_library_stays(tmp_path):
    """What a factor is at most is no estimate of a robot's size."""
    fitter, _ = searched(tmp_path, {"mass": 0.5})
    part = next(c for c in candidates(fitter.predict.plant, ["torque_constant"]) if c.target is None)
    at_bound = Fitted((part,), np.array([part.high]), np.zeros(1), np.zeros(fitter.size), 0.0, 9.0)
    assert wider.fitted(fitter, [at_bound]) == [at_bound]
