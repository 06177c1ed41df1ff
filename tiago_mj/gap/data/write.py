"""Writing a trial: Parquet, and a JSON sidecar of the same stem."""

from __future__ import annotations

import json
from pathlib import Path

from tiago_mj import atomic
from tiago_mj.extra import pyarrow
from tiago_mj.gap.data.recording import KINDS, Trial, channel, channels
from tiago_mj.gap.data.sidecar import sidecar_mapping
from tiago_mj.quoting import quoted


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
    if not trial.name or Path(trial.name).name != trial.name or trial.name.startswith("."):
        raise ValueError(f"trial name {quoted(trial.name)} is no file name: use letters, digits, '-' and '_'")
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
