"""Import of a real TIAGo's excitation motion: torso and arm, 80 s at 100 Hz, motor currents instead of commands.

Torque = reduction · kmotor · effort (the data set's own settings); the sign of kmotor belongs to it. Which end effector
the robot carried is not stated. The effort of arm_5 to arm_7 is next to nothing and is kept as it is: the lint says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from tiago_mj.models import names
from tiago_mj.recordings.imports.public import DataSet, folder_of, need
from tiago_mj.recordings.read.tables import read_table
from tiago_mj.recordings.recording import SCHEMA, Array, RecordingError, Sidecar, Trial
from tiago_mj.recordings.usable import check_values

DATA: Final = DataSet(
    name="tiago-arm",
    repository="thanhndv212/figaroh-plus",
    commit="c3b5172849b744984b7181fd9d517c83fb4242e1",
    path="examples/tiago/data/identification/dynamic",
    licence="Apache-2.0",
    sha256={
        "tiago_position.csv": "4297a60d434ee89f1f424ad0da8ec65bc00072ac57eb06b94966c0819fc2786d",
        "tiago_velocity.csv": "269f681ca7a9511ac1698bf027ddf601e3fdb49d7d397af4810ec839f136cd69",
        "tiago_effort.csv": "12c635987705efade603426a600f5b315add7f580c720a4b84609dadb9d0a2e9",
    },
)
JOINTS: Final = names.TORSO + names.ARM
#: N·m per unit of recorded effort, reduction · kmotor (figaroh-plus, settings of the TIAGo example); the torso's is 1.
TORQUE_PER_EFFORT: Final[Mapping[str, float]] = dict(
    zip(JOINTS, (1.0, *[100 * 0.136] * 2, *[100 * -0.087] * 2, *[336 * -0.0613] * 3), strict=True)
)
#: Model that the recording is compared with; the end effector of the recorded robot is not known.
ROBOT: Final = "tiago_pal_gripper"


def trials(source: str) -> Iterator[Trial]:
    """The one recording.

    Args:
        source: folder with the three files, or ``download``.

    Raises:
        RecordingError: a file is missing or is not what it was.
    """
    folder = folder_of(DATA, source)
    times, columns = {}, {}
    for quantity in ("position", "velocity", "effort"):
        times[quantity], columns[quantity] = _read(need(folder, f"tiago_{quantity}.csv"), quantity)
    time = times["position"]
    if any(len(other) != len(time) or not np.array_equal(other, time) for other in times.values()):
        raise RecordingError(f"{folder}: the three files do not have the same rows: get them again")
    yield Trial(
        name="tiago_arm",
        time=time - time[0],
        commands={},
        positions=columns["position"],
        velocities=columns["velocity"],
        efforts={joint: TORQUE_PER_EFFORT[joint] * values for joint, values in columns["effort"].items()},
        forces={},
        sidecar=Sidecar(
            schema=SCHEMA,
            trial="tiago_arm",
            robot=ROBOT,
            rate_hz=100.0,
            initial={
                kind: {joint: float(columns[kind][joint][0]) for joint in JOINTS} for kind in ("position", "velocity")
            },
            motion="excitation of torso and arm for identification",
            source={
                **DATA.source,
                "imported": "effort = reduction * kmotor * recorded effort",
                "torque_per_effort": dict(TORQUE_PER_EFFORT),
                "unknown": "end effector, payload, commands",
            },
        ),
        source="tiago_arm.parquet",
    )


def _read(path: Path, quantity: str) -> tuple[Array, dict[str, Array]]:
    table = read_table(path, {}, "")
    found = {}
    for joint in JOINTS:
        name = f"- {joint}_{quantity}"
        if name not in table.columns:
            raise RecordingError(f"{path.name}: column {name!r} is missing: this is not the data set's file")
        check_values(table.columns[name], name, path.name)
        found[joint] = table.columns[name]
    if "t" not in table.columns:
        raise RecordingError(f"{path.name}: column 't' is missing: this is not the data set's file")
    return table.columns["t"], found
