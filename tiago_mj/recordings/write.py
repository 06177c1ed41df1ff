"""Writing a trial: Parquet, and a JSON sidecar of the same stem."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from tiago_mj.io import atomic
from tiago_mj.io.extra import pyarrow
from tiago_mj.io.quoting import quoted
from tiago_mj.recordings.recording import KINDS, Trial, channel, channels
from tiago_mj.recordings.sidecar import sidecar_mapping

#: Of the name of a file, without its suffix [bytes]; file systems take 255.
LONGEST_NAME: Final = 200
#: Characters that mean something in names of files on some system.
_NO_NAME: Final = frozenset('/\\:*?"<>|')


def check_name(name: str, what: str = "trial name") -> None:
    """Refuse a name that cannot be that of a file or folder everywhere, or that would lead out of its folder.

    Raises:
        ValueError: one line.
    """
    plain = name and Path(name).name == name and not name.startswith(".") and not set(name) & _NO_NAME
    if not plain or not name.isprintable() or len(name.encode("utf-8", "replace")) > LONGEST_NAME:
        raise ValueError(f"{what} {quoted(name)} is no file name: use letters, digits, '-' and '_'")


def write_trial(trial: Trial, folder: Path) -> Path:
    """Write ``NAME.parquet`` and ``NAME.json``; each is whole or not there, and the sidecar is there first.

    Args:
        trial: NaN becomes an empty cell.
        folder: made where it is missing.

    Returns:
        The Parquet file.

    Raises:
        ValueError: the trial's name is no file name.
        ModuleNotFoundError: pyarrow is not installed; says how to.
    """
    check_name(trial.name)
    arrow = pyarrow()
    columns = {"time": trial.time}
    columns.update({name: channel(trial, name) for name in channels(trial, kinds=tuple(KINDS))})
    table = arrow.table({name: arrow.array(values, from_pandas=True) for name, values in columns.items()})
    path = folder / f"{trial.name}.parquet"
    content = json.dumps(sidecar_mapping(trial.sidecar), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    atomic.write_text(path.with_suffix(".json"), content)
    with atomic.replacing(path) as temporary:
        arrow.parquet.write_table(table, temporary, compression="zstd")
    return path
