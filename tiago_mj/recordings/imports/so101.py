"""Import of SO-101 recordings: six hobby servos, commanded and measured positions at 50 Hz, one folder a motion.

Stamps are microseconds. The jaw's positions are a share of its range, its velocities are rad/s. Torques are estimates
without sign and are kept as they are: the lint says so.

No model of the arm comes with them. :func:`apart` takes each joint for a servo of its own and cuts the motions into
trials: what other joints and gravity do to it is an offset, a share and an inertia that nobody states.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from tiago_mj.effects.command import CommandDelay
from tiago_mj.effects.joint_sensor import EncoderBias, EncoderScale
from tiago_mj.effects.transmission.friction import ViscousFriction
from tiago_mj.effects.transmission.gear import Armature
from tiago_mj.io.loading import load_text, parse_json
from tiago_mj.io.quoting import one_line, quoted
from tiago_mj.io.rows import numbers, read_rows
from tiago_mj.recordings.imports.public import DataSet, folder_of, need
from tiago_mj.recordings.read.clock import MIN_ROWS
from tiago_mj.recordings.recording import SCHEMA, Array, RecordingError, Sidecar, Trial
from tiago_mj.recordings.trials import cut, repeatability

_MOTIONS: Final = {
    "backlash_detection": (
        "daec0b6d5f718e57211f0a02c23b4b32a6eb30d9211fcbe2eec8e20fd9dc2432",
        "de47b14babdb2cd7453395f4119f6c8eeecee0e237134b48651b53ecdc9df2b1",
    ),
    "chirp_sweep": (
        "9b87d99cdbddfe72cf2f7ceddbde9290b5a47de996fe35f8f2c9a83a84917670",
        "85e9bd89fbc1cb97d21eba269242aca4437a8faa2116859e96b458b7001579d8",
    ),
    "friction_gravity": (
        "f2e53e26d4050ea8631542f10a6c6baa71274114641d9b688fbd4bca165dde0b",
        "2f4ad531531dd6ee112ee874ec08f186b7f5b364a7176c4d14227a8e650a35e2",
    ),
    "gripper_cycles": (
        "187b9c1bfc21ad1e692d11c12b02ea6f94174089c63a6ca813c070e657da4ecc",
        "bfeb47ec298a41b387ec187064cc6cf2fa9afc5423a68164b5f6ea4b0b2b58b7",
    ),
    "multisine": (
        "99562591fb0e8cecae236670e14a13458d49a146bb6448c26cdec25935cd5a80",
        "97d4112d4e83567b62e39e67c1eed515540bbba271a226df5ac796163e35d27b",
    ),
    "step_response": (
        "ba3ef94713ab9e581c2d587aa88245793ba03c644dd9f455fd869a6b428f3ccc",
        "74f67c391331664f059c7058f79b42c5845e813c0acf16e7c79851b1b18b9ec5",
    ),
}
_JOINT_LIST: Final = "3eb4c51245e3b4a480a161673572ce5b50ae0079f878815ec482f68370a5593d"
_FILES: Final = ("control.csv", "state_motor.csv")
DATA: Final = DataSet(
    name="so101",
    repository="isaac-sim2real/sage",
    commit="4ffd2627df9d23e279b35712a67e629ce0c0dfa7",
    path="output/real/so101/custom",
    licence="Apache-2.0",
    sha256={
        f"{motion}/{file}": digest
        for motion, digests in _MOTIONS.items()
        for file, digest in zip((*_FILES, "joint_list.txt"), (*digests, _JOINT_LIST), strict=True)
    },
)
_MICROSECOND: Final = 1e-6
MODEL: Final = "servo.xml"
#: Of a joint; it becomes that of a folder, too, and stands in a model.
_NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")

#: A Feetech STS3215 as public simulators have it (apirrone/Open_Duck_Playground, joints_properties.xml, fitted there):
#: stiffness [N·m/rad], damping [N·m·s/rad], reflected inertia [kg·m²] and greatest torque [N·m]; its dry friction,
#: 0.05 N·m, is left out, to be found. That stiffness goes with the servo's default P of 32, these recordings were made
#: with 16. Without torques only ratios to the stiffness can be found.
P_DEFAULT, P_HERE = 32, 16
STIFFNESS, DAMPING, ARMATURE, STRONGEST = 17.8 * P_HERE / P_DEFAULT, 0.60, 0.028, 3.35
#: One standard deviation of what is not known of a joint in an arm: damping and inertia of the servo at another gain
#: and voltage, and of the links; gravity, which is over small motions an offset and a slope of the position.
KNOWN_TO: Final = {
    ViscousFriction.name: 0.3,
    Armature.name: 0.02,
    EncoderBias.name: 0.05,
    EncoderScale.name: 0.05,
    CommandDelay.name: 0.01,
}


def trials(source: str) -> Iterator[Trial]:
    """One trial for each motion.

    Args:
        source: the folder of a motion, a folder of such folders, or ``download``.

    Raises:
        RecordingError: no motion is there, or a file is not what it was.
    """
    folder = folder_of(DATA, source)
    motions = (
        [folder] if (folder / _FILES[1]).is_file() else sorted(path.parent for path in folder.glob(f"*/{_FILES[1]}"))
    )
    if not motions:
        raise RecordingError(
            f"{folder}: no motion is there: give a folder with {' and '.join(_FILES)}, or of such folders"
        )
    for motion in motions:
        yield _trial(motion)


def apart(source: str) -> Iterator[tuple[str, Trial]]:
    """Each joint alone, with its trials in a folder of its name. Trials in which it does not move by a step of its
    encoder are left out: they would look like a dead sensor. A joint comes back to where it was only so far, which is
    measured where commands repeat, and stated: no model of one joint can do better.

    Args:
        source: as for :func:`trials`.

    Raises:
        RecordingError: no motion is there, or a file is not what it was.
    """
    motions = list(trials(source))
    scatter = {joint: repeatability(motions, joint) for joint in motions[0].commands}
    for motion in motions:
        for joint, command in motion.commands.items():
            if np.ptp(command[np.isfinite(command)]) == 0:
                continue  # not asked to move
            side = motion.sidecar
            alone = replace(
                motion,
                commands={joint: command},
                positions={joint: motion.positions[joint]},
                velocities={joint: motion.velocities[joint]},
                efforts={joint: motion.efforts[joint]},
                sidecar=replace(
                    side,
                    robot=MODEL,
                    initial={"position": {joint: (side.initial or {})["position"][joint]}},
                    raw={"uncertainty": {**KNOWN_TO, **({"position": scatter[joint]} if scatter[joint] else {})}},
                ),
            )
            for part in cut(alone):
                if np.ptp(part.positions[joint][np.isfinite(part.positions[joint])]) > 0:
                    yield joint, part


def servo(joint: str) -> str:
    """MJCF of one servo: a position loop, its own damping and inertia, no gravity."""
    return f"""<mujoco model="servo">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="link">
      <joint name="{joint}" axis="0 0 1" damping="{DAMPING}" armature="{ARMATURE}"/>
      <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.05" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator><position name="{joint}" joint="{joint}" kp="{STIFFNESS}" forcerange="{-STRONGEST} {STRONGEST}"/></actuator>
