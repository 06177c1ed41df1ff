"""Numbers of a robot's drives with the effects in them, at the joints, in SI units: what text formats are made of."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from tiago_mj.effects import EFFECTS, Entry, model_file
from tiago_mj.effects.spec import arrays
from tiago_mj.export.found import Robot
from tiago_mj.export.softer import EFFECT as ELASTICITY
from tiago_mj.export.softer import soften


@dataclass(frozen=True)
class Drive:
    """One driven joint. Units are N, m, s on a sliding joint and N·m, rad, s on a hinge.

    Attributes:
        joint, actuator: names.
        slides: whether the joint slides.
        stiffness, damping: of the servo, at the joint; 0 where it has none.
        gain: force at the joint per unit of a motor's command; of a servo the same as its stiffness or damping.
        friction: dry.
        joint_damping: viscous, of the joint itself.
        armature: inertia of motor and gear [kg, kg·m²].
        effort: largest force; inf where there is no limit.
        velocity: largest speed; inf where there is no limit.
        delay: of commands [s].
        low, high: range of the joint; infinite where there is none.
    """

    joint: str
    actuator: str
    slides: bool
    stiffness: float
    damping: float
    gain: float
    friction: float
    joint_damping: float
    armature: float
    effort: float
    velocity: float
    delay: float
    low: float
    high: float


@dataclass(frozen=True)
class Link:
    """A body whose mass the effects change.

    Attributes:
        name: of the body.
        mass: [kg].
        centre: of mass, in the body's frame, (3,) [m].
        inertia: about the centre along the body's axes: xx, yy, zz, xy, xz, yz [kg·m²].
        moments: principal, (3,) [kg·m²].
        axes: the principal axes' quaternion, (4,).
    """

    name: str
    mass: float
    centre: tuple[float, ...]
    inertia: tuple[float, ...]
    moments: tuple[float, ...]
    axes: tuple[float, ...]


@dataclass(frozen=True)
class Numbers:
    """A robot's numbers with the effects.

    Attributes:
        robot: whose.
        exact: compiled, with what a compiled model can hold.
        model: the same with gains that are felt behind springs; the drives' numbers are its.
        drives: one for each commanded actuator.
        links: bodies whose mass differs from the nominal.
    """

    robot: Robot
    exact: mujoco.MjModel
    model: mujoco.MjModel
    drives: tuple[Drive, ...]
    links: tuple[Link, ...]


def numbers_of(robot: Robot) -> Numbers:
    """The drives' numbers with what was found; of a spring behind a servo the gains that are felt (:func:`soften`)."""
    by_name = model_file.by_effect(robot.entries)
    period = robot.substeps * float(robot.model.opt.timestep)
    kept = [one for name, own in by_name.items() if _is_of_numbers(robot, own, period) for one in own]
    held = model_file.changed(robot.model, robot.wiring, kept, period, robot.substeps).now.host.model
    model = copy.copy(held)
    soften(model, robot.wiring, by_name.get(ELASTICITY, ()))
    delays = _values(robot, "command_delay", "seconds", by_name)
    speeds = _values(robot, "velocity_limit", "velocity", by_name)
    wiring = robot.wiring
    drives = [
        _drive(robot, model, k, delays[k], min(speeds[joint], float(wiring.targets.velocity[k])))
        for k, joint in enumerate(wiring.targets.actuated)
    ]
    rows = [model_file.differing_rows(robot.model, model, field) for field in model_file.OF_BODIES]
    changed = sorted({row for own in rows for row in own})
    return Numbers(robot, held, model, tuple(drives), tuple(_link(model, body) for body in changed))


def _is_of_numbers(robot: Robot, entries: Sequence[Entry], period: float) -> bool:
    try:
        return model_file.holds(robot.model, robot.wiring, entries, period, robot.substeps)
    except ValueError:
        return False


def _drive(robot: Robot, model: mujoco.MjModel, k: int, delay: float, velocity: float) -> Drive:
    wiring, actuator = robot.wiring, int(robot.wiring.actuators[k])
    joint = wiring.targets.actuated[k]
    dof, name = int(wiring.dof[joint]), robot.joints[joint]
    index = model.joint(name).id
    gear = abs(float(model.actuator_gear[actuator, 0])) or 1.0
    effort = float(model.actuator_forcerange[actuator, 1]) * gear if model.actuator_forcelimited[actuator] else math.inf
    if model.jnt_actfrclimited[index]:
        effort = min(effort, float(model.jnt_actfrcrange[index, 1]))
    limited = bool(model.jnt_limited[index])
    low, high = model.jnt_range[index] if limited else (-math.inf, math.inf)
    return Drive(
        joint=name,
        actuator=robot.actuators[k],
        slides=wiring.targets.slides[joint],
        stiffness=_plus(-float(model.actuator_biasprm[actuator, 1]) * gear**2),
        damping=_plus(-float(model.actuator_biasprm[actuator, 2]) * gear**2),
        gain=float(model.actuator_gainprm[actuator, 0]) * float(model.actuator_gear[actuator, 0]),
        friction=float(model.dof_frictionloss[dof]),
        joint_damping=float(np.max(model.dof_damping[dof])),
        armature=float(model.dof_armature[dof]),
        effort=effort,
        velocity=velocity,
        delay=delay,
        low=float(low),
        high=float(high),
    )


def _plus(value: float) -> float:
    """Without the sign of zero."""
    return value + 0.0


def _values(robot: Robot, effect: str, parameter: str, by_name: Mapping[str, Sequence[Entry]]) -> list[float]:
    """A parameter of an effect by target, at its identity where there is none."""
    said = arrays(EFFECTS[effect], [by_name.get(effect, ())], robot.wiring.targets)
    return [float(value) for value in getattr(said, parameter)[0]]


def _link(model: mujoco.MjModel, body: int) -> Link:
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turned = turn.reshape(3, 3)
    matrix = turned @ np.diag(model.body_inertia[body]) @ turned.T
    inertia = tuple(float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return Link(
        name=model.body(body).name,
        mass=float(model.body_mass[body]),
        centre=tuple(map(float, model.body_ipos[body])),
        inertia=inertia,
        moments=tuple(map(float, model.body_inertia[body])),
        axes=tuple(map(float, model.body_iquat[body])),
    )
