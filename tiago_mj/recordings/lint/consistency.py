"""Channels against each other: a velocity is the position's derivative, motion follows commands, a pad's force follows
its finger's effort. Where they disagree by a sign or a known factor, the log is wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from tiago_mj.recordings.lint.motion import Travel, commanded, filtered, integrated, lags, measured, time_constants
from tiago_mj.recordings.lint.numbers import correlation, noise, rms
from tiago_mj.recordings.recording import Array, Finding, Trial, sampled

#: Cosine of two displacements from which they are the same motion, and below which they are not.
SAME, DIFFERENT = 0.85, 0.4
#: Cosine below which a position and a velocity are not derivative and integral of each other.
UNRELATED: Final = 0.5
#: Factors of wrong units, and how near a measured factor must be.
FACTORS: Final = ((1000.0, "mm"), (100.0, "cm"), (180 / np.pi, "degrees"))
FACTOR_SLACK: Final = 1.25
#: Factor between position and velocity that no filter, scale error or coarse quantum explains.
PLAIN_FACTOR: Final = 1.6
#: Factor within which commands that are no efforts lead as far as the joint goes.
AS_FAR: Final = 1.3
#: Lag of a velocity behind its position that is said [s]: twice that of a usual filter.
LATE: Final = 0.1
#: Windows in which something must have moved before anything is said.
ENOUGH: Final = 6
#: Percentage of the samples in which a pad must read below zero: one that is hit from the side does so for a moment.
PRESSED: Final = 5
#: What commands may be of that are said to be efforts.
INTERFACES: Final = ("velocity", "position")


def check(trials: Sequence[Trial], exchanged: frozenset[str]) -> Iterator[Finding]:
    """Findings on channels that contradict each other; without joints whose columns are exchanged."""
    joints = [j for j in dict.fromkeys(j for trial in trials for j in trial.positions) if j not in exchanged]
    of = {joint: [trial for trial in trials if joint in trial.positions] for joint in joints}
    followed = {joint: _command_and_motion(joint, of[joint], "position") for joint in joints}
    sent = [joint for joint in joints if any(joint in trial.commands for trial in trials)]
    if trials[0].sidecar.interface == "effort" and not all(followed[joint] in INTERFACES for joint in sent):
        # Where friction takes all of it, one joint's effort looks like its velocity; a log of velocities is one of all.
        followed = {joint: "ok" if found in INTERFACES else found for joint, found in followed.items()}
    for joint in joints:
        yield from _joint(joint, of[joint], followed[joint])
    yield from _effort_signs(trials)
    yield from _force_signs(trials)


def _joint(joint: str, trials: Sequence[Trial], command: str) -> Iterator[Finding]:
    against = {id(trial): _position_and_velocity(trial, joint) for trial in trials}
    factor = next((found for found in against.values() if found[0] == "factor"), None)
    if factor is not None:  # the unit is the log's, whether the joint moved in this trial or not
        against = {key: factor if found[0] == "still" else found for key, found in against.items()}
    late = [found for found in against.values() if found[0] == "lag"]
    if len(late) > sum(found[0] == "unrelated" for found in against.values()):
        # A slow filter leaves little of short motions: it is the same one in all trials.
        against = {key: late[0] if found[0] == "unrelated" else found for key, found in against.items()}
    reversed_velocity = any(verdict == "sign" for verdict, _ in against.values())
    for trial in trials:
        verdict, ratio = against[id(trial)]
        yield from _about_velocity(
            trial, joint, verdict, ratio, culprit="position" if command == "sign" else "velocity"
        )
    against_it = trials if command == "sign" else ()
    if command == "ok" and len(trials) > 1:
        against_it = [trial for trial in trials if _command_and_motion(joint, [trial], "position") == "sign"]
    if not reversed_velocity:
        for trial in against_it:
            yield Finding(
                "sign",
                trial.source,
                f"command.{joint}",
                "the joint moves against it: flip its sign in the log, or map it with scale: -1 (--map)",
                refuses=True,
            )
    if command in INTERFACES:
        for trial in trials:
            yield Finding(
                "contradiction",
                trial.source,
                f"command.{joint}",
                f"the sidecar's interface is {trial.sidecar.interface!r}, but the joint follows it as a {command}: "
                "mend the sidecar",
                refuses=True,
            )


def _position_and_velocity(trial: Trial, joint: str) -> tuple[str, float]:
    """Relation of a velocity to the position's derivative: ``ok``, ``still``, ``sign``, ``factor`` or ``unrelated``,
    with the factor; or ``lag`` with the lag [s]."""
    position, velocity = measured(trial, joint), integrated(trial, joint)
    if position is None or velocity is None:
        return "ok", 1.0
    if len(position.windows) < ENOUGH or not (position.moved and velocity.moved):
        return "still", 1.0
    cosine = correlation(position.windows, velocity.windows)
    ratio = rms(position.windows) / rms(velocity.windows)
    if cosine < UNRELATED and (filtered_by := _filter(trial, joint, velocity.windows)):
        return "lag", filtered_by
    if cosine < -UNRELATED:
        return "sign", ratio
    if cosine < UNRELATED:
        return "unrelated", ratio
    if cosine > SAME and max(ratio, 1 / ratio) > PLAIN_FACTOR:
        return "factor", ratio
    late = _lag(trial, joint, position.windows, cosine)
    return ("lag", late) if late >= LATE else ("ok", ratio)


def _lag(trial: Trial, joint: str, gone: Array, cosine: float) -> float:
    """Delay of a velocity [s]; 0 where no delay halves the unexplained part."""
    fits = [
        0.0 if (travel := integrated(trial, joint, lag)) is None else correlation(gone, travel.windows)
        for lag in lags()
    ]
    best = int(np.argmax(fits))
    return float(lags()[best]) if 1 - fits[best] < 0.5 * (1 - cosine) else 0.0


def _filter(trial: Trial, joint: str, gone: Array) -> float:
    """Time constant of the low-pass that makes a velocity of the position [s]; 0 where none does.

    A slow one leaves a velocity that looks unrelated, or even reversed, while the effect ``velocity_filter`` explains
    it: the channel is the evidence of it.
    """
    ways = [filtered(trial, joint, each) for each in time_constants()]
    fits = [correlation(way, gone) for way in ways]
    best = int(np.argmax(fits))
    ratio = rms(ways[best]) / rms(gone)
    return float(time_constants()[best]) if fits[best] > SAME and max(ratio, 1 / ratio) < PLAIN_FACTOR else 0.0


def _about_velocity(trial: Trial, joint: str, verdict: str, ratio: float, culprit: str) -> Iterator[Finding]:
    file = trial.source
    if verdict == "sign":
        other = "velocity" if culprit == "position" else "position"
        yield Finding(
            "sign",
            file,
            f"{culprit}.{joint}",
            f"it runs against {other}.{joint}: flip its sign in the log, or map it with scale: -1 (--map)",
            refuses=True,
        )
    elif verdict == "unrelated":
        yield Finding(
            "contradiction",
            file,
            f"velocity.{joint}",
            "it is not the derivative of the position: left out of use",
            discredits=True,
        )
    elif verdict == "lag":
        yield Finding(
            "contradiction",
            file,
            f"velocity.{joint}",
            f"it is late against the position by {ratio:.2g} s, as a filtered estimate is: it is used as what it is",
        )
    elif verdict == "factor":
        kind, factor = ("position", ratio) if ratio > 1 else ("velocity", 1 / ratio)
        unit = next((u for f, u in FACTORS if max(factor / f, f / factor) < FACTOR_SLACK), None)
        other = "velocity" if kind == "position" else "position"
        if unit is not None:
            said = f"it is {factor:.4g} times what the {other} says, "
            mend = (
                f"so it is in {unit}{'/s' if kind == 'velocity' else ''}: state that in the sidecar's units, or map it "
                "(--map)"
            )
            if stated := trial.units.get(f"{other}.{joint}"):
                mend = (
                    f"which was stated to be in {stated} and converted: take that unit out, or state this one's, too "
                    "(units of the sidecar, or --map)"
                )
            yield Finding(
                "degrees" if unit == "degrees" else "unit_scale", file, f"{kind}.{joint}", said + mend, refuses=True
            )
        else:
            yield Finding(
                "unit_scale",
                file,
                f"velocity.{joint}",
                f"it is {1 / ratio:.3g} times the derivative of the position, so one of the two is in another unit: "
                "the velocity is left out of use",
                discredits=True,
            )


def _command_and_motion(joint: str, trials: Sequence[Trial], kind: str) -> str:
    """Relation of commands to the motion over all trials: ``ok``, ``sign``, or the interface that the commands fit
    instead."""
    read = measured if kind == "position" else integrated
    pairs = [(trial, travel) for trial in trials if (travel := read(trial, joint)) is not None and travel.moved]
    pairs = [(trial, travel) for trial, travel in pairs if joint in trial.commands]
    if not pairs or sum(len(travel.windows) for _, travel in pairs) < ENOUGH:
        return "ok"
    if pairs[0][0].sidecar.interface == "effort":
        return next((other for other in ("velocity", "position") if _same(joint, pairs, other)), "ok")
    stated = follows(joint, pairs, None)
    if stated.max(initial=-1.0) < DIFFERENT:
        other = {"velocity": "position", "position": "velocity"}.get(pairs[0][0].sidecar.interface or "")
        if other and follows(joint, pairs, other).max(initial=-1.0) > SAME and _close(joint, pairs, other):
            return other
        if stated.min(initial=1.0) < -SAME:
            return "sign"
    return "ok"


def follows(joint: str, pairs: Sequence[tuple[Trial, Travel]], interface: str | None) -> Array:
    """Cosine of an actuator's command and a motion by lag, over all trials; (nlags,), or (0,) without commands.

    Args:
        joint: of the command.
        pairs: trials, and the motion in each.
        interface: what the command is taken for; None: what the sidecar says.
    """
    cosines = []
    for lag in lags():
        sent = [commanded(trial, joint, interface or trial.sidecar.interface, lag) for trial, _ in pairs]
        if any(travel is None for travel in sent):
            return np.zeros(0)
        wanted = np.concatenate([travel.windows for travel in sent if travel is not None])
        cosines.append(correlation(wanted, np.concatenate([travel.windows for _, travel in pairs])))
    return np.array(cosines)


def _same(joint: str, pairs: Sequence[tuple[Trial, Travel]], interface: str) -> bool:
    """Whether commands stated to be efforts, integrated as another interface, reproduce the motion of the joint."""
    cosines = follows(joint, pairs, interface)
    if cosines.max(initial=-1.0) < SAME or not _close(joint, pairs, interface):
        return False
    lag = float(lags()[int(np.argmax(cosines))])
    sent = [commanded(trial, joint, interface, lag) for trial, _ in pairs]
    far = rms(np.concatenate([travel.windows for travel in sent if travel is not None]))
    gone = rms(np.concatenate([travel.windows for _, travel in pairs]))
    return max(far / gone, gone / far) < AS_FAR


def _close(joint: str, pairs: Sequence[tuple[Trial, Travel]], interface: str) -> bool:
    """Whether commands, taken as positions, lie near the positions of the joint."""
    if interface != "position":
        return True
    for trial, _ in pairs:
        sent, position = sampled(trial, f"command.{joint}")[1], sampled(trial, f"position.{joint}")[1]
        if abs(np.median(sent) - np.median(position)) > np.ptp(position) + 0.25 * np.ptp(sent):
            return False
    return True


def _effort_signs(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Findings on efforts whose sign is opposite to the servo's position error, beside what follows the joint's speed:
    a servo with much damping lags by its speed, whatever its effort is."""
    for joint in dict.fromkeys(joint for trial in trials for joint in trial.efforts):
        lack, effort, speed = [], [], []
        for trial in trials:
            if joint not in trial.efforts or joint not in trial.positions or joint not in trial.commands:
                continue
            missing = _servo_error(trial, joint)
            if missing is None:
                continue
            time, values = sampled(trial, f"effort.{joint}")
            lack.append(np.interp(time, *missing))
            effort.append(values)
            when, position = sampled(trial, f"position.{joint}")
            speed.append(np.interp(time, when, np.gradient(position, when)) if len(when) > 1 else np.zeros(len(time)))
        if not effort:
            continue
        a, b, v = np.concatenate(lack), np.concatenate(effort), np.concatenate(speed)
        if len(a) < 20 or not (_varies(a) and _varies(b)) or np.corrcoef(a, b)[0, 1] > -SAME:
            continue
        if np.corrcoef(_beside(a, v), _beside(b, v))[0, 1] > DIFFERENT:
            continue  # beside its speed the joint lags to where it is pushed
        one_sided = b.min() >= 0 or b.max() <= 0
        for trial in trials:
            if joint in trial.efforts and one_sided:
                yield Finding(
                    "unsigned",
                    trial.source,
                    f"effort.{joint}",
                    "it is never on the side to which the servo is commanded, so it is a magnitude or is flipped: "
                    "left out of use; record it with its sign",
                    discredits=True,
                )
            elif joint in trial.efforts:
                yield Finding(
                    "sign",
                    trial.source,
                    f"effort.{joint}",
                    "it pushes away from what is commanded: flip its sign in the log, or map it with scale: -1 (--map)",
                    refuses=True,
                )