</mujoco>
"""


def _trial(folder: Path) -> Trial:
    joints = _joints(need(folder, "joint_list.txt"))
    sent, (command,) = _read(need(folder, _FILES[0]), ("positions",), len(joints))
    seen, (position, velocity, torque) = _read(
        need(folder, _FILES[1]), ("positions", "velocities", "torques"), len(joints)
    )
    time = np.union1d(sent, seen)
    first = float(time[0])
    name = folder.resolve().name

    def channel(stamps: Array, values: Array) -> dict[str, Array]:
        rows = np.searchsorted(time, stamps)
        filled = np.full((len(time), len(joints)), np.nan)
        filled[rows] = values
        return {joint: filled[:, k].copy() for k, joint in enumerate(joints)}

    return Trial(
        name=name,
        time=(time - first) * _MICROSECOND,
        commands=channel(sent, command),
        positions=channel(seen, position),
        velocities=channel(seen, velocity),
        efforts=channel(seen, torque),
        forces={},
        sidecar=Sidecar(
            schema=SCHEMA,
            trial=name,
            robot="so101",
            rate_hz=round(float(1 / (np.median(np.diff(sent)) * _MICROSECOND)), 4),
            interface="position",
            servo={"name": "Feetech STS3215", "P": P_HERE, "D": 32, "encoder_step_rad": 2 * np.pi / 4096},
            initial={"position": {joint: float(position[0, k]) for k, joint in enumerate(joints)}},
            motion=name,
            source={
                **DATA.source,
                "path": f"{DATA.path}/{name}",
                "imported": f"time from us, first stamp {first:.6g} us set to 0",
                "unknown": "links' masses, load",
                "remarks": "positions of Jaw are a share of its range, its velocities rad/s; torques have no sign",
            },
        ),
        source=f"{name}.parquet",
    )


def _joints(path: Path) -> tuple[str, ...]:
    """Names, one a line.

    Raises:
        RecordingError: there are none, or they are no names.
    """
    words = load_text(path, f"{path.parent.name}/{path.name} is no list of joints", error=RecordingError).split()
    if not words or len(set(words)) < len(words) or not all(_NAME.fullmatch(word) for word in words):
        raise RecordingError(
            f"{path.parent.name}/{path.name}: it holds {quoted(' '.join(words))}: write the name of each joint "
            "once, in letters, digits, '.', '-' and '_'"
        )
    return tuple(words)


def _read(path: Path, wanted: Sequence[str], joints: int) -> tuple[Array, tuple[Array, ...]]:
    """Stamps [µs] (n,) and the named list columns, each (n, joints)."""
    lead = f"{path.parent.name}/{path.name}: not the data set's format, or cut off"
    rows = read_rows(path, ("timestamp", *wanted), lead, mend="copy it again", error=RecordingError)
    stamps = numbers([row["timestamp"] for row in rows], "timestamp", lead, mend="copy it again", error=RecordingError)
    try:
        columns = tuple(np.array([parse_json(row[name], name) for row in rows], dtype=np.float64) for name in wanted)
    except (TypeError, ValueError) as fault:
        raise RecordingError(f"{lead} ({one_line(fault)})") from fault
    if len(stamps) < MIN_ROWS or any(values.shape != (len(stamps), joints) for values in columns):
        raise RecordingError(
            f"{path.parent.name}/{path.name}: it does not have {MIN_ROWS} rows of {joints} numbers each: is it whole?"
        )
    if (np.diff(stamps) <= 0).any():
        row = int(np.argmax(np.diff(stamps) <= 0)) + 2
        raise RecordingError(f"{path.parent.name}/{path.name}: timestamp does not increase at row {row}: copy it again")
    if not all(np.isfinite(values).all() for values in columns):
        raise RecordingError(f"{path.parent.name}/{path.name}: a number is not finite: copy it again")
    return stamps, columns
