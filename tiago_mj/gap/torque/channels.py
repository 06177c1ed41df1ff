"""Which effort channels say something about the joints' torques, and what is wrong with the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import Entry
from tiago_mj.effects.actuator import TorqueConstant
from tiago_mj.gap.torque.strips import Course, lay_out
from tiago_mj.gap.torque.torques import Torques
from tiago_mj.io.deadline import Deadline
from tiago_mj.recordings.lint.sensors import switched_off
from tiago_mj.recordings.recording import Finding, RecordingError, Trial, sampled

Array = NDArray[np.float64]

#: A channel is dead that reads one and the same value in more than this share of its rows while its joint moves.
DEAD_SHARE: Final = 0.5
#: Beyond the bounds of a torque constant by this factor, an effort is no torque in the unit that is claimed.
BEYOND: Final = 3.0
#: A correlation of measured and predicted torque below this says that the sign is wrong.
AGAINST: Final = -0.5
#: Share of the largest torque that a robot's joints carry which the drive of any of them may well need for itself.
CARRIED: Final = 0.02
#: Correlations with the torque needed at the own joint below which, and at another above which, columns are exchanged.
OWN, OTHERS = 0.4, 0.8


@dataclass(frozen=True)
class Wanted:
    """Whose efforts are compared.

    Attributes:
        joints: whose efforts are asked for.
        known: what the lint found; channels that it discredits are left out.
        given: effects that are known already.
        seed: of the noise that is drawn.
        deadline: of all that is computed; None: there is none.
    """

    joints: Sequence[str]
    known: Sequence[Finding] = ()
    given: Sequence[Entry] = ()
    seed: int = 0
    deadline: Deadline | None = None


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


def choose(trials: Sequence[Trial], model: mujoco.MjModel, wanted: Wanted, share: float = 1.0) -> Usable:
    """Pick the channels.

    Args:
        trials: with positions and efforts.
        model: nominal.
        wanted: what is asked for.
        share: of the highest cut-off.

    Raises:
        OutOfTimeError: the deadline is over.
        RecordingError: no channel can be used; says why.
        ValueError: the model lacks a joint.
    """
    files = ", ".join(dict.fromkeys(trial.source for trial in trials))
    in_model = {model.joint(j).name for j in range(model.njnt)}
    missing = [name for name in wanted.joints if name not in in_model]
    if missing:
        raise ValueError(
            f"the model has no joint {missing[0]!r}: it has {', '.join(sorted(in_model))}; rename it or give a map file"
        )
    moving = [name for name in trials[0].positions if name in in_model and all(name in t.positions for t in trials)]
    channels, findings, notes = _believable(trials, moving, wanted, files)
    if not channels:
        why = " ".join(notes) or "no joint of the model has both a position and an effort column"
        raise RecordingError(f"{files}: no effort can be used: {why}")
    order = sorted(moving, key=lambda name: int(model.joint(name).dofadr[0]))
    course = lay_out(trials, order, channels, share)
    torques = Torques(model, course, wanted.given, wanted.deadline)
    keep, more, said = _comparable(course, torques, files)
    findings += more
    notes += said
    if not keep:
        raise RecordingError(f"{files}: no effort can be used: {' '.join(notes)}")
    if keep != channels:
        course = lay_out(trials, order, keep, share)
        torques = Torques(model, course, wanted.given, wanted.deadline)
    have = {(f.code, f.channel) for f in wanted.known}
    return Usable(course, torques, tuple(f for f in findings if (f.code, f.channel) not in have), tuple(notes))


def _believable(
    trials: Sequence[Trial], moving: Sequence[str], wanted: Wanted, files: str
) -> tuple[list[str], list[Finding], list[str]]:
    """Joints whose efforts every trial has, which nothing discredits; findings, and notes on the others."""
    there = [name for name in wanted.joints if name in moving and all(name in t.efforts for t in trials)]
    channels: list[str] = []
    findings: list[Finding] = []
    notes = [
        f"effort.{name} is left out: not every recording has it with its joint's position."
        for name in wanted.joints
        if name not in there
    ]
    discredited = {f.channel for f in wanted.known if f.discredits}
    for name in there:
        channel = f"effort.{name}"
        if channel in discredited:
            notes.append(f"{channel} is left out: the lint says that it cannot be believed.")
        elif _dead(trials, name):
            said = "most rows read the same value while the joint moves; it is left out: log the motor's current"
            findings.append(Finding("dead_channel", files, channel, said, discredits=True))
            notes.append(f"{channel} is left out: it reads the same value in most rows while the joint moves.")
        else:
            channels.append(name)
    return channels, findings, notes


def _dead(trials: Sequence[Trial], joint: str) -> bool:
    """Whether most rows of a moving joint whose drive is on read one and the same value."""
    values = []
    for trial in trials:
        when, effort = sampled(trial, f"effort.{joint}")
        time, position = sampled(trial, f"position.{joint}")
        if len(time) < 3 or len(when) < 3:
            continue
        speed = np.abs(np.gradient(np.interp(when, time, position), when))
        fast = speed > 0.25 * np.percentile(speed, 95)
        values.append(effort[fast & ~switched_off(effort)])
    everything = np.concatenate(values) if values else np.zeros(0)
    if not everything.size:
        return True
    _, counts = np.unique(everything, return_counts=True)
    return bool(counts.max() > DEAD_SHARE * everything.size)


def _comparable(course: Course, torques: Torques, files: str) -> tuple[list[str], list[Finding], list[str]]:
    """Channels whose size is that of a torque, findings, and notes on the others."""
    low, high = TorqueConstant.parameters["factor"].bounds[1]
    keep, findings, notes = [], [], []
    moves = course.moving()[:, course.columns]
    measured, predicted = course.stack("effort"), torques.nominal[:, course.columns]
    enough = moves.sum(axis=0) >= 5 * course.rate / course.cutoff
    slides = np.array([torques.wiring.targets.slides[j] for j in course.columns])
    sizes, needed = (_sizes(values, moves) for values in (measured, predicted))
    exchanged = _exchanged(measured, predicted, moves, enough)
    for c, name in enumerate(course.channels):
        there = moves[:, c]
        unit = "N" if slides[c] else "N·m"
        if not enough[c]:
            notes.append(f"effort.{name} is left out: the joint hardly moves, and dry friction hides torque at rest.")
            continue
        if c in exchanged:
            other = course.channels[exchanged[c]]
            said = f"follows the torque that the model needs at '{other}', and effort.{other} that of '{name}'"
            mend = f"{said}: their columns are exchanged; left out: rename them, or map them (--map)"
            findings.append(Finding("swapped_channels", files, f"effort.{name}", mend, discredits=True))
            notes.append(f"effort.{name} is left out: it {said}: the columns are exchanged.")
            continue
        size, expected = sizes[c], needed[c]
        # A model without friction needs next to nothing of a joint that carries nothing: what its drive may well lose
        # is seen from the joints that do carry something, and from what its actuator can give.
        like = max(expected, CARRIED * float(needed[enough & (slides == slides[c])].max()))
        most = max(BEYOND * 100 * max(like, 1e-9) / low, _strongest(torques, course.columns[c]))
        if size < expected / (high * BEYOND) or size > most:
            said = f"reads {size:.3g} rms where the model needs {expected:.3g} {unit}"
            mend = f"{said}: it is not in {unit}; left out: state its unit or scale it"
            findings.append(Finding("unit_scale", files, f"effort.{name}", mend, discredits=True))
            meaning = f"no force in {unit}; what its numbers mean the log does not say."
            notes.append(f"effort.{name} is left out: it {said}: {meaning}")
            continue
        together = float(np.corrcoef(measured[there, c], predicted[there, c])[0, 1]) if expected > 0 else 0.0
        if together < AGAINST:
            said = f"runs against the torque that the model needs (correlation {together:.2f})"
            mend = f"{said}: multiply it by -1 if the drive counts the other way"
            findings.append(Finding("sign", files, f"effort.{name}", mend))
        keep.append(name)
    return keep, findings, notes


def _sizes(values: Array, moves: NDArray[np.bool_]) -> Array:
    """Root mean square of every channel while it moves, (c,)."""
    return np.array([float(np.sqrt(np.mean(values[m, c] ** 2))) if m.any() else 0.0 for c, m in enumerate(moves.T)])


def _strongest(torques: Torques, joint: int) -> float:
    """What the actuators of a joint can give [N, N·m]; 0 where no limit is known."""
    model, dof = torques.model, torques.wiring.dof[joint]
    j = int(model.dof_jntid[dof])
    limits = [float(np.abs(model.jnt_actfrcrange[j]).max())] if model.jnt_actfrclimited[j] else []
    for a in range(model.nu):
        own = model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT and int(model.actuator_trnid[a, 0]) == j
        if own and model.actuator_forcelimited[a]:
            limits.append(float(np.abs(model.actuator_forcerange[a]).max() * abs(model.actuator_gear[a, 0])))
    return max(limits, default=0.0)


def _exchanged(
    measured: Array, predicted: Array, moves: NDArray[np.bool_], enough: NDArray[np.bool_]
) -> dict[int, int]:
    """Channels of which each follows the torque that the model needs at the other, and not its own."""
    found: dict[int, int] = {}
    some = [c for c in range(measured.shape[1]) if enough[c]]
    for k, a in enumerate(some):
        for b in some[k + 1 :]:
            rows = moves[:, a] & moves[:, b]
            if rows.sum() < 2 or min(np.ptp(v[rows, c]) for v in (measured, predicted) for c in (a, b)) == 0:
                continue
            both = np.corrcoef(measured[rows][:, [a, b]].T, predicted[rows][:, [a, b]].T)[:2, 2:]
            if max(both[0, 0], both[1, 1]) < OWN and min(both[0, 1], both[1, 0]) > OTHERS:
                found |= {a: b, b: a}
    return found