def _beside(values: Array, speed: Array) -> Array:
    """What of values neither their mean nor the speed explains, by least squares."""
    columns = np.stack([np.ones_like(speed), speed], axis=1)
    left: Array = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return left


def _servo_error(trial: Trial, joint: str) -> tuple[Array, Array] | None:
    """Set point minus position over time, up to a constant; None where commands are efforts."""
    when, position = sampled(trial, f"position.{joint}")
    time, command = sampled(trial, f"command.{joint}")
    if trial.sidecar.interface == "velocity":
        command = np.append(0.0, np.cumsum(command[:-1] * np.diff(time)))
    elif trial.sidecar.interface != "position":
        return None
    return when, np.interp(when, time, command) - position


def _force_signs(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Findings on load cells that read below rest and noise when pressed."""
    for sensor in dict.fromkeys(sensor for trial in trials for sensor in trial.forces):
        for trial in trials:
            if sensor not in trial.forces:
                continue
            values = sampled(trial, f"force.{sensor}")[1]
            if len(values) < ENOUGH:
                continue  # a few steady readings have no rest to fall below
            rest = float(np.median(values[: max(len(values) // 20, 3)]))
            values = _without_drift(values, rest)
            up, down = np.percentile(values, 99) - rest, rest - np.percentile(values, PRESSED)
            below = -np.percentile(values, PRESSED)  # a trial that begins in contact falls, but not below zero
            clear = 10 * noise(values)
            if noise(values) > 0 and min(down, below) > clear and down > 5 * max(up, 0.0):
                yield Finding(
                    "sign",
                    trial.source,
                    f"force.{sensor}",
                    "it falls when the pad is pressed: flip its sign in the log, or map it with scale: -1 (--map)",
                    refuses=True,
                )


def _without_drift(values: Array, rest: float) -> Array:
    """The reading minus its linear trend; the level at rest is kept."""
    index = np.arange(len(values))
    slope = float(np.polyfit(index, values, 1)[0])
    straight = rest + slope * index
    drifts = rms(values - straight) < 0.2 * rms(values - rest)
    return values - slope * index if drifts else values


def _varies(values: Array) -> bool:
    """Whether a signal varies by more than rounding."""
    return bool(np.ptp(values) and np.var(values))
