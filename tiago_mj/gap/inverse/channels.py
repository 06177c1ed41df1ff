"""Which effort channels say something about the joints' torques, and what is wrong with the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.effects import EFFECTS
from tiago_mj.gap.inverse.strips import HEADROOMS, Course, lay_out
from tiago_mj.gap.inverse.torques import Torques
from tiago_mj.gap.recording import Finding, RecordingError, Trial, sampled

Array = NDArray[np.float64]

#: A channel is dead that reads one and the same value in more than this share of its rows while its joint moves.
DEAD_SHARE: Final = 0.5
#: Beyond the bounds of a torque constant by this factor, an effort is no torque in the unit that is claimed.
BEYOND: Final = 3.0
#: A correlation of measured and predicted torque below this says that the sign is wrong.
AGAINST: Final = -0.5


@dataclass(frozen=True)
class Usable:
    """What is compared, and what was left out.

    Attributes:
        course: motion and efforts of the channels in use.
        torques: along it.
        findings: about efforts.
        notes: sentences on what was left out.
    """

    course: Course
    torques: Torques
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]


def choose(
    trials: Sequence[Trial],
    model: mujoco.MjModel,
    joints: Sequence[str],
    known: Sequence[Finding],
    headroom: float = HEADROOMS[0],
) -> Usable:
    """Pick the channels.

    Args:
        trials: with positions and efforts.
        model: nominal.
        joints: whose efforts are asked for.
        known: what the lint found; channels that it discredits are left out.
        headroom: of the low-pass over what moves.

    Raises:
        RecordingError: no channel can be used; says why.
        ValueError: the model lacks a joint.
    """
    files = ", ".join(dict.fromkeys(trial.source for trial in trials))
    in_model = {model.joint(j).name for j in range(model.njnt)}
    missing = [name for name in joints if name not in in_model]
    if missing:
        raise ValueError(
            f"the model has no joint {missing[0]!r}: it has {', '.join(sorted(in_model))}; rename it or give a map file"
        )
    moving = [name for name in trials[0].positions if name in in_model and all(name in t.positions for t in trials)]
    wanted = [name for name in joints if name in moving and all(name in t.efforts for t in trials)]
    findings: list[Finding] = []
    notes: list[str] = []
    discredited = {f.channel for f in known if f.discredits}
    channels = []
    for name in wanted:
        if f"effort.{name}" in discredited:
            notes.append(f"effort.{name} is left out: the lint says that it cannot be believed.")
        elif _dead(trials, name):
            findings.append(
                Finding(
                    "dead_channel",
                    files,
                    f"effort.{name}",
                    "most rows read the same value while the joint moves; it is left out: log the motor's current",
                    discredits=True,
                )
            )
            notes.append(f"effort.{name} is left out: it reads the same value in most rows while the joint moves.")
        else:
            channels.append(name)
    if not channels:
        why = " ".join(notes) or "no joint of the model has both a position and an effort column"
        raise RecordingError(f"{files}: no effort can be used: {why}")
    order = sorted(moving, key=lambda name: int(model.joint(name).dofadr[0]))
    course = lay_out(trials, order, channels, headroom)
    torques = Torques(model, course)
    keep, more, said = _comparable(course, torques, files)
    findings += more
    notes += said
    if not keep:
        raise RecordingError(f"{files}: no effort can be used: {' '.join(notes)}")
    if keep != channels:
        course = lay_out(trials, order, keep, headroom)
        torques = Torques(model, course)
    have = {(f.code, f.channel) for f in known}
    return Usable(course, torques, tuple(f for f in findings if (f.code, f.channel) not in have), tuple(notes))


def _dead(trials: Sequence[Trial], joint: str) -> bool:
    """Whether most rows of a moving joint read one and the same value."""
    values = []
    for trial in trials:
        when, effort = sampled(trial, f"effort.{joint}")
        time, position = sampled(trial, f"position.{joint}")
        if len(time) < 3 or len(when) < 3:
            continue
        speed = np.abs(np.gradient(np.interp(when, time, position), when))
        fast = speed > 0.25 * np.percentile(speed, 95)
        values.append(effort[fast])
    everything = np.concatenate(values) if values else np.zeros(0)
    if not everything.size:
        return True
    _, counts = np.unique(everything, return_counts=True)
    return bool(counts.max() > DEAD_SHARE * everything.size)


def _comparable(course: Course, torques: Torques, files: str) -> tuple[list[str], list[Finding], list[str]]:
    """Channels whose size is that of a torque, findings, and notes on the others."""
    low, high = EFFECTS["torque_constant"].parameters["factor"].bounds[1]
    keep, findings, notes = [], [], []
    moves = course.moving()[:, course.columns]
    measured, predicted = course.stack("effort"), torques.nominal[:, course.columns]
    for c, name in enumerate(course.channels):
        there = moves[:, c]
        unit = "N" if torques.wiring.targets.slides[course.columns[c]] else "N·m"
        if there.sum() < 5 * course.rate / course.cutoff:
            notes.append(f"effort.{name} is left out: the joint hardly moves, and dry friction hides torque at rest.")
            continue
        size, expected = (float(np.sqrt(np.mean(values[there, c] ** 2))) for values in (measured, predicted))
        if size < expected / (high * BEYOND) or size > BEYOND * 100 * max(expected, 1e-9) / low:
            findings.append(
                Finding(
                    "unit_scale",
                    files,
                    f"effort.{name}",
                    f"reads {size:.3g} rms where the model needs {expected:.3g} {unit}: it is not in {unit}; left out: "
                    "state its unit or scale it",
                    discredits=True,
                )
            )
            notes.append(
                f"effort.{name} is left out: it reads {size:.3g} rms where the model needs {expected:.3g} {unit}: "
                f"no force in {unit}; what its numbers mean the log does not say."
            )
            continue
        together = float(np.corrcoef(measured[there, c], predicted[there, c])[0, 1]) if expected > 0 else 0.0
        if together < AGAINST:
            findings.append(
                Finding(
                    "sign",
                    files,
                    f"effort.{name}",
                    f"runs against the torque that the model needs (correlation {together:.2f}): multiply it by -1 if "
                    "the drive counts the other way",
                )
            )
        keep.append(name)
    return keep, findings, notes
