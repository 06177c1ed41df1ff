"""Rollouts with effects, for tests: in an environment, and of many simulations at once by the same chain."""

from __future__ import annotations

from dataclasses import dataclass

import gymnasium
import mujoco.batch
import numpy as np

import tiago_mj  # noqa: F401
from tiago_mj.effects import read_effects
from tiago_mj.effects.host import BatchHost
from tiago_mj.effects.runner import Runner
from tiago_mj.sensing.load_cell import LoadCell

RIGHT, LEFT = 0, 1
GRIPPER, TIAGO = "GripperTactile-v0", "TIAGoTactile-v0"
QUIET = LoadCell(noise=0.0)


@dataclass(frozen=True)
class Record:
    """A rollout: row 0 is the reset, row k the observation after k control steps.

    Attributes:
        time: [s] by the clock of whoever commands.
        position, velocity: measured (steps + 1, N).
        true_position, true_velocity: of the joints, (steps + 1, N).
        effort: actuator force (steps + 1, N) [N, N·m], as of the last physics step.
        set_point: of the servos (steps + 1, N).
        force: contact truth (steps + 1, 2) [N].
        reading: of the load cells (steps + 1, 2) [sensor units].
        state: everything that is simulated, (steps + 1, n).
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    true_position: np.ndarray
    true_velocity: np.ndarray
    effort: np.ndarray
    set_point: np.ndarray
    force: np.ndarray
    reading: np.ndarray
    state: np.ndarray


def make(effects=None, env=GRIPPER, **arguments):
    """The goal environment behind an id."""
    made = gymnasium.make(f"tiago_mj/{env}", effects=effects, disable_env_checker=True, **arguments).unwrapped
    return getattr(made, "core", made)


def rollout(effects, actions, env=GRIPPER, *, seed=0, prepare=None, **arguments) -> Record:
    """Apply actions (steps, N) after a reset; ``prepare(core)`` may change the simulation before."""
    core = make(effects, env, **arguments)
    core.reset(seed=seed)
    if prepare is not None:
        prepare(core)
    rows = [_row(core)]
    for action in np.atleast_2d(actions):
        core.step(action)
        rows.append(_row(core))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Record(np.arange(len(rows)) * core.dt, *columns)


def _row(core):
    data, state = core.data, core.state
    return (
        state.position,
        state.velocity,
        data.qpos[core.qpos_address].copy(),
        data.qvel[core._qvel_address].copy(),
        data.actuator_force[core._ctrl].copy(),
        data.act[core._ctrl].copy(),
        state.force_contact,
        state.force_raw,
        np.concatenate([data.qpos, data.qvel, data.act]),
    )


def batch_rollout(sims, actions, env=GRIPPER, *, uniform, **arguments):
    """The same of many simulations at once, each with its own effects, noise-free.

    Returns:
        States (steps + 1, nsim, n), measured positions and velocities (steps + 1, nsim, N), readings.
    """
    core = make(None, env, sensing=QUIET, **arguments)
    core.reset(seed=0)
    batch = mujoco.batch.Batch(core.model, len(sims))
    host = BatchHost(batch)
    host.state("qpos")[:] = core.data.qpos
    host.state("act")[:] = core.data.act
    wiring = core.wiring()
    runner = Runner(host, wiring, [read_effects(sim) for sim in sims], uniform)
    chain = runner.chain
    runner.start(core.dt, core.n_substeps, core.contact())
    host.forward()
    rows = []

    def read():
        newtons = core.sensors.pads.truth(host.output("sensordata"))
        reading = chain.reading(newtons, core.load_cell.signal, np.zeros_like(newtons))
        qpos, qvel = host.state("qpos"), host.state("qvel")
        state = np.concatenate([qpos, qvel, host.state("act")], axis=1)
        rows.append(
            (state, chain.position(qpos[:, wiring.qpos]), chain.velocity(qvel[:, wiring.dof]), np.array(reading))
        )

    read()
    for action in actions:
        command = core.drive.command(np.clip(action, -1.0, 1.0), core.data.act)  # as step() does
        runner.advance(np.broadcast_to(command, (len(sims), len(command))).copy())
        read()
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def gripper_actions(seconds=1.0, hz=240, speed=0.8):
    """Wait, close on the object, hold, open again: both fingers alike, velocities over the limit."""
    t = np.arange(round(seconds * hz)) / hz
    wave = np.where(t < 0.05, 0.0, np.where(t < 0.55, -speed, np.where(t < 0.7, 0.0, speed)))
    return np.repeat(wave[:, None], 2, axis=1)


def gripper_positions(seconds=1.0, hz=240):
    """The same as targets over the range: a smooth way in, and half out, with a small ripple on it."""
    t = np.arange(round(seconds * hz)) / hz
    wave = 0.2 + 0.8 * np.cos(2 * np.pi * t / seconds) + 0.02 * np.sin(2 * np.pi * 7 * t)
    return np.repeat(wave[:, None], 2, axis=1)


def tiago_actions(seconds=1.0, hz=240):
    """The same on TIAGo, with every joint of the arm in a slow sine, each at its own frequency."""
    t = np.arange(round(seconds * hz)) / hz
    arm = 0.08 * np.sin(2 * np.pi * t[:, None] * (0.9 + 0.15 * np.arange(8)))
    return np.hstack([arm, np.where(t < 0.8, -0.8, 0.8)[:, None] * np.ones(2)])


# Physical consequences ------------------------------------------------------------------------------------------------

#: Of the gripper's servos and joints, as their models say: what consequences are computed from.
KP, DAMPING, FORCE_LIMIT, FINGER_MASS, SPEED_LIMIT = 2000.0, 80.0, 16.0, 0.091, 0.08  # N/m, N·s/m, N, kg, m/s
CONTACT_STIFFNESS, CONTACT_DAMPING, OBJECT_MASS = 10_000.0, 100.0, 0.421  # N/m, N·s/m, kg
UNITS_PER_NEWTON = QUIET.scale / QUIET.contact_unit
PERIOD = 1 / 240
#: Fingers without an object, and with one exactly in the middle.
FREE, MIDDLE = "GripperClose-v0", {"object_offset": 0.0, "sensing": QUIET}

#: Effect: the tests that show its consequence in a rollout.
SHOWN: dict[str, list[str]] = {}


def shows(*effects):
    """Mark a test that measures the physical consequence of effects."""

    def mark(test):
        for name in effects:
            SHOWN.setdefault(name, []).append(test.__name__)
        return test

    return mark


def speeds(*parts, hz=240):
    """Actions of both fingers from (velocity [m/s], seconds) in a row; a pair of velocities is right, left."""
    rows = [np.tile(np.broadcast_to(v, 2), (round(seconds * hz), 1)) for v, seconds in parts]
    return np.concatenate(rows) / SPEED_LIMIT


def free(effects, *parts, **arguments):
    """Move the fingers without an object."""
    return rollout(effects, speeds(*parts, hz=arguments.get("control_hz", 240)), FREE, **arguments)


def grasp(effects, *parts, **arguments):
    """Move the fingers with an object in the middle between them, read without noise."""
    return rollout(effects, speeds(*parts), **{**MIDDLE, **arguments})


def crossing(time, signal, level):
    """When a signal first passes a level, interpolated between rows."""
    above = signal >= level
    k = int(np.argmax(above != above[0]))
    assert above[k] != above[0], "the signal never gets there"
    share = (level - signal[k - 1]) / (signal[k] - signal[k - 1])
    return time[k - 1] + share * (time[k] - time[k - 1])


def entry(name, target, **parameters):
    """One effect on some targets."""
    return [{"name": name, "target": target, "parameters": parameters}]


def same_motion(one, other):
    """Whether two rollouts moved alike, to the last bit."""
    return np.array_equal(one.state, other.state)
