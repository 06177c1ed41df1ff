"""Torques that a robot's own position controllers asked of its motors, from logged goals and stated gains.

Legs and quasi direct drives take goals and gains, and a controller in the motor makes torques of them, while the model
of such a robot has motors: kp · (command − position) − kv · velocity is what those motors were told to give.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from tiago_mj.effects.actuator import TorqueConstant
from tiago_mj.io.quoting import quoted
from tiago_mj.models import gains
from tiago_mj.recordings.recording import Array, Finding, RecordingError, Sidecar, Trial
from tiago_mj.recordings.robot import Robot

#: How well a torque is known whose gain is: an effect of the same kind.
KNOWN_AS = TorqueConstant.name


def are_goals_of_motors(commands: Iterable[str], sidecar: Sidecar, robot: Robot) -> bool:
    """Whether commands are positions for controllers of stated gains, and the model's actuators take torques."""
    names = list(commands)
    stated = sidecar.raw.get("gains") is not None and sidecar.interface in (None, "position")
    return stated and bool(names) and all(robot.interfaces.get(name) == ("effort",) for name in names)


def with_torques(trial: Trial, robot: Robot | None) -> tuple[Trial, list[Finding]]:
    """A recording of position goals of motors, with the torques of its stated gains in the place of the goals.

    Args:
        trial: as read.
        robot: that was recorded; None: its model is not at hand.

    Returns:
        The recording and what was done; as it is where no gains are stated, or its actuators take positions.

    Raises:
        RecordingError: a gain has no value, or a joint no position; one line.
    """
    if robot is None or not are_goals_of_motors(trial.commands, trial.sidecar, robot):
        return trial, []
    try:
        stated = gains.parsed(trial.sidecar.raw["gains"])
    except ValueError as fault:
        raise RecordingError(f"{trial.source}: {fault}") from None
    for who, _ in stated:
        if who is not None and who not in robot.actuators:
            raise RecordingError(f"{trial.source}: gains of {who}, which is no actuator of the model")
    efforts = dict(trial.efforts)
    known: dict[str, float] = dict(trial.sidecar.raw.get("uncertainty") or {})
    for actuator, goals in trial.commands.items():
        joint = robot.driven.get(actuator, actuator)
        kp, kv = (gains.of(stated, actuator, name) for name in gains.GAINS)
        if kp is None or kp.value is None:
            raise RecordingError(
                f"{trial.source}: the model's actuator {quoted(actuator)} is a motor and its commands are positions: "
                "give the controller's gains with values, --gains kp=20,kv=0.5"
            )
        if joint not in trial.positions:
            raise RecordingError(
                f"{trial.source}: column position.{joint} is missing: the torque of its gains needs it: map it (--map)"
            )
        damping = 0.0 if kv is None or kv.value is None else kv.value
        if joint not in efforts:
            efforts[joint] = torque(trial, joint, goals, kp.value, damping)
        if kp.known_to is not None:
            known.setdefault(f"{KNOWN_AS}.{actuator}", kp.known_to)
    side = trial.sidecar
    raw = {key: value for key, value in side.raw.items() if key not in ("gains", "interface")}
    raw |= {"uncertainty": known} if known else {}
    message = (
        f"the model's actuators are motors: commands are taken for goals of controllers with {gains.written(stated)}, "
        "and compared as the torques that these ask for"
    )
    told = Finding("missing_column", trial.source, "effort", message, repaired=True)
    return replace(trial, commands={}, efforts=efforts, sidecar=replace(side, interface=None, raw=raw)), [told]


def torque(trial: Trial, joint: str, goals: Array, stiffness: float, damping: float) -> Array:
    """Torque of a proportional-derivative controller, (T,) [N, N·m]; NaN where the joint was not measured.

    A goal is held from its row to the next, so at a row the torque jumps. It is compared with a motion that is smoothed
    over more than a row, and there the jump counts half: the goal is the mean of the one that ends and the one that
    begins. The goal that begins alone would be half a row early, viscous friction of ``stiffness`` · half a row.

    Args:
        trial: with the joint's position and, perhaps, its velocity.
        joint: name.
        goals: (T,) commanded positions; each holds until the next.
        stiffness, damping: per m or rad, and per its rate.
    """
    goal = before_and_after(goals).mean(axis=0)
    return np.asarray(stiffness * (goal - trial.positions[joint]) - damping * velocity(trial, joint))


def velocity(trial: Trial, joint: str) -> Array:
    """Velocity of a joint, (T,) [m/s, rad/s]: as measured, or that of its positions where a row that has a position has
    none; NaN where neither was measured."""
    position = trial.positions[joint]
    measured = np.isfinite(position)
    found = trial.velocities.get(joint)
    if found is None or not np.isfinite(found[measured]).all():
        found = np.full(len(position), np.nan)
        if measured.sum() > 1:
            found[measured] = np.gradient(position[measured], trial.time[measured])
    return found


def before_and_after(goals: Array) -> Array:
    """The goals that end and begin at every row, (2, T); each holds until the next. The first counts as both; before it
    there is none (NaN).

    Args:
        goals: (T,) commanded positions; NaN in rows without one.
    """
    rows = np.where(np.isfinite(goals), np.arange(len(goals)), -1)
    held = np.maximum.accumulate(rows)
    sent = np.where(held >= 0, goals[np.maximum(held, 0)], np.nan)
    ended = np.concatenate([sent[:1], sent[:-1]])
    return np.stack([np.where(np.isfinite(ended), ended, sent), sent])
