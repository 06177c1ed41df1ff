"""Lint: what is wrong with recordings, said before anything is fitted to them.

Reading repairs what is certain (:mod:`tiago_mj.recordings.read.clock`). What is found here is of two kinds. Some
findings *refuse* a recording, as anything learnt from it would be false: wrong units, signs and names, a clock that
contradicts its rate. The others *inform*: a quantum, a plateau, jitter; and where a channel cannot be believed (dead,
stuck, without sign, not the derivative that it claims to be), :func:`usable` leaves it out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from tiago_mj.recordings.lint import clocks, consistency, exchange, facts, ranges, sensors
from tiago_mj.recordings.lint.names import check_commands, check_names
from tiago_mj.recordings.lint.ranges import JointRanges
from tiago_mj.recordings.lint.summary import Found, summary
from tiago_mj.recordings.recording import CODES, KINDS, Finding, RecordingError, Trial, channels, sampled
from tiago_mj.recordings.robot import Robot

if TYPE_CHECKING:
    from tiago_mj.gap.simulation.plant import Plant


#: Findings on a channel that say nothing of the same channel in another recording.
OF_ONE_RECORDING: Final = ("dead_channel", "stuck")


def inspect(trials: Sequence[Trial], joint_ranges: JointRanges | None = None) -> tuple[Finding, ...]:
    """Findings in trials that were read.

    Args:
        trials: of one robot.
        joint_ranges: of the robot, where a model is known: it shows units and signs that recordings alone cannot.

    Returns:
        Findings in the order of :data:`tiago_mj.recordings.recording.CODES`, refusing ones first.
    """
    found: list[Finding] = []
    for trial in trials:
        found += [*clocks.check(trial), *facts.check(trial)]
    if joint_ranges is not None:
        found += ranges.check(trials, joint_ranges)
    exchanged = list(exchange.check(trials))
    found += [finding for finding, _ in exchanged]
    joints = frozenset[str]().union(*(joints for _, joints in exchanged))
    found += [*sensors.check(trials), *consistency.check(trials, joints)]
    if len(trials) == 1:
        found.append(
            Finding(
                "single_trial",
                trials[0].source,
                "",
                "it is the only recording: all that can be kept aside is a part of the same motion: record more",
            )
        )
    once: dict[tuple[str, str, str, bool], Finding] = {}
    for finding in found:
        once.setdefault((finding.code, finding.file, finding.channel, finding.refuses), finding)
    return tuple(sorted(once.values(), key=lambda finding: (not finding.refuses, CODES.index(finding.code))))


def inspect_all(trials: Sequence[Trial], plant: Plant) -> tuple[Finding, ...]:
    """Findings in trials, checked against the robot that is to replay them: names and joint ranges."""
    known = [plant.model.joint(j).name for j in range(plant.model.njnt)]
    names = [*check_names(trials, known, plant.actuators, plant.sensors)]
    if plant.environment is None:  # an environment commands what it says, and holds the rest
        names += check_commands(trials, Robot.of_model(plant.model))
    joints = _driven(plant)
    actuators = {f"command.{joint}": f"command.{actuator}" for actuator, joint in joints.items()}
    by_joint = [
        replace(trial, commands={joints.get(name, name): sent for name, sent in trial.commands.items()})
        for trial in trials
    ]
    found = inspect(by_joint, JointRanges.of_model(plant.model))
    return (*names, *(replace(f, channel=actuators.get(f.channel, f.channel)) for f in found))


def _driven(plant: Plant) -> dict[str, str]:
    """Joint of every actuator whose command is in the joint's own direction and unit, so that columns can be compared:
    a gripper that is sent 0 to 255 is not."""
    targets, model, actuators = plant.wiring.targets, plant.model, plant.wiring.actuators
    stiffness = -model.actuator_biasprm[actuators, 1]
    own = (stiffness <= 0) | np.isclose(model.actuator_gainprm[actuators, 0], stiffness)
    direct = own & (model.actuator_gear[actuators, 0] > 0)
    named = {name: targets.joint[targets.actuated[k]] for k, name in enumerate(targets.command) if direct[k]}
    return named if len(set(named.values())) == len(named) else {}


def refuse(trials: Sequence[Trial], findings: Sequence[Finding]) -> None:
    """Raise on the first finding that makes recordings unusable.

    Raises:
        RecordingError: a finding refuses its recording, or leaves it without any usable channel.
    """
    refusing = [finding for finding in findings if finding.refuses]
    if refusing:
        more = len(refusing) - 1
        tail = f" (and {more} more such finding{'s' if more > 1 else ''})" if more else ""
        raise RecordingError(f"{refusing[0]} ({refusing[0].code}){tail}")
    for trial in trials:
        left = [name for name in usable(trial, findings) if not (trial.commands and name.startswith("effort."))]
        dead = [f for f in findings if f.file == trial.source and f.discredits]
        # Efforts are not compared where commands are replayed; one value throughout tells nothing beside dead channels.
        if not left or (dead and not any(_changes(name, [trial]) for name in left)):
            why = str(dead[0]) if dead else trial.source
            raise RecordingError(f"{why} (no usable channel is left in this recording)")
    if not any(_changes(name, trials) for name in {n for trial in trials for n in channels(trial, kinds=tuple(KINDS))}):
        raise RecordingError(
            f"{trials[0].source}: every column keeps one value throughout (no usable channel): record a motion"
        )


def _changes(name: str, trials: Sequence[Trial]) -> bool:
    """Whether a channel takes two or more values, within a trial or between constant trials."""
    seen = [sampled(trial, name)[1] for trial in trials if name in channels(trial, kinds=tuple(KINDS))]
    values = np.concatenate(seen) if seen else np.empty(0)
    return len(values) > 0 and bool(np.ptp(values))


def believed(trials: Sequence[Trial], findings: Sequence[Finding]) -> dict[str, frozenset[str]]:
    """Measured channels of every trial that are compared with simulations, by source."""
    everywhere = {f.channel for f in findings if f.discredits and f.code not in OF_ONE_RECORDING}
    out: dict[str, frozenset[str]] = {}
    for trial in trials:  # one file may hold several
        out[trial.source] = out.get(trial.source, frozenset()) | (usable(trial, findings) - everywhere)
    return out


def usable(trial: Trial, findings: Sequence[Finding]) -> frozenset[str]:
    """Columns of a trial's measured channels without those that a finding excludes."""
    bad = {finding.channel for finding in findings if finding.file == trial.source and finding.discredits}
    return frozenset(channels(trial)) - bad


__all__ = ["Found", "JointRanges", "believed", "check_names", "inspect", "inspect_all", "refuse", "summary", "usable"]
