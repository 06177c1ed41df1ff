"""Names in a recording that its robot lacks, and names of the robot that the recording lacks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from tiago_mj.recordings.recording import Finding, Trial, sampled
from tiago_mj.recordings.robot import Robot, nearest

#: A joint that goes this share as far as the commanded ones go was commanded, too: one that is held gives way by less.
MOVES: Final = 0.25


def check_names(
    trials: Sequence[Trial], joints: Sequence[str], actuators: Sequence[str], sensors: Sequence[str]
) -> Iterator[Finding]:
    """Columns of joints, actuators and sensors that the model does not have.

    Each refuses its recording, as one that is mistyped is missed where it belongs. Two kinds are left out of use: what
    a bag holds of joints beyond the model, as the robot named them and nobody typed them, and forces where the model
    has no load cell at all.

    Args:
        trials: as read.
        joints, actuators, sensors: names in the model.
    """
    for trial in trials:
        measured = {**trial.positions, **trial.velocities, **trial.efforts}
        nothing = bool(measured) and not set(measured) & set(joints)
        for kind, there, known, what in (
            ("position", trial.positions, joints, "joint"),
            ("velocity", trial.velocities, joints, "joint"),
            ("effort", trial.efforts, joints, "joint"),
            ("force", trial.forces, sensors, "load cell"),
            ("command", trial.commands, actuators, "actuator"),
        ):
            for name in (name for name in there if name not in known):
                refuses = kind == "command" or (bool(known) if kind == "force" else nothing or not _from_bag(trial))
                meant = nearest(name, [one for one in known if one not in there])
                has = f"did you mean {meant!r}?" if meant else f"it has {', '.join(known) or 'none'}:"
                mend = "map the column (--map), or to null to leave it out" if refuses else "left out of use"
                mend = f"{mend[0].upper()}{mend[1:]}" if meant else mend
                yield Finding(
                    "contradiction",
                    trial.source,
                    f"{kind}.{name}",
                    f"the model has no {what} {name!r}{':' if meant else ','} {has} {mend}",
                    refuses=refuses,
                    discredits=not refuses,
                )


def check_commands(trials: Sequence[Trial], robot: Robot) -> Iterator[Finding]:
    """Actuators that nothing commands in a recording of commands, and commands that the actuators do not take.

    One whose joint moves as commanded joints do refuses the recording: its column is missing or mistyped, unless the
    map file maps it to null. One whose joint rests, or is not measured, may rest on purpose.

    Args:
        trials: of a model of the user's own.
        robot: its names.
    """
    for trial in trials:
        driven = {robot.driven[name] for name in trial.commands if name in robot.driven}
        idle = {a: joint for a, joint in robot.driven.items() if joint not in driven}
        for actuator, joint in idle.items() if trial.commands else ():
            if f"command.{actuator}" in trial.left_out or f"command.{joint}" in trial.left_out:
                continue
            gone, usual = _reach(trial, joint), _usual_reach(trials, joint, robot)
            moves = usual > 0 and gone > MOVES * usual
            unit = "m" if joint in robot.slides else "rad"
            yield Finding(
                "missing_column",
                trial.source,
                f"command.{actuator}",
                f"no column has it, although the joint {joint!r} goes {gone:.2g} {unit}: name or map it (--map), or "
                "map it to null if nothing commands this actuator"
                if moves
                else f"no column has it: the model's actuator {actuator!r} holds still",
                refuses=moves,
            )
        said = trial.sidecar.interface
        for actuator in trial.commands:
            takes = robot.interfaces.get(actuator)
            if takes and said is not None and said not in takes:
                yield Finding(
                    "contradiction",
                    trial.source,
                    f"command.{actuator}",
                    f"the sidecar's interface is {said!r}, and the model's actuator {actuator!r} takes "
                    f"{' or '.join(takes)}: mend the one or the other",
                )


def _from_bag(trial: Trial) -> bool:
    return isinstance(trial.sidecar.source, dict) and "bag" in trial.sidecar.source


def _reach(trial: Trial, joint: str) -> float:
    """Range of motion of a joint [m, rad]; 0 where it was not measured."""
    if joint not in trial.positions:
        return 0.0
    values = sampled(trial, f"position.{joint}")[1]
    return float(np.ptp(values)) if len(values) else 0.0


def _usual_reach(trials: Sequence[Trial], joint: str, robot: Robot) -> float:
    """Largest range of motion of the commanded joints of the same kind (slides or hinges); 0 where there is none."""
    reach = 0.0
    for trial in trials:
        for actuator in trial.commands:
            other = robot.driven.get(actuator)
            if other is not None and (other in robot.slides) == (joint in robot.slides):
                reach = max(reach, _reach(trial, other))
    return reach
