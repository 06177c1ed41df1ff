"""How far an exported model does what the simulator with the effects does: both replay one motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import Entry
from tiago_mj.export.found import Robot
from tiago_mj.gap.stepper import Stepper
from tiago_mj.recordings.motions.play import random_motion

Array = NDArray[np.float64]

#: Length of the motion [s].
SECONDS: Final = 6.0
#: It keeps to this share of what the limits allow.
SHARE: Final = 0.5
#: Largest command of an actuator without limits, on a slide and on a hinge [m, rad, their speeds, N, N·m].
REACH: Final = (0.05, 0.5)
#: A root of mean squares below this is none [m, rad].
NOTHING: Final = 1e-9
#: Names of second joints begin with their joint's (:mod:`tiago_mj.export.play`).
SECOND: Final = ("_play", "_spring")


@dataclass(frozen=True)
class Motion:
    """Commands and how they begin.

    Attributes:
        commands: (rows, nactuators).
        qpos: of the observed joints at the start, (njoints,) [m, rad].
        substeps: physics steps between two rows.
    """

    commands: Array
    qpos: Array
    substeps: int


@dataclass(frozen=True)
class Closing:
    """What an exported model leaves of the gap, on one motion.

    Attributes:
        before: root mean square of the joints' difference between nominal and simulated with effects [m, rad].
        after: the same between exported and simulated with effects.
        closed: 1 - (after / before)², NaN where the motion shows no gap.
    """

    before: float
    after: float

    @property
    def closed(self) -> float:
        """Share of the mean squared difference that the exported model takes away; NaN where there is none."""
        return 1 - (self.after / self.before) ** 2 if self.before > NOTHING else math.nan


def motion(robot: Robot, seed: int = 0) -> Motion:
    """A smooth random motion around the start, within half of what the limits allow."""
    model, wiring = robot.model, robot.wiring
    start = np.array(model.key_qpos[0] if model.nkey else model.qpos0)
    low, high = {}, {}
    for k, name in enumerate(robot.actuators):
        actuator, joint = int(wiring.actuators[k]), wiring.targets.actuated[k]
        middle = float(start[wiring.qpos[joint]]) if wiring.interface == "position" else 0.0
        reach = SHARE * _reach(robot, actuator, joint, middle)
        low[name], high[name] = middle - reach, middle + reach
    played = random_motion(low, high, SECONDS, 1 / robot.period, seed)
    commands = np.stack([played.commands[name] for name in robot.actuators], axis=1)
    return Motion(commands, start[wiring.qpos], robot.substeps)


def _reach(robot: Robot, actuator: int, joint: int, middle: float) -> float:
    model, slides = robot.model, robot.wiring.targets.slides[joint]
    bounds = [(-math.inf, math.inf)]
    if model.actuator_ctrllimited[actuator]:
        bounds.append(tuple(model.actuator_ctrlrange[actuator]))
    index = model.joint(robot.joints[joint]).id
    if robot.wiring.interface == "position" and model.jnt_limited[index]:
        bounds.append(tuple(model.jnt_range[index]))
    if robot.wiring.interface == "effort" and model.actuator_forcelimited[actuator]:
        bounds.append(tuple(model.actuator_forcerange[actuator]))
    reach = min(min(high - middle, middle - low) for low, high in bounds)
    return max(reach, 0.0) if math.isfinite(reach) else REACH[0 if slides else 1] / SHARE


def simulated(robot: Robot, entries: Sequence[Entry], played: Motion) -> Array:
    """Positions as the simulator of the diagnosis measures them, (rows, njoints) [m, rad]."""
    stepper = Stepper(
        robot.model,
        list(entries),
        rate_hz=1 / (robot.substeps * float(robot.model.opt.timestep)),
        interface=robot.wiring.interface,
        timestep=float(robot.model.opt.timestep),
        joints=robot.joints,
        actuators=robot.actuators,
        seed=0,
    )
    rows = [stepper.position]
    for command in played.commands[:-1]:
        stepper.step(command)
        rows.append(stepper.position)
    return np.array(rows)


def alone(model: mujoco.MjModel, robot: Robot, played: Motion) -> Array:
    """Positions of a model file in MuJoCo alone, from the same start, (rows, njoints) [m, rad].

    What is on its way to a delayed actuator at first is what holds the start: with servos of positions that position.
    """
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    joints = [[model.joint(one).id for one in (name, *_seconds(model, name))] for name in robot.joints]
    for own, value in zip(joints, played.qpos, strict=True):
        data.qpos[model.jnt_qposadr[own[0]]] = value
    actuators = [model.actuator(name).id for name in robot.actuators]
    for actuator, joint in zip(actuators, robot.wiring.targets.actuated, strict=True):
        if model.actuator_actnum[actuator]:
            data.act[model.actuator_actadr[actuator]] = played.qpos[joint]
        if model.actuator_delay[actuator] > 0:
            held = played.qpos[joint] if robot.wiring.interface == "position" else 0.0
            samples = np.full(int(model.actuator_history[actuator, 0]), held)
            mujoco.mj_initCtrlHistory(model, data, actuator, None, samples)
    mujoco.mj_forward(model, data)
    rows = []
    for command in played.commands:
        rows.append([sum(float(data.qpos[model.jnt_qposadr[j]]) for j in own) for own in joints])
        data.ctrl[actuators] = command
        mujoco.mj_step(model, data, nstep=played.substeps)
    return np.array(rows)


def closing(robot: Robot, model: mujoco.MjModel) -> Closing:
    """What a model file leaves of the gap between the nominal model and the one with all effects."""
    played = motion(robot)
    wanted, nominal = simulated(robot, robot.entries, played), simulated(robot, (), played)
    return compared(wanted, nominal, alone(model, robot, played))


def compared(wanted: Array, nominal: Array, exported: Array) -> Closing:
    """The gaps between positions, (rows, njoints) each."""
    return Closing(_rms(nominal - wanted), _rms(exported - wanted))


def _seconds(model: mujoco.MjModel, joint: str) -> list[str]:
    kind = mujoco.mjtObj.mjOBJ_JOINT
    return [joint + suffix for suffix in SECOND if mujoco.mj_name2id(model, kind, joint + suffix) >= 0]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
