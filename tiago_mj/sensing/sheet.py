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
from typing import Any, Final

import yaml

from tiago_mj.sensing.load_cell import LoadCell

SCHEMA: Final = "tiago_mj.sensor/1"
SUFFIXES: Final = (".yaml", ".yml")
KEYS: Final = ("scale", "contact_unit", "noise", "bias", "threshold", "average")


def read_load_cell(path: str | Path) -> LoadCell:
    """The load cell that a file describes.

    Raises:
        ValueError: there is no such file, it is no YAML, or it describes no load cell; one line.
    """
    file = Path(path)
    if not file.is_file():
        raise ValueError(f"no sensor file {str(path)!r}: give the path of what tiago-mj calibrate-sensor wrote")
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as fault:
        raise ValueError(f"{file.name} is no valid YAML: {' '.join(str(fault).split())}") from fault
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        said = data.get("schema") if isinstance(data, dict) else None
        raise ValueError(f"{file.name} describes no load cell: its schema is {said!r}, {SCHEMA!r} is read")
    known: dict[str, Any] = {key: data[key] for key in KEYS if data.get(key) is not None}
    if not known:
        raise ValueError(f"{file.name} says nothing of the load cell: write one of {', '.join(KEYS)}")
    try:
        cell: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in known.items()}
        return LoadCell(**cell)
    except (TypeError, ValueError) as fault:
        raise ValueError(f"{file.name}: {' '.join(str(fault).split())}") from fault
