"""Recording files as tables of numbers: CSV and Parquet.

Memory bounds what is read: a recording may have :data:`MAX_ROWS` rows and :data:`MAX_CELLS` cells. What is longer is
refused before it is loaded, from the Parquet footer or by counting lines.
"""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np

from tiago_mj.io.extra import pyarrow
from tiago_mj.io.quoting import HIDDEN, QUOTED, quoted, unquoted
from tiago_mj.recordings.read import csv_dialect
from tiago_mj.recordings.recording import Array, Finding, RecordingError

#: Over an hour at 240 Hz. The fit simulates every row of every trial again and again: a longer recording is better cut.
MAX_ROWS: Final = 1_000_000
#: Of one recording, rows times columns: 320 MB of float64.
MAX_CELLS: Final = 40_000_000
#: Endings of files of text.
TEXT: Final = (".csv", ".tsv")
#: A robot has some hundred.
MAX_COLUMNS: Final = 5000
#: Of one Parquet file, unpacked, lists and texts with it: twice what MAX_CELLS take.
MAX_BYTES: Final = 640_000_000
#: Of a CSV file, on average [bytes]; text of any length fits into the first 64 MB.
MAX_CELL: Final = 64
#: Rows that are read at once where lists and texts of any length are among them.
_FEW: Final = 64
#: Bytes of a part of a file of which no cell of text is shown.
_LARGE: Final = 100_000_000
_BLOCK: Final = 1 << 22


