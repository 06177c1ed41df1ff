"""Recordings of the benchmark: as a reader gives them, and as they are written for any diagnosis.

A case is written as a folder: ``recordings/NAME.parquet`` with a sidecar each, ``robot.xml`` (the nominal model) and,
where the nominal simulator has effects that MJCF cannot state, ``known.json``. Columns and sidecars are those of
docs/recordings.md.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.extra import load

Array = NDArray[np.float64]

ROBOT: Final = "robot.xml"
KNOWN: Final = "known.json"
RECORDINGS: Final = "recordings"


@dataclass(frozen=True)
class Log:
    """One recorded motion.

    Attributes:
        name: of the file.
        time: (T,) [s], from 0.
        columns: by column name, (T,); NaN: nothing at that time.
        sidecar: what the columns do not say.
    """

    name: str
    time: Array
    columns: Mapping[str, Array]
    sidecar: Mapping[str, Any] = field(default_factory=dict)


def log(
    name: str,
    time: Array,
    *,
    command: Mapping[str, Array] | None = None,
    position: Mapping[str, Array] | None = None,
    velocity: Mapping[str, Array] | None = None,
    effort: Mapping[str, Array] | None = None,
    **sidecar: Any,
) -> Log:
    """A log of columns by joint. Rows whose stamp does not increase are left out; time begins at 0."""
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(time)) > 0])
    given = {"command": command, "position": position, "velocity": velocity, "effort": effort}
    columns = {
        f"{kind}.{joint}": np.asarray(values, dtype=np.float64)[keep]
        for kind, by_joint in given.items()
        for joint, values in (by_joint or {}).items()
    }
    stamps = np.asarray(time, dtype=np.float64)[keep]
    return Log(name, stamps - stamps[0], columns, sidecar)


def write(logs: Sequence[Log], folder: Path, model: str | None, known: Sequence[Mapping[str, Any]] = ()) -> Path:
    """Write a case; the folder of its recordings."""
    pa, pq = load("pyarrow", "writing recordings"), load("pyarrow.parquet", "writing recordings")
    recordings = folder / RECORDINGS
    recordings.mkdir(parents=True, exist_ok=True)
    for one in logs:
        table = {"time": one.time, **one.columns}
        arrays = {name: pa.array(values, from_pandas=True) for name, values in table.items()}  # NaN becomes null
        pq.write_table(pa.table(arrays), recordings / f"{one.name}.parquet")
        side = {"schema": "tiago_mj.recording/1", "trial": one.name, **one.sidecar}
        if model is not None:
            side["robot"] = f"../{ROBOT}"
        (recordings / f"{one.name}.json").write_text(json.dumps(side, indent=1) + "\n")
    if model is not None:
        (folder / ROBOT).write_text(model)
    if known:
        (folder / KNOWN).write_text(json.dumps(list(known), indent=1) + "\n")
    return recordings
