"""A load cell from a file: what ``tiago-mj calibrate-sensor`` writes, or a user by hand.

    schema: tiago_mj.sensor/1
    scale: 100              # sensor units per contact_unit; one number, or a pair right, left
    contact_unit: 606.06    # [N]
    noise: 0.0077           # standard deviation of one sample; one number or a pair
    bias: 0.0               # reading without contact; one number or a pair
    threshold: [0.0385, 0.0385]
    average: 1

What is left out is the TA11's. Any other key is for the reader.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field

from tiago_mj.io.loading import load_yaml
from tiago_mj.io.quoting import quoted
from tiago_mj.io.schema import Open, SchemaError, checked
from tiago_mj.sensing.load_cell import SENSING, LoadCell

SCHEMA: Final = "tiago_mj.sensor/1"
SUFFIXES: Final = (".yaml", ".yml")
_Numbers = Annotated[float | list[float] | None, Field(description="give one number, or two (right, left)")]


class _Sheet(Open):
    """Keys of the file; :class:`~tiago_mj.sensing.load_cell.LoadCell` checks the ranges of their values."""

    scale: _Numbers = None
    contact_unit: float | None = Field(default=None, description="give a positive number [N]")
    noise: _Numbers = None
    bias: _Numbers = None
    threshold: _Numbers = None
    average: int | None = Field(default=None, description="give a whole number of samples")


KEYS: Final = tuple(_Sheet.model_fields)


def read_load_cell(path: str | Path) -> LoadCell:
    """The load cell that a file describes.

    Raises:
        ValueError: there is no such file, it is no YAML, or it describes no load cell; one line.
    """
    file = Path(path)
    if not file.is_file():
        raise ValueError(f"no sensor file {quoted(str(path))}: give the path of what tiago-mj calibrate-sensor wrote")
    data = load_yaml(file, f"{file.name} is no valid YAML")
    said = data.get("schema") if isinstance(data, dict) else None
    if said != SCHEMA:
        raise ValueError(f"{file.name} describes no load cell: its schema is {quoted(said)}, {SCHEMA!r} is read")
    try:
        known: dict[str, Any] = checked(_Sheet, data).model_dump(exclude_none=True, include=set(KEYS))
    except SchemaError as fault:
        raise ValueError(f"{file.name}: {fault}") from fault
    if not known:
        raise ValueError(f"{file.name} says nothing of the load cell: write one of {', '.join(KEYS)}")
    try:
        return LoadCell(**known)
    except ValueError as fault:
        raise ValueError(f"{file.name}: {fault}") from fault


def named_load_cell(name: str | Path) -> LoadCell:
    """The preset of that name, or the load cell that a file describes.

    Raises:
        ValueError: no such preset or file; says which there are.
    """
    if isinstance(name, Path) or (isinstance(name, str) and name.endswith(SUFFIXES)):
        return read_load_cell(name)
    if not isinstance(name, str) or name not in SENSING:
        raise ValueError(
            f"sensing {quoted(name)} is unknown: use one of {', '.join(SENSING)}, a sensor's .yaml file, or a LoadCell"
        )
    return SENSING[name]
