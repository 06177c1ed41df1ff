"""Import of LeRobot datasets: a local folder of version 3.0 (or 2.x), read with pyarrow alone.

``meta/info.json`` names the joints (``observation.state``), the commands (``action``) and the rate; ``data`` holds one
row a frame, of many episodes a file; ``meta/episodes`` says how long each episode is. Every episode becomes a trial. A
row is what was observed and what was then sent, as here. Pictures are left alone.

The files do not say in which unit the arm speaks: degrees, or a share of each joint's calibrated range. What the
numbers prove is taken and said; what they do not is asked for (:mod:`tiago_mj.recordings.imports.lerobot_units`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tiago_mj.io.extra import pyarrow
from tiago_mj.recordings.imports.lerobot_folder import Episode, Folder, open_folder
from tiago_mj.recordings.imports.lerobot_units import Arm, Scale, arm_of, scales
from tiago_mj.recordings.recording import SCHEMA, Array, Finding, RecordingError, Sidecar, Trial

#: How a name of ``observation.state`` ends, and what it is; without an ending it is a position.
ENDINGS: Final[Mapping[str, str]] = {
    ".pos": "position",
    ".vel": "velocity",
    ".torque": "effort",
    ".effort": "effort",
}
#: What other models call the joints of an SO-100 or SO-101.
ALIASES: Final[Mapping[str, tuple[str, ...]]] = {
    "shoulder_pan": ("Rotation", "1"),
    "shoulder_lift": ("Pitch", "2"),
    "elbow_flex": ("Elbow", "3"),
    "wrist_flex": ("Wrist_Pitch", "4"),
    "wrist_roll": ("Wrist_Roll", "5"),
    "gripper": ("Jaw", "6"),
}
_PREFIXES: Final = ("main_", "follower_")


@dataclass(frozen=True)
class Column:
    """One number of a row, and the channel that it becomes.

    Attributes:
        label: as the dataset names it.
        kind: ``position``, ``velocity`` or ``effort``.
        joint: of the model, or of the dataset where no model is given.
        channel: the name of its column here: the joint's, or of a command the actuator's.
        index: where it stands in the row's list.
    """

    label: str
    kind: str
    joint: str
    channel: str
    index: int


def read(
    source: str, *, model: Path | None, robot: str | None, units: str | None, joints: str | None
) -> tuple[list[Trial], list[Finding]]:
    """Trials of a dataset, and notes on what was assumed.

    Args:
        source: folder of the dataset.
        model: MJCF of the arm: joints and actuators have its names, shares of a range its ranges.
        robot: what the sidecars call the model: its path as seen from the recordings.
        units: ``degrees``, ``radians``, ``normalised`` or ``percent``, optionally followed by ``,JOINT=UNIT``.
        joints: ``NAME=JOINT,...``: the dataset's names and the model's; an empty JOINT leaves the column out.

    Raises:
        RecordingError: the folder is no such dataset or not whole, a joint is not found, or the unit is not known.
    """
    folder = open_folder(source)
    arm = None if model is None else arm_of(model)
    renamed = _pairs(joints, "--joints")
    labels = {*folder.state, *folder.action}
    unknown = sorted(set(renamed) - labels - {_stem(label)[0] for label in labels})
    if unknown:
        raise RecordingError(f"--joints: the dataset has no {unknown[0]!r}: it has {', '.join(folder.state)}")
    state = _columns(folder.state, renamed, arm)
    sent = _commands(folder.action, state, renamed, arm)
    episodes = list(folder.episodes(pyarrow()))
    if not episodes:
        raise RecordingError(f"{source}: the dataset holds no episode: record again")
    measured = {c.joint: _of(episodes, "state", c) for c in state if c.kind == "position"}
    commanded = {c.joint: _of(episodes, "action", c) for c in sent}
    by_joint, findings = scales(folder, units, measured, commanded, arm)
    trials = [_trial(folder, episode, state, sent, by_joint, robot) for episode in episodes]
    return trials, findings


def _trial(
    folder: Folder,
    episode: Episode,
    state: Sequence[Column],
    sent: Sequence[Column],
    by_joint: Mapping[str, Scale],
    robot: str | None,
) -> Trial:
    name = f"episode_{episode.index:06d}"
    channels: dict[str, dict[str, Array]] = {kind: {} for kind in ("position", "velocity", "effort", "command")}
    extras: dict[str, Array] = {}
    for columns, rows in ((state, episode.state), (sent, episode.action)):
        for column in columns:
            kind = "command" if columns is sent else column.kind
            values, scale = rows[:, column.index].copy(), by_joint[column.joint]
            if column.kind == "effort":
                channels[kind][column.channel] = values
            elif scale.factor is None:  # a share of a range that nobody states
                extras[f"{kind}.{column.channel}"] = values
            else:
                offset = 0.0 if column.kind == "velocity" else scale.offset
                channels[kind][column.channel] = values * scale.factor + offset
    time = episode.time
    first = {joint: float(values[0]) for joint, values in channels["position"].items() if np.isfinite(values[0])}
    return Trial(
        name=name,
        time=time - time[0],
        commands=channels["command"],
        positions=channels["position"],
        velocities=channels["velocity"],
        efforts=channels["effort"],
        forces={},
        extras=extras,
        sidecar=Sidecar(
            schema=SCHEMA,
            trial=name,
            robot=robot or folder.robot,
            rate_hz=folder.rate_hz,
            interface="position" if channels["command"] else None,
            initial={"position": first},
            motion=episode.task,
            source={
                "format": f"LeRobot {folder.version}",
                "dataset": folder.name,
                "robot_type": folder.robot,
                "episode": episode.index,
                "imported": "; ".join(f"{joint}: {scale.said}" for joint, scale in by_joint.items()),
                "unknown": "when each row was really sampled, where its stamp is its number over the rate; gains and "
                "zeros of the servos",
            },
        ),
        source=f"{name}.parquet",
    )


def _columns(labels: Sequence[str], renamed: Mapping[str, str], arm: Arm | None) -> list[Column]:
    """Columns of measured positions."""
    found: list[Column] = []
    for index, label in enumerate(labels):
        joint, kind = _joint(label, renamed, arm)
        if joint is not None:
            found.append(Column(label, kind, joint, joint, index))
    if not any(column.kind == "position" for column in found):
        raise RecordingError(
            f"meta/info.json: observation.state names no joint position (it has {', '.join(labels)}): say which is "
            "which with --joints NAME=JOINT,..."
        )
    again = {c.joint for c in found if sum((c.joint, c.kind) == (o.joint, o.kind) for o in found) > 1}
    if again:
        raise RecordingError(
            f"meta/info.json: two numbers of observation.state are of the joint {min(again)!r}: tell them apart with "
            "--joints NAME=JOINT,..."
        )
    return found


def _commands(
    labels: Sequence[str], state: Sequence[Column], renamed: Mapping[str, str], arm: Arm | None
) -> list[Column]:
    """Columns of commanded positions, of the joints that are measured."""
    known = {column.joint for column in state}
    found: list[Column] = []
    for index, label in enumerate(labels):
        joint, kind = _joint(label, renamed, arm, known)
        if joint is None:
            continue
        if kind != "position" or joint not in known:
            raise RecordingError(
                f"meta/info.json: action {label!r} is no position of a joint of observation.state "
                f"({', '.join(sorted(known))}), so that it cannot be replayed: leave it out with --joints {label}="
            )
        found.append(Column(label, kind, joint, joint if arm is None else arm.actuator(joint), index))
    if not found:
        raise RecordingError("meta/info.json: no action is the position of a joint, so nothing can be replayed")
    return found


def _joint(
    label: str, renamed: Mapping[str, str], arm: Arm | None, known: set[str] | None = None
) -> tuple[str | None, str]:
    """Joint of the model for a name in the dataset, and its unit; None where it is to be left out."""
    stem, kind = _stem(label)
    if label in renamed or stem in renamed:
        joint = renamed.get(label, renamed.get(stem, ""))
        if joint and arm is not None:
            arm.need(joint, f"--joints {label}={joint}")
        return joint or None, kind
    if arm is None:
        return stem, kind
    short = next((stem.removeprefix(prefix) for prefix in _PREFIXES if stem.startswith(prefix)), stem)
    for name in (stem, short, *ALIASES.get(short, ())):
        if name in arm.joints:
            return name, kind
    alike = [name for name in arm.joints if name.lower() in (stem.lower(), short.lower())]
    if len(alike) == 1:
        return alike[0], kind
    if known is not None:  # of an action: the caller says what it lacks
        return stem, kind
    raise RecordingError(
        f"meta/info.json: the model has no joint for {label!r} (it has {', '.join(arm.joints)}): say which with "
        f"--joints {label}=JOINT, or leave it out with --joints {label}="
    )


def _stem(label: str) -> tuple[str, str]:
    for ending, kind in ENDINGS.items():
        if label.endswith(ending):
            return label.removesuffix(ending), kind
    return label, "position"


def _of(episodes: Sequence[Episode], part: str, column: Column) -> Array:
    """Values of a column over all episodes, (n,)."""
    return np.concatenate([getattr(episode, part)[:, column.index] for episode in episodes])


def _pairs(text: str | None, option: str) -> dict[str, str]:
    """``A=B,C=D`` as a mapping."""
    found = {}
    for item in (text or "").split(","):
        if not item.strip():
            continue
        name, equals, value = item.partition("=")
        if not equals or not name.strip():
            raise RecordingError(f"{option} {item.strip()!r}: write NAME=JOINT,NAME=JOINT")
        found[name.strip()] = value.strip()
    return found
