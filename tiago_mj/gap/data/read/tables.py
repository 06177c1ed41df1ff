"""Recording files as tables of numbers: CSV and Parquet.

Memory bounds what is read: a recording may have :data:`MAX_ROWS` rows and :data:`MAX_CELLS` cells. What is longer is
refused before it is loaded, from the Parquet footer or by counting lines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from tiago_mj.extra import pyarrow
from tiago_mj.gap.data.read import csv_dialect
from tiago_mj.gap.data.recording import Array, Finding, RecordingError

#: Over an hour at 240 Hz. The fit simulates every row of every trial again and again: a longer recording is better cut.
MAX_ROWS: Final = 1_000_000
#: Of one recording, rows times columns: 320 MB of float64.
MAX_CELLS: Final = 40_000_000
#: Endings of files of text.
TEXT: Final = (".csv", ".tsv")
_BLOCK: Final = 1 << 22


@dataclass(frozen=True)
class Table:
    """A recording as it stands in its file.

    Attributes:
        columns: by name, (T,) each; NaN where a cell is empty.
        source: file name.
        sidecar: the sidecar's mapping; empty where there is none.
        sidecar_file: its name, for messages.
        text: columns left out because they hold no numbers, and an example of what they hold.
        cut: whether the file ends within its last row, which is left out.
        findings: what was repaired already.
        facts: what the sidecar and the command line may lack.
    """

    columns: Mapping[str, Array]
    source: str
    sidecar: Mapping[str, Any]
    sidecar_file: str
    text: Mapping[str, str]
    cut: bool = False
    findings: tuple[Finding, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)


def read_table(path: Path, sidecar: Mapping[str, Any], sidecar_file: str) -> Table:
    """Read a CSV or Parquet file.

    Raises:
        RecordingError: it is empty, cut off, too long, or not of its format.
    """
    if path.stat().st_size == 0:
        raise RecordingError(f"{path.name}: the file is empty: record again or leave it out")
    is_text = path.suffix.lower() in TEXT
    table, cut, said = _read_csv(path) if is_text else (read_parquet(path, path.name), False, "")
    twice = {name for name in table.column_names if table.column_names.count(name) > 1}
    if twice:
        raise RecordingError(f"{path.name}: column {min(twice)!r} is there more than once: rename or delete one")
    arrow = pyarrow()
    columns: dict[str, Array] = {}
    text: dict[str, str] = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        kind = column.type
        if arrow.types.is_null(kind):
            columns[name] = np.full(len(column), np.nan)
        elif arrow.types.is_floating(kind) or arrow.types.is_integer(kind) or arrow.types.is_boolean(kind):
            columns[name] = np.asarray(column.cast(arrow.float64(), safe=False).to_numpy(), dtype=np.float64)
        else:
            text[name] = csv_dialect.strange((str(cell.as_py()) for cell in column if cell.is_valid), said)
    findings = (Finding("unit_scale", path.name, "", said, repaired=True),) if said else ()
    return Table(columns, path.name, sidecar, sidecar_file, text, cut, findings)


def check_size(file: str, rows: int, columns: int) -> None:
    """Refuse what would not fit.

    Raises:
        RecordingError: too many rows or cells.
    """
    if rows > MAX_ROWS or rows * columns > MAX_CELLS:
        raise RecordingError(
            f"{file}: {rows} rows of {columns} columns are more than the {MAX_ROWS} rows or {MAX_CELLS} cells that are "
            "read: cut it into trials, one motion each"
        )


def read_parquet(path: Path, name: str, columns: Sequence[str] = (), optional: Sequence[str] = ()) -> Any:
    """A Parquet file as an arrow table.

    Args:
        path: of the file.
        name: of the file, for messages.
        columns: that must be there; none named: all are read.
        optional: that are read, too, where they are there.

    Raises:
        RecordingError: it is cut off, too long, of another format, or lacks a column.
    """
    arrow = pyarrow()
    try:
        file = arrow.parquet.ParquetFile(path)
        there = file.schema_arrow.names
        wanted = [column for column in there if not columns or column in (*columns, *optional)]
        check_size(name, file.metadata.num_rows, len(wanted))
        missing = [column for column in columns if column not in there]
        if missing:
            raise RecordingError(f"{name}: column {missing[0]} is missing (there are {', '.join(there[:8])})")
        return file.read(columns=wanted)
    except (arrow.ArrowInvalid, OSError) as fault:
        reason = " ".join(str(fault).split())[:120]
        raise RecordingError(
            f"{name}: not a whole Parquet file ({reason}): "
            + (
                "it is a pointer of Git LFS; fetch the file itself (git lfs pull)"
                if _is_pointer(path)
                else "it was cut off or is of another format; copy it again"
            )
        ) from fault


def _is_pointer(path: Path) -> bool:
    """Whether a file is what Git LFS leaves in place of a file that was not fetched."""
    with path.open("rb") as stream:
        return stream.read(64).startswith(b"version https://git-lfs")


def _read_csv(path: Path) -> tuple[Any, bool, str]:
    """The table, whether it ends within a row, and how it is written where that is not with commas and points."""
    arrow = pyarrow()
    try:
        dialect = csv_dialect.of(path)
    except UnicodeDecodeError as fault:
        raise RecordingError(f"{path.name}: not UTF-8 text: save it as CSV in UTF-8") from fault
    header = dialect.header
    if not header or not any(header):
        raise RecordingError(f"{path.name}: the first line is no header: name the columns there")
    lines, cut = _count_lines(path)
    check_size(path.name, lines - dialect.rows, len(header))
    if csv_dialect.is_number(header[0]):
        raise RecordingError(f"{path.name}: the first line holds numbers: put the columns' names there")
    # The last cell of a file that does not end in a line's end may be half a number.
    content = path.read_bytes() if cut else b""
    source = content[: content.rfind(b"\n") + 1] if cut else None

    def parsed(point: str) -> Any:
        return arrow.csv.read_csv(
            path if source is None else arrow.BufferReader(source),
            read_options=arrow.csv.ReadOptions(column_names=header, skip_rows=dialect.rows),
            parse_options=arrow.csv.ParseOptions(delimiter=dialect.delimiter),
            convert_options=arrow.csv.ConvertOptions(
                null_values=["", "nan", "NaN", "NAN", "null", "None", "NA"],
                strings_can_be_null=True,
                decimal_point=point,
            ),
        )

    try:
        table = parsed(".")
        point = "."
        if csv_dialect.has_decimal_commas(table, arrow):
            other = parsed(",")
            # Else it is a list of numbers in a column of words that looks like one.
            if csv_dialect.words(other, arrow) < csv_dialect.words(table, arrow):
                table, point = other, ","
    except arrow.ArrowInvalid as fault:
        reason = " ".join(str(fault).split())[:160]
        raise RecordingError(
            f"{path.name}: a row does not fit the header's {len(header)} columns ({reason}): delete or mend that row"
        ) from fault
    return table, cut, dialect.said(point)


def _count_lines(path: Path) -> tuple[int, bool]:
    """Ended lines of a text file, and whether another one follows that has no end."""
    count, last = 0, b"\n"
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK):
            count += block.count(b"\n")
            last = block[-1:]
    return count, last != b"\n"