@dataclass(frozen=True)
class Table:
    """Columns of a recording file, with its sidecar.

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
    try:
        size = path.stat().st_size
    except OSError as fault:  # such as a link to a file that was not fetched (git annex)
        reason = (fault.strerror or str(fault)).lower()
        raise RecordingError(
            f"{path.name}: it cannot be read ({reason}): fetch the file itself, or leave it out"
        ) from fault
    if size == 0:
        raise RecordingError(f"{path.name}: the file is empty: record again or leave it out")
    columns, text, cut, said = _read_csv(path) if path.suffix.lower() in TEXT else (*_read_parquet(path), False, "")
    findings = (Finding("unit_scale", path.name, "", said, repaired=True),) if said else ()
    return Table(columns, path.name, sidecar, sidecar_file, text, cut, findings)


def check_size(file: str, rows: int, columns: int) -> None:
    """Refuse a table above :data:`MAX_ROWS` or :data:`MAX_CELLS`.

    Raises:
        RecordingError: too many rows or cells.
    """
    if rows > MAX_ROWS or columns > MAX_COLUMNS or rows * columns > MAX_CELLS:
        raise RecordingError(
            f"{file}: {rows} rows of {columns} columns are more than the {MAX_ROWS} rows, {MAX_COLUMNS} columns or "
            f"{MAX_CELLS} cells that are read: cut it into trials, one motion each"
        )


def read_parquet(path: Path, name: str, columns: Sequence[str], optional: Sequence[str] = ()) -> Any:
    """Columns of a Parquet file as an arrow table.

    Args:
        path: of the file.
        name: of the file, for messages.
        columns: that must be there.
        optional: that are read, too, where they are there.

    Raises:
        RecordingError: it is cut off, too long, of another format, or lacks a column.
    """
    with _parquet(path, name) as file:
        there = file.schema_arrow.names
        missing = [column for column in columns if column not in there]
        if missing:
            raise RecordingError(f"{name}: column {missing[0]} is missing (there are {', '.join(there[:8])})")
        wanted = [column for column in there if column in (*columns, *optional)]
        check_size(name, _rows(file), len(wanted))
        return _bounded(file, name, wanted)


def _read_parquet(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    """The columns of numbers of a Parquet file, and what a cell of each other column holds."""
    arrow = pyarrow()
    with _parquet(path, path.name) as file:
        fields = list(file.schema_arrow)
        check_size(path.name, _rows(file), len(fields))
        check_names(path.name, [field.name for field in fields])
        numbers = [field.name for field in fields if _holds_numbers(field.type, arrow)]
        text = {field.name: _example(file, field) for field in fields if field.name not in numbers}
        table = file.read(columns=numbers)  # 8 bytes a cell, however well they are packed
        return {name: _floats(table.column(name), arrow) for name in numbers}, text


def check_names(file: str, names: Sequence[str]) -> None:
    """Refuse columns of the same name, and names with characters that are not shown.

    Raises:
        RecordingError: says which.
    """
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise RecordingError(f"{file}: column {quoted(min(twice))} is there more than once: rename or delete one")
    for name in names:
        if HIDDEN.search(name):
            raise RecordingError(f"{file}: column {quoted(name)} has a character that is not shown: rename it")


def _floats(column: Any, arrow: Any) -> Array:
    """A column of numbers, (rows,); NaN where a cell is empty."""
    if arrow.types.is_null(column.type):
        return np.full(len(column), np.nan)
    return np.asarray(column.cast(arrow.float64(), safe=False).to_numpy(), dtype=np.float64)


@contextmanager
def _parquet(path: Path, name: str) -> Iterator[Any]:
    """An open Parquet file; errors of arrow become one line."""
    arrow = pyarrow()
    try:
        with arrow.parquet.ParquetFile(path) as file:
            yield file
    except RecordingError:
        raise
    except (arrow.ArrowException, OSError, MemoryError, ValueError) as fault:
        reason = " ".join(str(fault).split())[:120]
        raise RecordingError(
            f"{name}: not a whole Parquet file ({reason}): "
            + (
                "it is a pointer of Git LFS; fetch the file itself (git lfs pull)"
                if _is_pointer(path)
                else "it was cut off or is of another format; copy it again"
            )
        ) from fault


def _rows(file: Any) -> int:
    """Number of rows of an open file, by its footer and by its row groups, which may differ."""
    parts = (file.metadata.row_group(k).num_rows for k in range(file.metadata.num_row_groups))
    return int(max(file.metadata.num_rows, sum(parts)))


def _holds_numbers(kind: Any, arrow: Any) -> bool:
    types = arrow.types
    return bool(types.is_null(kind) or types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind))


def _bounded(file: Any, name: str, columns: Sequence[str]) -> Any:
    """Columns of an open file with lists or texts, read a few rows at a time up to a bound on memory: a repeated value
    takes only some bytes in the file."""
    pieces, size = [], 0
    for piece in file.iter_batches(_FEW, columns=list(columns)):
        size += piece.nbytes
        if size > MAX_BYTES:
            raise RecordingError(f"{name}: unpacked it takes more than {MAX_BYTES // 1_000_000} MB: cut it into trials")
        pieces.append(piece)
    schema = pyarrow().schema([field for field in file.schema_arrow if field.name in columns])
    return pyarrow().Table.from_batches(pieces, schema)


def _example(file: Any, field: Any) -> str:
    """Value of a cell of a column, shortened for a message; its type where cells may be large."""
    arrow = pyarrow()
    groups = file.metadata.num_row_groups
    if arrow.types.is_nested(field.type) or (groups and file.metadata.row_group(0).total_byte_size > _LARGE):
        return unquoted(field.type)
    cells = (piece.column(0)[0].as_py() for piece in islice(file.iter_batches(1, columns=[field.name]), _FEW))
    return str(next((cell for cell in cells if cell is not None), ""))[:QUOTED]


def _is_pointer(path: Path) -> bool:
    """Whether a file is what Git LFS leaves in place of a file that was not fetched."""
    with path.open("rb") as stream:
        return stream.read(64).startswith(b"version https://git-lfs")


def _read_csv(path: Path) -> tuple[dict[str, Array], dict[str, str], bool, str]:
    """Numeric columns of a CSV file, an example cell of each other column, whether the file ends within a row, and a
    sentence on an unusual dialect."""
    arrow = pyarrow()
    dialect, cut = _csv_layout(path)
    header = dialect.header
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
    check_names(path.name, header)
    said = dialect.said(point)
    columns: dict[str, Array] = {}
    text: dict[str, str] = {}
    for name, column in zip(header, table.columns, strict=True):
        if _holds_numbers(column.type, arrow):
            columns[name] = _floats(column, arrow)
        else:
            text[name] = csv_dialect.strange((str(cell.as_py()) for cell in column if cell.is_valid), said)
    return columns, text, cut, said


def _csv_layout(path: Path) -> tuple[csv_dialect.Dialect, bool]:
    """Dialect of a CSV file, and whether it ends within a row.

    Raises:
        RecordingError: it is no text, has no header, or is larger than what is read.
    """
    try:
        dialect = csv_dialect.of(path)
    except UnicodeDecodeError as fault:
        raise RecordingError(f"{path.name}: not UTF-8 text: save it as CSV in UTF-8") from fault
    except csv.Error as fault:
        raise RecordingError(f"{path.name}: the first line is no header ({fault}): name the columns there") from fault
    header = dialect.header
    if not header or not any(header):
        raise RecordingError(f"{path.name}: the first line is no header: name the columns there")
    size = path.stat().st_size
    if size > MAX_CELLS * MAX_CELL:
        raise RecordingError(
            f"{path.name}: it has {size // 1_000_000} MB, and at most {MAX_CELLS} cells are read: cut it into "
            "trials, one motion each"
        )
    lines, cut = _count_lines(path)
    check_size(path.name, lines - dialect.rows, len(header))
    if size > max(lines * len(header) * MAX_CELL, 16 * _BLOCK):
        raise RecordingError(f"{path.name}: {size // 1_000_000} MB in {lines} rows are no table of numbers: is it CSV?")
    if csv_dialect.is_number(header[0]):
        raise RecordingError(f"{path.name}: the first line holds numbers: put the columns' names there")
    return dialect, cut


def _count_lines(path: Path) -> tuple[int, bool]:
    """Number of ended lines of a text file, and whether an unended one follows."""
    count, last = 0, b"\n"
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK):
            count += block.count(b"\n")
            last = block[-1:]
    return count, last != b"\n"
