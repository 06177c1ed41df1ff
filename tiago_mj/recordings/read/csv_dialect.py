"""How a CSV file is written: what stands between its cells, and what its decimal point is.

Spreadsheets of half the world write ``0,5;1,25``, others put tabs between cells, a byte order mark before the first or
a line ``sep=;`` above them. All of that is read as it is meant, and said.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tiago_mj.io.extra import load

DECIMAL_COMMAS: Final = "decimal commas"
_DELIMITERS: Final = {",": "commas", ";": "semicolons", "\t": "tabs"}
_STATED: Final = re.compile(r'^"?sep=(.)"?$')
#: A number with a decimal comma; no thousands are set apart.
_DECIMAL_COMMA: Final = re.compile(r"^[+-]?\d*,\d+([eE][+-]?\d+)?$")
_MARK: Final = b"\xef\xbb\xbf"

#: Characters of a header.
_LONGEST: Final = 1_000_000


@dataclass(frozen=True)
class Dialect:
    """Of one file.

    Attributes:
        delimiter: between cells.
        header: names of the columns.
        rows: lines before the first row of numbers.
        marked: whether it begins with a byte order mark.
    """

    delimiter: str
    header: list[str]
    rows: int
    marked: bool

    def said(self, point: str) -> str:
        """A sentence on what differs from commas between cells and decimal points; empty if nothing does."""
        found = [
            *(["a byte order mark"] if self.marked else []),
            *(
                [f"{_DELIMITERS.get(self.delimiter, repr(self.delimiter))} between cells"]
                if self.delimiter != ","
                else []
            ),
            *([DECIMAL_COMMAS] if point == "," else []),
        ]
        return f"it has {', '.join(found)}: read as such" if found else ""


def of(path: Path) -> Dialect:
    """The dialect of a file, from its first line.

    Raises:
        UnicodeDecodeError: it is no UTF-8 text.
        csv.Error: its first line is no header.
    """
    with path.open("rb") as raw:
        marked = raw.read(len(_MARK)) == _MARK
    with path.open(newline="", encoding="utf-8-sig") as stream:
        first = stream.readline(_LONGEST)
        stated = _STATED.match(first.strip("\r\n"))
        if stated:
            first = stream.readline(_LONGEST)
    if len(first) >= _LONGEST:
        raise csv.Error(f"more than {_LONGEST} characters")
    cells = {delimiter: next(csv.reader([first], delimiter=delimiter), []) for delimiter in _DELIMITERS}
    # A file without any of them has one column; commas win a tie.
    delimiter = stated[1] if stated else max(cells, key=lambda one: len(cells[one]))
    header = cells[delimiter] if delimiter in cells else next(csv.reader([first], delimiter=delimiter), [])
    return Dialect(delimiter, [name.strip() for name in header], 2 if stated else 1, marked)


def has_decimal_commas(table: Any, arrow: Any) -> bool:
    """Whether a column that was read as text begins with a number that has a decimal comma."""
    compute: Any = load("pyarrow.compute", "reading recordings")
    for column in table.columns:
        if arrow.types.is_string(column.type):
            first = compute.index(compute.match_substring(column, ","), True).as_py()
            if first >= 0 and _DECIMAL_COMMA.match(column[first].as_py().strip()):
                return True
    return False


def words(table: Any, arrow: Any) -> set[str]:
    """Columns that were read as text."""
    return {field.name for field in table.schema if arrow.types.is_string(field.type)}


def is_number(text: str) -> bool:
    """Whether a cell is a number, whatever its decimal point is."""
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def strange(cells: Iterable[str], said: str) -> str:
    """First cell of a column that is not a number; its first cell where all are numbers.

    Args:
        cells: of the column.
        said: of :meth:`Dialect.said`.
    """
    point, other = (",", ".") if DECIMAL_COMMAS in said else (".", ",")
    first: str | None = None
    for cell in cells:
        first = cell if first is None else first
        if other in cell or not is_number(cell.replace(point, ".")):
            return cell
    return first or ""
