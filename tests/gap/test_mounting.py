"""A payload's place is proposed before effects are screened."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_place import after, measured
from test_repaired import robot

from tiago_mj.effects import read_effects
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import Fitter, Start
from tiago_mj.gap.inference.hypotheses import Candidate, candidates, terms
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.search import mounting, second_parameter
from tiago_mj.gap.simulation import replay, sizes
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.recordings.recording import Sidecar, Trial

AXIS = """<mujoco><worldbody><body name="carriage"><joint name="axis" type="slide" axis="1 0 0"/>
<geom size="0.1" mass="3"/></body></worldbody><actuator><motor name="axis" joint="axis"/></actuator></mujoco>"""
TRUTH = {"mass": 0.5, "x": 0.2, "z": -0.1}


def searched(tmp_path, truth: dict[str, float]) -> tuple[Fitter, tuple[Candidate, ...]]:
    """A fitter to recordings of an arm with a load, and the payload of the library."""
    plant, trial, _ = robot(tmp_path)
    plant, trials = measured(plant, trial, truth)
    predict, nominal = predictor(plant, trials, threads=1)
    data = noise_model.select_trials(predict.data, [0, 1])
    own = tuple(t for t in terms(plant) if not t.per_trial)
    flat = np.zeros((len(own), *data.value.shape))
    fitter = Fitter(predict, Subset((0, 1)), data, np.full(len(data.channels), 0.5), own, flat)
    pool = candidates(plant, ["payload"], None, sizes.sizes(plant, trials, nominal))
    return fitter.linearized_at(Point((), np.zeros(0), np.zeros(fitter.size))), pool


def proposed(fitter: Fitter, pool: tuple[Candidate, ...]) -> tuple[Candidate, ...]:
    return mounting.proposed(fitter, Point((), np.zeros(0), np.zeros(fitter.size)), pool)


def test_a_load_beside_the_link_is_proposed_where_it_hangs(tmp_path):
    fitter, pool = searched(tmp_path, TRUTH)
    (found,) = proposed(fitter, pool)
    place = dict(found.fixed)
    assert place["x"] == pytest.approx(TRUTH["x"], abs=0.03)
    assert place["z"] == pytest.approx(TRUTH["z"], abs=0.03)
    beside, centre = fitter.fit_all([Start((c,), np.array([0.3])) for c in (found, *pool)])
    assert beside.evidence > centre.evidence + 100
    assert beside.values[0] == pytest.approx(TRUTH["mass"], abs=0.05)


@pytest.mark.parametrize("truth", [{"mass": 0.5}, {"mass": 0.0}])
def test_no_place_is_proposed_where_there_is_none(tmp_path, truth):
    assert proposed(*searched(tmp_path, truth)) == ()


def test_the_place_of_a_robot_of_the_package_is_known(tmp_path):
    fitter, pool = searched(tmp_path, TRUTH)
    predict = replace(fitter.predict, plant=replace(fitter.predict.plant, environment="TiagoArmReach-v0"))
    assert proposed(replace(fitter, predict=predict), pool) == ()


def test_coordinates_of_a_place_are_no_second_parameters(tmp_path):
    _, (part,) = searched(tmp_path, TRUTH)
    assert second_parameter._second_parameters(replace(part, fixed=(("x", 0.1), ("y", 0.0), ("z", -0.2)))) == []


def test_what_a_proposed_place_explained_counts_once(tmp_path):
    """The evidence of the fit has it already: fitted once more, only the price of the place changes."""
    plant, trial, _ = robot(tmp_path)
    plant, trials = measured(plant, trial, TRUTH)
    near = after(plant, trials, 0.5, fixed=(("x", 0.2), ("y", 0.0), ("z", -0.1)))
    told = dict(near.parts[0].fixed)
    assert told == pytest.approx({"x": 0.2, "z": -0.1}, abs=2e-3), "along y no place shows"
    assert abs(near.evidence) < 10
    assert after(plant, trials, 0.5).evidence > 1000


def test_a_load_is_placed_on_a_body_that_mujoco_takes_for_a_simple_one(tmp_path):
    """One whose centre of mass is where its joint is: MuJoCo refuses to move it unless it was told before."""
    (tmp_path / "axis.xml").write_text(AXIS)
    rows = 200
    time = np.arange(rows) / 100
    effort = {"axis": 8 * np.sin(3 * time)}
    moved = {"axis": 0.2 * np.sin(3 * time)}
    sidecar = Sidecar("tiago_mj.recording/1", "one", robot=str(tmp_path / "axis.xml"), rate_hz=100.0)
    trial = Trial("one", time, effort, moved, {}, {}, {}, replace(sidecar, interface="effort"), "one.csv")
    plant = plant_of([trial])
    load = read_effects({"payload": {"mass": 0.3, "x": 0.1}})
    (run,) = replay.simulate(plant, replay.grid(plant, [trial]), [(0, load)], replay.Run(threads=1)).position
    assert np.isfinite(run).all()
