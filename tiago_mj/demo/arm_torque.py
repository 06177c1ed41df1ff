"""The nominal TIAGo against a recording of a real one: torque needed along the measured motion, joint by joint.

The recording (excitation motion of torso and arm, 80 s at 100 Hz) belongs to figaroh-plus and is not part of this
package; :data:`HOW_TO_GET` says where it is. Its effort is motor current: torque = reduction · kmotor · effort. This
module says how far the model is from the robot, not why.
"""

from __future__ import annotations

import hashlib
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.models import inverse, names

Array = NDArray[np.float64]

FOLDER: Final = "tiago_arm"
SOURCE: Final = "thanhndv212/figaroh-plus, commit c3b5172, examples/tiago/data/identification/dynamic (Apache-2.0)"
HOW_TO_GET: Final = (
    "git clone https://github.com/thanhndv212/figaroh-plus",
    "git -C figaroh-plus checkout c3b5172849b744984b7181fd9d517c83fb4242e1",
    "mkdir -p recordings/tiago_arm",
    "cp figaroh-plus/examples/tiago/data/identification/dynamic/tiago_*.csv recordings/tiago_arm",
    "tiago-mj demo --data recordings",
)

#: Files that are read, and their SHA-256 at that commit. Velocities are derived from the positions: the recorded ones
#: are an estimate that lags 0.15 to 0.19 s behind.
SHA256: Final = {
    "tiago_position.csv": "4297a60d434ee89f1f424ad0da8ec65bc00072ac57eb06b94966c0819fc2786d",
    "tiago_effort.csv": "12c635987705efade603426a600f5b315add7f580c720a4b84609dadb9d0a2e9",
}

#: Joints in the recording's order; [N·m] per unit of effort: reduction · kmotor (same repository, TIAGo's settings).
JOINTS: Final = names.TORSO + names.ARM
NEWTON_METRES_PER_UNIT: Final = np.array([1.0, *[100 * 0.136] * 2, *[100 * -0.087] * 2, *[336 * -0.0613] * 3])
#: Arm joints whose effort says something: the other three report next to nothing while they move.
COMPARABLE: Final = names.ARM[:4]

#: Grid [Hz], and cut-off of positions and efforts [Hz]: nearly all of the excitation moves below 1 Hz, and no joint's
#: share explained changes by more than 0.013 between cut-offs of 1 and 8 Hz.
RATE: Final = 100.0
CUTOFF: Final = 3.0


@dataclass(frozen=True)
class Recording:
    """Measured motion and torque.

    Attributes:
        time: (S,) [s].
        position: (S, 8) [m, rad], torso first.
        effort: (S, 8) [motor current].
        genuine: whether the files are those of the stated commit, byte by byte.
    """

    time: Array
    position: Array
    effort: Array
    genuine: bool


@dataclass(frozen=True)
class ArmComparison:
    """Measured and predicted torque of :data:`COMPARABLE`, and what is left out.

    Attributes:
        joints: compared, n.
        time: (T,) [s].
        measured, predicted: (T, n) [N·m].
        rows: one per joint.
        torso: root mean square of the torso's effort [its unit] and of the force that the model says it needs [N].
        dead: greatest effort of arm_5 to arm_7 [motor current], over that of the joints compared.
        cutoff: of the low-pass on positions and efforts [Hz].
        genuine: as of the :class:`Recording`.
    """

    joints: tuple[str, ...]
    time: Array
    measured: Array
    predicted: Array
    rows: tuple[inverse.Agreement, ...]
    torso: tuple[float, float]
    dead: tuple[float, float]
    cutoff: float
    genuine: bool


def find(data: Path | None) -> Path | None:
    """The recording's folder under ``data``, or None where there is none.

    Raises:
        ValueError: ``data`` is no folder, or its ``tiago_arm`` lacks a file.
    """
    if data is None:
        return None
    if not data.is_dir():
        raise ValueError(f"--data {data} is not a folder: give the one that holds {FOLDER}/")
    folder = data / FOLDER
    if not folder.is_dir():
        return None
    for name in SHA256:
        if not (folder / name).is_file():
            raise ValueError(f"{folder} lacks {name}: copy it from {SOURCE}")
    return folder


def load(folder: Path) -> Recording:
    """Read the recording.

    Raises:
        ValueError: a file is not the table that is expected; names it.
    """
    position, effort = (_read(folder / name) for name in SHA256)
    if position.shape != effort.shape or not np.array_equal(position[:, 0], effort[:, 0]):
        raise ValueError(f"{folder}: positions and efforts have different timestamps; they are not of one recording")
    genuine = all(hashlib.sha256((folder / name).read_bytes()).hexdigest() == sha for name, sha in SHA256.items())
    return Recording(position[:, 0], position[:, 1:], effort[:, 1:], genuine)


def _read(path: Path) -> Array:
    columns = 1 + len(JOINTS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a table without rows is refused below
            table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except ValueError as fault:
        raise ValueError(f"{path} is not a table of numbers with one heading line: {fault}") from fault
    if table.shape[0] < 100 or table.shape[1] != columns:
        raise ValueError(
            f"{path} has {table.shape[0]} rows and {table.shape[1]} columns: at least 100 rows (1 s) and the columns "
            f"t, {', '.join(JOINTS)} are expected"
        )
    return table


def compare(recording: Recording, *, cutoff: float = CUTOFF) -> ArmComparison:
    """Predict the torques of the recorded motion and compare them with the measured ones."""
    motion = inverse.motion(JOINTS, recording.time, recording.position, rate=RATE, cutoff=cutoff)
    predicted = inverse.torque(inverse.free_model("tiago_ta11"), motion)
    effort = inverse.low_pass(inverse.uniform(recording.time, recording.effort, RATE)[1], rate=RATE, cutoff=cutoff)
    measured = effort * NEWTON_METRES_PER_UNIT
    columns = [JOINTS.index(name) for name in COMPARABLE]
    wrist = [JOINTS.index(name) for name in names.ARM if name not in COMPARABLE]
    return ArmComparison(
        joints=COMPARABLE,
        time=motion.time,
        measured=measured[:, columns],
        predicted=predicted[:, columns],
        rows=tuple(
            inverse.agreement(name, measured[:, j], predicted[:, j])
            for name, j in zip(COMPARABLE, columns, strict=True)
        ),
        torso=(float(np.sqrt(np.mean(measured[:, 0] ** 2))), float(np.sqrt(np.mean(predicted[:, 0] ** 2)))),
        dead=(float(np.abs(recording.effort[:, wrist]).max()), float(np.abs(recording.effort[:, columns]).max())),
        cutoff=cutoff,
        genuine=recording.genuine,
    )
