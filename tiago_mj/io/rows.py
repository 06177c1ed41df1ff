"""Small tables of words and numbers (CSV) that somebody else wrote: bounded, and every fault is one line.

Recordings have readers of their own (:mod:`tiago_mj.recordings.read`), which take numbers alone and many more of them.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.loading import load_text
from tiago_mj.io.quoting import one_line, quoted

Array = NDArray[np.float64]

#: Rows of a table.
MAX_ROWS: Final = 1_000_000
#: Columns of a table; more are no header of anything that is read so.
MAX_COLUMNS: Final = 200


def read_rows(
    path: Path, names: Sequence[str], lead: str, *, mend: str = "mend the file", error: type[Exception] = ValueError
) -> list[dict[str, str]]:
    """Some columns of a CSV file, row by row, as text.

    Args:
        path: of the file, UTF-8 text of at most :data:`tiago_mj.io.loading.MAX_BYTES`.
        names: of the columns that must be there.
        lead, mend: how a complaint begins and ends.
        error: that is raised.

    Raises:
        error: the file cannot be read, is no such table, or lacks a cell; one line.
    """
    text = load_text(path, lead, mend=mend, error=error)
    try:
        lines = csv.reader(io.StringIO(text, newline=""))
        header = next(lines, [])
        if len(header) > MAX_COLUMNS or not header:
            raise ValueError("the first line is no header")
        missing = [name for name in names if name not in header]
        if missing:
            raise ValueError(f"column {missing[0]} is missing, it has {quoted(', '.join(header))}")
        place = {name: header.index(name) for name in names}
        found = []
        for row in islice(lines, MAX_ROWS):
            if row:
                if len(row) <= max(place.values()):
                    raise ValueError(f"line {lines.line_num}: it has {len(row)} cells of {len(header)}")
                found.append({name: row[column] for name, column in place.items()})
    except (csv.Error, ValueError) as fault:
        raise error(f"{lead} ({one_line(fault)}): {mend}") from fault
    return found


def read_numbers(
    path: Path, names: Sequence[str], lead: str, *, mend: str = "mend the file", error: type[Exception] = ValueError
) -> dict[str, Array]:
    """Columns of finite numbers of a CSV file, (rows,) each; arguments and faults as of :func:`read_rows`."""
    rows = read_rows(path, names, lead, mend=mend, error=error)
    return {name: numbers([row[name] for row in rows], name, lead, mend=mend, error=error) for name in names}


def numbers(
    cells: Sequence[str], name: str, lead: str, *, mend: str = "mend the file", error: type[Exception] = ValueError
) -> Array:
    """Cells as finite numbers, (cells,).

    Raises:
        error: a cell holds none; one line.
    """
    for cell in cells:
        try:
            fine = np.isfinite(float(cell))
        except ValueError:
            fine = False
        if not fine:
            raise error(f"{lead} ({name} is {quoted(cell)}, no number): {mend}")
    return np.array([float(cell) for cell in cells])
