"""Torques of position servos follow from commands and positions, and propose sets of effects."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_leg import JOINTS, LEG, RATE, RUBS, recorded

from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.search import proposed_sets
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.session import session
from tiago_mj.gap.torque import from_commands
from tiago_mj.io.deadline import Deadline
from tiago_mj.recordings.recording import Trial


@pytest.fixture(scope="module")
def leg(tmp_path_factory) -> tuple[list[Trial], object]:
    folder = tmp_path_factory.mktemp("leg")
    return recorded(folder), folder / "leg.xml"


def test_a_servo_s_torque_is_that_of_mujoco(leg):
    """Of exact positions and velocities, at its limit as well: the mean of before and after the command changes."""
    trials, file = leg
    model = mujoco.MjModel.from_xml_string(LEG)
    data, rows = mujoco.MjData(model), []
    for at in np.arange(0, 1, 1 / RATE):
        forces = []
        for command in (3.0 * np.sin(7.0 * (at - 1 / RATE)) if rows else 0.0, 3.0 * np.sin(7.0 * at)):
            data.ctrl[:] = command
            mujoco.mj_forward(model, data)
            forces.append(data.qfrc_actuator.copy())
        rows.append((at, data.ctrl.copy(), data.qpos.copy(), data.qvel.copy(), np.mean(forces, axis=0)))
        for _ in range(round(1 / RATE / model.opt.timestep)):
            mujoco.mj_step(model, data)
    time, commands, positions, velocities, forces = (np.array(one) for one in zip(*rows, strict=True))
    of = [dict(zip(JOINTS, one.T, strict=True)) for one in (commands, positions, velocities)]
    exact = replace(trials[0], time=time, commands=of[0], positions=of[1], velocities=of[2])
    found = from_commands.with_efforts(plant_of(trials, model=file), exact)
    assert found is not None
    assert np.abs(forces).max() == 20.0
    for joint, force in zip(JOINTS, forces.T, strict=True):
        np.testing.assert_allclose(found.efforts[joint], force, atol=1e-9)


def test_no_torque_follows_without_every_command(leg):
    trials, file = leg
    fewer = replace(trials[0], commands={name: trials[0].commands[name] for name in JOINTS[:2]})
    assert from_commands.with_efforts(plant_of(trials, model=file), fewer) is None


@pytest.mark.parametrize("without", [[-1], [6, 7]], ids=["last row", "between"])
def test_a_command_holds_until_the_next(leg, without):
    """As in a recording of this package, whose last row has none."""
    trials, file = leg
    plant, trial = plant_of(trials, model=file), trials[0]
    fewer = {name: values.copy() for name, values in trial.commands.items()}
    held = {name: values.copy() for name, values in trial.commands.items()}
    for name in JOINTS:
        fewer[name][without], held[name][without] = np.nan, held[name][without[0] - 1]
    found, wanted = (from_commands.with_efforts(plant, replace(trial, commands=one)) for one in (fewer, held))
    assert found is not None
    assert wanted is not None
    for name in JOINTS:
        np.testing.assert_array_equal(found.efforts[name], wanted.efforts[name])


def test_no_torque_follows_before_the_first_command(leg):
    trials, file = leg
    plant, rows = plant_of(trials, model=file), len(trials[0].time)
    late = {name: np.where(np.arange(rows) < 3, np.nan, values) for name, values in trials[0].commands.items()}
    found = from_commands.with_efforts(plant, replace(trials[0], commands=late))
    assert found is not None
    assert np.flatnonzero(np.isnan(found.efforts[JOINTS[0]])).tolist() == [0, 1, 2]
    none = {name: np.full(rows, np.nan) for name in JOINTS}
    assert from_commands.with_efforts(plant, replace(trials[0], commands=none)) is None


def test_friction_that_differs_from_joint_to_joint_is_proposed(leg):
    trials, file = leg
    found = from_commands.sets(session(trials, env=None, model=file, given=()), None, 0, Deadline())
    best = max(found, key=lambda fit: fit.evidence)
    of = {part.target[0]: float(v) for part, v in zip(best.parts, best.values, strict=True) if "coulomb" in part.effect}
    assert [of[name] for name in JOINTS] == pytest.approx(RUBS, rel=0.25)


def test_what_the_pool_lacks_is_not_proposed(leg):
    trials, file = leg
    found = from_commands.sets(session(trials, env=None, model=file, given=()), None, 0, Deadline())
    assert proposed_sets._start(found[0], {}, None) is None


@pytest.mark.slow
def test_friction_on_every_joint_of_a_leg_is_named(leg):
    """One friction for all joints, or friction by load, explains more than any single joint's."""
    trials, file = leg
    found = diagnose(trials, model=file, seed=0, threads=1)
    assert found.kind == "effect"
    named = {(one.name, one.target): one.parameters["force"].value for one in found.best.effects}
    assert [named["coulomb_friction", name] for name in JOINTS] == pytest.approx(RUBS, rel=0.15)
