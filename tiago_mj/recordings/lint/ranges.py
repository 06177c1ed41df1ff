"""Values in a recording against the ranges of its robot's joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.recordings.read.units import factor
from tiago_mj.recordings.recording import Array, Finding, Trial, channel, sampled

#: Share of the samples that must lie outside before anything is said, and that must lie inside once it is mended.
OUTSIDE, INSIDE = 0.1, 0.98
#: Tolerance of a range, relative to its width: soft limits, encoder bias.
SLACK: Final = 0.25
#: Positions beyond this many times the range's farther end are in another unit; nearer ones may be a scale error.
OTHER_UNIT_RATIO: Final = 2.0
#: A single reading beyond this many times it is a fault of the log.
WILD: Final = 100.0
#: Radians that are read as degrees make a joint's range so small [rad]: 2π · π/180, and some room.
TINY: Final = 0.12
#: Degrees that are read as radians make it so large [rad], and leave whole numbers.
HUGE: Final = 4 * np.pi
#: What bounds a joint that has no range of its own.
SERVO: Final = "its servo's set point (ctrlrange)"
#: Speed over the joint's limit that is no overshoot: a finger that an arm drives into something reaches 7 times it.
TOO_FAST: Final = 15.0


@dataclass(frozen=True)
class JointRanges:
    """Position and velocity ranges of the joints of a robot, without unlimited joints.

    Attributes:
        position: lowest and highest, by joint [m, rad].
        velocity: largest magnitude, by joint [m/s, rad/s].
        slides: whether each joint slides.
        servo: lowest and highest set point of the joint's position servo, of joints without a range of their own.
    """

    position: Mapping[str, tuple[float, float]]
    velocity: Mapping[str, float]
    slides: Mapping[str, bool]
    servo: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def of_model(cls, model: Any) -> JointRanges:
        """Ranges of a compiled ``mujoco.MjModel``; velocity limits are those of :mod:`tiago_mj.models.limits`."""
        # Recordings are read without a simulator: MuJoCo is loaded for a model alone.
        import mujoco

        from tiago_mj.models.limits import joint_limits, servo_ranges

        position, velocity, slides = {}, {}, {}
        for index in range(model.njnt):
            name, kind = model.joint(index).name, int(model.jnt_type[index])
            if not name or kind not in (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)):
                continue
            limits = joint_limits(model, name)
            slides[name] = kind == int(mujoco.mjtJoint.mjJNT_SLIDE)
            if limits.lower is not None and limits.upper is not None:
                position[name] = (limits.lower, limits.upper)
            if limits.velocity:
                velocity[name] = limits.velocity
        servo = {
            joint: span for joint, span in servo_ranges(model).items() if joint in slides and joint not in position
        }
        return cls(position, velocity, slides, servo)


def check(trials: Sequence[Trial], ranges: JointRanges) -> Iterator[Finding]:
    """Findings on values outside the range of the joint."""
    mistaken = _read_as_degrees(trials, ranges)
    if mistaken:
        yield _about_model(trials, ranges, mistaken)
    yield from _read_as_radians(trials, ranges)
    ranges = replace(ranges, position={j: span for j, span in ranges.position.items() if j not in mistaken})
    for trial in trials:
        for joint in trial.positions:
            if joint in ranges.position:
                yield from _position(trial, f"position.{joint}", ranges.position[joint], ranges.slides[joint])
            elif joint in ranges.servo:
                yield from _position(trial, f"position.{joint}", ranges.servo[joint], ranges.slides[joint], SERVO)
        for joint in trial.velocities:
            if joint in ranges.velocity:
                yield from _speed(trial, f"velocity.{joint}", ranges.velocity[joint], ranges.slides[joint])
        for joint in trial.commands:
            if trial.sidecar.interface == "position" and joint in ranges.position:
                yield from _position(trial, f"command.{joint}", ranges.position[joint], ranges.slides[joint])
            elif trial.sidecar.interface == "position" and joint in ranges.servo:
                yield from _position(trial, f"command.{joint}", ranges.servo[joint], ranges.slides[joint], SERVO)
            if trial.sidecar.interface == "velocity" and joint in ranges.velocity:
                yield from _speed(trial, f"command.{joint}", ranges.velocity[joint], ranges.slides[joint])


def _read_as_degrees(trials: Sequence[Trial], ranges: JointRanges) -> tuple[str, ...]:
    """Joints whose ranges must have been written in radians into a model that reads degrees.

    What is recorded goes far beyond such a range and keeps within 57 times it, and hardly any joint has such a range;
    where the recording's unit was stated, it may be wider.
    """
    found = []
    for joint, (low, high) in ranges.position.items():
        having = [trial for trial in trials if joint in trial.positions]
        if ranges.slides[joint] or not having:
            continue
        values = np.concatenate([sampled(trial, f"position.{joint}")[1] for trial in having])
        far = float(np.percentile(np.abs(values), 95)) > OTHER_UNIT_RATIO * max(abs(low), abs(high))
        stated = all(f"position.{joint}" in trial.units for trial in having)
        widest = HUGE * np.pi / 180 if stated else TINY
        tiny = max(abs(low), abs(high)) < widest and float(np.abs(values).max()) < HUGE
        room = SLACK * (high - low)
        inside = (values * np.pi / 180 >= low - room) & (values * np.pi / 180 <= high + room)
        if far and tiny and inside.mean() > INSIDE:
            found.append(joint)
    return tuple(found)


def _about_model(trials: Sequence[Trial], ranges: JointRanges, joints: Sequence[str]) -> Finding:
    low, high = ranges.position[joints[0]]
    having = next(trial for trial in trials if joints[0] in trial.positions)
    values = sampled(having, f"position.{joints[0]}")[1]
    more = f", and so for {len(joints) - 1} more joints" if len(joints) > 1 else ""
    return Finding(
        "degrees",
        having.source,
        "",
        f"the model lets '{joints[0]}' go from {low:.4g} to {high:.4g} rad, it was recorded from {values.min():.4g} to "
        f"{values.max():.4g} rad{more}: the model's ranges are radians that were read as degrees: write <compiler "
        'angle="radian"/> into the MJCF',
        refuses=True,
    )


def _read_as_radians(trials: Sequence[Trial], ranges: JointRanges) -> Iterator[Finding]:
    """Hinges of whole turns whose ends are round numbers: degrees in a model that reads radians."""
    for joint, (low, high) in ranges.position.items():
        ends = [end for end in (low, high) if end]
        if ranges.slides[joint] or not ends or max(abs(end) for end in ends) < HUGE:
            continue
        if all(abs(end - 5 * round(end / 5)) < 1e-6 for end in ends):
            yield Finding(
                "degrees",
                trials[0].source,
                "",
                f"the model lets '{joint}' go from {low:.4g} to {high:.4g} rad: if these are degrees, take "
                'angle="radian" out of the MJCF\'s compiler, or write the ranges in radians',
            )


def _mends(slides: bool) -> tuple[tuple[str, str, float], ...]:
    """Finding code, unit and factor that would bring a value into the range."""
    if slides:
        return (("unit_scale", "mm", 1e-3), ("unit_scale", "cm", 1e-2), ("sign", "", -1.0))
    return (("degrees", "deg", np.pi / 180), ("unit_scale", "mrad", 1e-3), ("sign", "", -1.0))


def _position(
    trial: Trial, name: str, span: tuple[float, float], slides: bool, whose: str = "the joint"
) -> Iterator[Finding]:
    values = sampled(trial, name)[1]
    low, high = span
    room = SLACK * (high - low)

    def inside(mended: Array) -> float:
        return float(((mended >= low - room) & (mended <= high + room)).mean())

    if inside(values) > 1 - OUTSIDE:
        wild = np.abs(values) > WILD * max(abs(low), abs(high))
        if wild.any():
            yield _wild(trial, name, wild, f"{whose} goes from {low:.4g} to {high:.4g}")
        return
    far = float(np.percentile(np.abs(values), 95)) > OTHER_UNIT_RATIO * max(abs(low), abs(high))
    mends = [m for m in _mends(slides) if inside(values * m[2]) > INSIDE and (far or m[0] == "sign")]
    said = f"it goes from {values.min():.4g} to {values.max():.4g}, {whose} from {low:.4g} to {high:.4g}"
    yield _finding(trial, name, said, mends, "", refuses=far or bool(mends))


def _speed(trial: Trial, name: str, limit: float, slides: bool) -> Iterator[Finding]:
    values = sampled(trial, name)[1]
    fast = float(np.percentile(np.abs(values), 95))
    if fast <= TOO_FAST * limit:
        wild = np.abs(values) > WILD * TOO_FAST * limit
        if wild.any():
            yield _wild(trial, name, wild, f"the joint's limit is {limit:.4g}")
        return
    said = f"it reaches {fast:.4g}, the joint's limit is {limit:.4g}"
    fits = [m for m in _mends(slides) if m[0] != "sign" and fast * m[2] <= 2 * limit]
    yield _finding(trial, name, said, fits, "/s", refuses=True)


def _stated(trial: Trial, name: str) -> str | None:
    """Unit in which a channel was said to come; of a command whose joint goes as far, that of the position."""
    kind, _, joint = name.partition(".")
    if name in trial.units or kind != "command" or joint not in trial.positions:
        return trial.units.get(name)
    far, gone = (float(np.ptp(sampled(trial, f"{k}.{joint}")[1])) for k in ("command", "position"))
    return trial.units.get(f"position.{joint}") if 0.5 * gone < far < 2 * gone else None


def _wild(trial: Trial, name: str, wild: NDArray[np.bool_], said: str) -> Finding:
    """Findings on single readings far outside the range of the joint."""
    values = channel(trial, name)
    row = int(np.flatnonzero(~np.isnan(values))[np.argmax(wild)])
    unit = trial.units.get(name)
    stands = "" if unit is None else f" ({values[row] / factor(name.partition('.')[0], unit):.6g} {unit})"
    return Finding(
        "contradiction",
        trial.source,
        name,
        f"row {row + 1} reads {values[row]:.4g}{stands} at {trial.time[row]:.4g} s, {said}: empty the cell"
        + (f" (and {int(wild.sum()) - 1} more)" if wild.sum() > 1 else ""),
        refuses=True,
    )


def _finding(
    trial: Trial, name: str, said: str, mends: list[tuple[str, str, float]], per: str, *, refuses: bool
) -> Finding:
    if not mends:
        return Finding(
            "contradiction",
            trial.source,
            name,
            f"{said}: "
            + ("state its unit in the sidecar's units, or name another robot" if refuses else "is it scaled?"),
            refuses=refuses,
        )
    code, unit, _ = mends[0]
    stated = _stated(trial, name)
    if code != "sign" and stated is not None:
        return Finding(
            "contradiction",
            trial.source,
            name,
            f"{said}, although it was stated to be in {stated} and converted: mend that unit, or the model's range",
            refuses=True,
        )
    mend = (
        "its sign is flipped: map it with scale: -1 (--map)"
        if code == "sign"
        else f'so it is in {unit}{per}: write "units": {{"{name}": "{unit}{per}"}} into the sidecar'
    )
    return Finding(code, trial.source, name, f"{said}: {mend}", refuses=True)
