"""A diagnosis as ``diagnosis.json`` (:class:`tiago_mj.gap.result.Result`), and back.

Floats have six significant digits, keys a fixed order: equal diagnoses are equal files, but for what they took
(:data:`EFFORT`). What is unknown is null.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Final

from tiago_mj.gap.report import verdict
from tiago_mj.gap.result import FILE, SCHEMA, Diagnosis
from tiago_mj.io import atomic
from tiago_mj.io.result_file import ResultFile

DIGITS: Final = 6
#: What a diagnosis took, which is no part of what it says.
EFFORT: Final = ("seconds", "physics_steps", "trial_models")
#: What a file leaves out, since it stands there once already or nobody asks for it, by :class:`Result`'s fields.
_NAMES: Final = {"effects": {"__all__": {"parameters"}}}
OMITTED: Final[Any] = {
    "verdict": {
        "alternatives": {
            "__all__": {**_NAMES, "validation_gain": True, "evidence": True, "parameters": True, "joint": True}
        }
    },
    "ranking": {"__all__": _NAMES},
    "findings": {"__all__": {"refuses", "discredits"}},
}
#: Of the ranking's rows.
ROW: Final = ("effects", "validation_gain", "probability", "parameters", "evidence", "joint")

#: The file, in the folder of a diagnosis.
NAME: Final = "diagnosis.json"
KEPT: Final = ResultFile("diagnosis", NAME, "tiago-mj diagnose", SCHEMA, FILE)


def as_data(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the file holds; only dicts, lists, strings, finite numbers, booleans and None."""
    told = replace(diagnosis, headline=verdict.headline(diagnosis))
    data = FILE.dump_python(told, by_alias=True, exclude=OMITTED, warnings="none")
    data["ranking"] = [{key: row[key] for key in ROW} for row in data["ranking"]]
    cleaned: dict[str, Any] = clean(data)
    return cleaned


def text(diagnosis: Diagnosis) -> str:
    """The file's text."""
    return json.dumps(as_data(diagnosis), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def write(diagnosis: Diagnosis, path: Path) -> None:
    """Write the file whole."""
    atomic.write_text(path, text(diagnosis))


def load(path: Path) -> Diagnosis:
    """Read a diagnosis back, with nothing of what only a page shows. Alternatives take their numbers from the ranking.

    Raises:
        ValueError: as :meth:`ResultFile.load`; one line.
    """
    read = KEPT.load(path)
    found = Diagnosis(**{one.name: getattr(read, one.name) for one in fields(read)})
    return found.with_verdict(alternatives=tuple(map(found.ranked, found.alternatives)))


def fingerprint(path: Path) -> str:
    """SHA-256 of what a diagnosis says, without what it took: the same recordings and seed have the same.

    It is taken of the JSON without :data:`EFFORT`, with sorted keys and no white space (ASCII).

    Raises:
        FileNotFoundError: there is no such file.
    """
    data = json.loads(path.read_text(encoding="utf-8"))
    for effort in EFFORT:
        data.pop(effort, None)
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def clean(value: Any) -> Any:
    """Plain JSON values: numbers finite and rounded, NumPy's turned into Python's."""
    if isinstance(value, Mapping):
        return {str(key): clean(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [clean(item) for item in value]
    if hasattr(value, "item"):  # a NumPy scalar
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") + 0.0 if math.isfinite(value) else None
    return value
