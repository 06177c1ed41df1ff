"""A payload has a place, which recordings tell where the motion shows it."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from test_repaired import robot

from tiago_mj.effects import EFFECTS, read_effects
from tiago_mj.effects.model_file import changed
from tiago_mj.effects.spec import arrays
from tiago_mj.gap.analysis import outcome, place
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import candidates, terms
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.report.repaired import entry
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.recordings.recording import Trial

NOISE = 2e-4


def measured(plant: Plant, trial: Trial, truth: dict[str, float]) -> tuple[Plant, list[Trial]]:
    """Two recordings of the arm with a payload, with an encoder's noise."""
    trials, rng = [], np.random.default_rng(3)
    for name, size in (("one", 1.0), ("two", -0.7)):
        commands = {key: size * sent for key, sent in trial.commands.items()}
        trials.append(replace(trial, name=name, commands=commands))
    plant = replace(plant, starts={one.name: plant.starts["one"] for one in trials})
    payload = read_effects({"payload": truth})
    true = replay.simulate(
        plant, replay.grid(plant, trials), [(k, payload) for k in range(2)], replay.Run(threads=1)
    ).position
    for k, one in enumerate(trials):
        seen = true[k] + rng.normal(0, NOISE, true[k].shape)
        trials[k] = replace(one, positions={joint: seen[:, j] for j, joint in enumerate(plant.joints)})
    return plant, trials


def after(plant: Plant, trials: list[Trial], mass: float, fixed: tuple[tuple[str, float], ...] = ()) -> Fitted:
    """The best explanation with its place, where one was found."""
    predict, _ = predictor(plant, trials, threads=1)
    part = replace(next(c for c in candidates(plant, ["payload"])), fixed=fixed)
    fit = Fitted((part,), np.array([mass]), np.array([0.02]), np.zeros(len(terms(plant))), 0.0, 9.0)
    data = noise_model.select_trials(predict.data, [0, 1])
    weight = np.full(len(data.channels), 0.5)
    ranked = Ranked((fit,), (), 0, 1, True, weight, predict)
    return place.refined(plant, ranked, data, Subset((0, 1))).fits[0]


def test_a_payload_beside_the_centre_is_placed_in_the_plane_of_the_motion(tmp_path):
    plant, trial, _ = robot(tmp_path)
    plant, trials = measured(plant, trial, {"mass": 0.4, "x": 0.11, "z": -0.05})
    fit = after(plant, trials, 0.5)
    told = outcome.named(plant, fit, 0).parameters
    assert set(told) == {"mass", "x", "z"}, "the joints turn about y, along which no place shows"
    for key, truth, near in (("mass", 0.4, 0.05), ("x", 0.11, 0.02), ("z", -0.05, 0.01)):
        assert told[key].low <= truth <= told[key].high, key
        assert told[key].value == pytest.approx(truth, abs=near)
    assert read_effects([{"name": "payload", "parameters": dict(entry(outcome.named(plant, fit, 0)).parameters)}])


def test_a_payload_at_the_centre_is_given_no_other_place(tmp_path):
    plant, trial, _ = robot(tmp_path)
    plant, trials = measured(plant, trial, {"mass": 0.4})
    fit = after(plant, trials, 0.4)
    assert set(outcome.named(plant, fit, 0).parameters) == {"mass"}
    assert fit.values[0] == 0.4


def test_a_placed_mass_is_what_a_body_of_that_mass_there_would_be(tmp_path):
    """The same model with a small ball welded to its tool."""
    plant, _, _ = robot(tmp_path)
    spec = mujoco.MjSpec.from_file(str(plant.file))
    place = plant.model.body("fore").ipos + np.array([0.1, 0.03, -0.02])
    ball = spec.body("fore").add_body(pos=place)
    ball.explicitinertial, ball.mass, ball.inertia, ball.ipos = True, 0.3, np.full(3, 1e-12), np.zeros(3)
    seen = [
        _dynamics(model) for model in (spec.compile(), _with(plant, {"mass": 0.3, "x": 0.1, "y": 0.03, "z": -0.02}))
    ]
    np.testing.assert_allclose(seen[1], seen[0], rtol=1e-6)
    assert np.abs(seen[0] - _dynamics(_with(plant, {"mass": 0.3}))).max() > 0.1


def _dynamics(model: mujoco.MjModel) -> np.ndarray:
    """What moves the joints in some state: gravity and motion, and the mass matrix."""
    data, inertia = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:], data.qvel[:] = [0.3, -0.8], [1.0, 2.0]
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    return np.concatenate([data.qfrc_bias, inertia.ravel()])


def _with(plant: Plant, payload: dict[str, float]) -> mujoco.MjModel:
    return changed(plant.model, plant.wiring, read_effects({"payload": payload}), plant.period, 5).now.host.model


def test_two_payloads_hang_at_their_common_centre(tmp_path):
    plant, _, _ = robot(tmp_path)
    entries = read_effects({"payload": {"mass": 0.3, "x": 0.1}})
    both = (*entries, *read_effects({"payload": {"mass": 0.1, "x": -0.1}}))
    effect = arrays(EFFECTS["payload"], [both], plant.wiring.targets)
    assert (effect.mass[0, -1], effect.x[0, -1]) == pytest.approx((0.4, 0.05))
