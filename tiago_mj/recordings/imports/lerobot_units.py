"""In which unit a LeRobot dataset's joints are, and the arm that they belong to.

Servo arms speak degrees from the middle of the calibrated range, or a share of that range, -100 to 100; their gripper a
share from 0 to 100 in either case. No file says which. A share never exceeds 100, so that larger numbers are degrees;
an arm that is none of those and stays within a turn is in radians; anything else is to be said by the user.

A share becomes an angle only where a model says what the range is. That the calibrated range is the model's is assumed,
and told.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tiago_mj.recordings.recording import Array, Finding, RecordingError

if TYPE_CHECKING:
    from tiago_mj.recordings.imports.lerobot_folder import Folder

UNITS: Final = ("degrees", "radians", "normalised", "percent")
#: Beginnings of the types of arms whose servos are calibrated to a range.
SERVO_ARMS: Final = ("so100", "so101", "so_", "bi_so", "bi_koch", "koch", "lekiwi", "omx", "moss")
#: A share of a range is clipped at 100; what is beyond, by more than rounding, is an angle.
SHARE: Final = 100.5
#: Angles of a servo that turns at most twice either way [deg], or of an arm in radians.
MOST_DEGREES, MOST_RADIANS = 720.0, 2 * math.pi
_DEGREE: Final = math.pi / 180
#: MuJoCo's motor: what is sent is a force.
_FORCE: Final = "its actuator is a motor, and the dataset commands positions: give it a <position> servo"


@dataclass(frozen=True)
class Arm:
    """Joints and ranges of an arm, from its model.

    Attributes:
        file: its name.
        joints: hinges and slides.
        ranges: lowest and highest position, by joint [rad, m]; of limited joints alone.
        slides: joints that slide.
        actuators: by the joint that each drives.
        motors: actuators whose command is a force.
    """

    file: str
    joints: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    slides: frozenset[str]
    actuators: Mapping[str, str]
    motors: frozenset[str]

    def need(self, joint: str, where: str) -> None:
        """Refuse a joint that the model lacks.

        Raises:
            RecordingError: it does.
        """
        if joint not in self.joints:
            raise RecordingError(f"{where}: {self.file} has no joint {joint!r}: it has {', '.join(self.joints)}")

    def actuator(self, joint: str) -> str:
        """Name of the actuator of a joint.

        Raises:
            RecordingError: nothing does, or by a force.
        """
        name = self.actuators.get(joint)
        if name is None:
            raise RecordingError(
                f"{self.file}: no named actuator drives {joint!r}, which the dataset commands: add a <position> servo "
                "to the model"
            )
        if name in self.motors:
            raise RecordingError(f"{self.file}: joint {joint!r}: {_FORCE}")
        return name


@dataclass(frozen=True)
class Scale:
    """Conversion of a number to a position [rad, m]: ``factor · number + offset``.

    Attributes:
        factor: None where nothing says what the number is a share of.
        offset: [rad, m].
        said: in words.
    """

    factor: float | None
    offset: float
    said: str


def arm_of(path: Path) -> Arm:
    """An arm from its MJCF.

    Raises:
        RecordingError: the file is missing or does not compile, or is a URDF.
    """
    # Recordings are read without a simulator: MuJoCo is loaded for a model alone.
    import mujoco

    from tiago_mj.models.bounded import load_model
    from tiago_mj.models.limits import joint_limits

    if not path.is_file():
        raise RecordingError(f"--model {path}: no such file")
    if path.suffix.lower() == ".urdf":
        raise RecordingError(f"--model {path.name} is a URDF: make an MJCF of it first, with tiago-mj convert")
    model: Any = load_model(path, f"{path.name} does not compile", RecordingError)
    slide, hinge = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
    static, unbiased = int(mujoco.mjtDyn.mjDYN_NONE), int(mujoco.mjtBias.mjBIAS_NONE)
    kinds = (slide, hinge)
    index = {model.joint(k).name: k for k in range(model.njnt) if model.jnt_type[k] in kinds and model.joint(k).name}
    ranges = {}
    for name in index:
        limits = joint_limits(model, name)
        if limits.lower is not None and limits.upper is not None:
            ranges[name] = (limits.lower, limits.upper)
    actuators: dict[str, str] = {}
    motors: set[str] = set()
    on_joint = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    for k in range(model.nu):
        name = model.actuator(k).name
        if not name or model.actuator_trntype[k] not in on_joint:
            continue
        actuators.setdefault(model.joint(int(model.actuator_trnid[k, 0])).name, name)
        if int(model.actuator_dyntype[k]) == static and int(model.actuator_biastype[k]) == unbiased:
            motors.add(name)
    return Arm(
        file=path.name,
        joints=tuple(index),
        ranges=ranges,
        slides=frozenset(name for name, k in index.items() if model.jnt_type[k] == slide),
        actuators=actuators,
        motors=frozenset(motors),
    )


def scales(
    folder: Folder,
    asked: str | None,
    measured: Mapping[str, Array],
    commanded: Mapping[str, Array],
    arm: Arm | None,
) -> tuple[dict[str, Scale], list[Finding]]:
    """Conversion of each joint's numbers to SI units, and notes on what was assumed.

    Args:
        folder: the dataset.
        asked: of ``--units``; None: what the numbers prove.
        measured, commanded: positions by joint, of all episodes.
        arm: the model's; None where none is given.

    Raises:
        RecordingError: nothing says the unit, or what is asked for cannot be.
    """
    general, own = _asked(asked, measured)
    grippers = [joint for joint in measured if "gripper" in joint.lower() or joint == "Jaw"]
    findings = []
    if general is None:
        body = {joint: values for joint, values in measured.items() if joint not in (*grippers, *own)}
        general, why = _proved(folder, body, [commanded[joint] for joint in body if joint in commanded])
        findings.append(Finding("degrees", folder.name, "", why, repaired=True))
    found = {}
    for joint in measured:
        unit = own.get(joint, "percent" if joint in grippers and general in ("degrees", "normalised") else general)
        found[joint] = _scale(joint, unit, arm)
    shares = [joint for joint, scale in found.items() if scale.said.startswith("a share")]
    if shares:
        what = "taken as shares of the model's joint ranges: the range that was calibrated may be another"
        if arm is None:
            what = "a share of a range that is not known, so kept as extra columns: give --model to have them as angles"
        findings.append(Finding("unit_scale", folder.name, "", f"{', '.join(shares)}: {what}", repaired=True))
    return found, findings


def _asked(text: str | None, joints: Iterable[str]) -> tuple[str | None, dict[str, str]]:
    """Units given by the user, such as ``degrees,gripper=percent``: of all joints, and of single ones."""
    general, own = None, {}
    for item in filter(None, (part.strip() for part in (text or "").split(","))):
        joint, equals, unit = item.rpartition("=")
        if unit not in UNITS:
            raise RecordingError(f"--units {item!r}: use one of {', '.join(UNITS)}, or JOINT= and one of them")
        if equals and joint not in joints:
            raise RecordingError(f"--units {item!r}: there is no joint {joint!r}: there are {', '.join(joints)}")
        if equals:
            own[joint] = unit
        else:
            general = unit
    return general, own


def _proved(folder: Folder, body: Mapping[str, Array], commanded: Iterable[Array]) -> tuple[str, str]:
    """Unit that follows from the range of the numbers, and why."""
    if not body:
        return "radians", "no joint but the gripper: nothing is converted"
    largest = {joint: float(np.nanmax(np.abs(values), initial=0.0)) for joint, values in body.items()}
    joint = max(largest, key=lambda name: largest[name])
    peak = max([largest[joint], *(float(np.nanmax(np.abs(values), initial=0.0)) for values in commanded)])
    servos = folder.robot.startswith(SERVO_ARMS)
    if peak > MOST_DEGREES:
        raise RecordingError(
            f"{folder.name}: joint {joint} reads up to {peak:.4g}, which is neither degrees nor a share of a range: "
            "are these steps of the encoder? record it with the calibrated robot"
        )
    if peak > SHARE:
        return "degrees", f"joints read up to {peak:.4g}, more than a share of a range can: taken as degrees"
    if peak <= MOST_RADIANS and not servos:
        return "radians", f"joints read up to ±{peak:.4g} and the robot is a {folder.robot!r}: taken as radians"
    raise RecordingError(
        f"{folder.name}: joints read up to ±{peak:.4g}, which may be degrees or shares of their ranges (-100 to 100), "
        "and the dataset does not say: give --units degrees or --units normalised, as the robot's use_degrees was"
    )


def _scale(joint: str, unit: str, arm: Arm | None) -> Scale:
    if unit == "radians":
        return Scale(1.0, 0.0, "as it stands")
    if unit == "degrees":
        if arm is not None and joint in arm.slides:
            raise RecordingError(f"{arm.file}: joint {joint!r} slides, it has no degrees: give --units {joint}=...")
        return Scale(_DEGREE, 0.0, "from degrees")
    low, high = (-100.0, 100.0) if unit == "normalised" else (0.0, 100.0)
    if arm is None and unit == "normalised":
        raise RecordingError(
            f"joint {joint!r} is a share of its range (-100 to 100), which only a model tells: give --model FILE.xml"
        )
    if arm is None:
        return Scale(None, 0.0, "a share of its range, 0 to 100, left as it is")
    if joint not in arm.ranges:
        raise RecordingError(
            f"{arm.file}: joint {joint!r} has no range, of which the dataset's numbers are a share: give it one"
        )
    lowest, highest = arm.ranges[joint]
    factor = (highest - lowest) / (high - low)
    return Scale(
        factor,
        lowest - low * factor,
        f"a share of {lowest:.4g} to {highest:.4g}, from {low:g} to {high:g}",
    )
