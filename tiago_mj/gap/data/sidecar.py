"""Reading and writing a recording's JSON sidecar."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from tiago_mj.gap.data.recording import INTERFACES, SCHEMA, RecordingError, Sidecar

_MAPPINGS: Final = ("servo", "sensing", "object", "initial", "units")
INITIAL: Final = ("position", "velocity", "set_point")
#: What an object's numbers may be: whether 0 and less are allowed, and the most; nothing that fingers hold is larger.
_OBJECT: Final[Mapping[str, tuple[bool, float]]] = {
    "radius_m": (False, 0.25),
    "width_m": (False, 0.5),
    "height_m": (False, 1.0),
    "mass_kg": (False, 50.0),
    "offset_m": (True, 0.25),
    "stiffness": (False, math.inf),
    "friction": (False, math.inf),
}
_SENSING: Final = ("scale", "contact_unit", "average", "noise", "bias")


def load_sidecar(path: Path) -> dict[str, Any]:
    """The mapping in a sidecar.

    Raises:
        RecordingError: it is no JSON object, or of another schema.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as fault:
        raise RecordingError(
            f"{path.name}: the sidecar is not readable JSON ({_line(fault)}): mend or delete it"
        ) from fault
    if not isinstance(raw, dict):
        raise RecordingError(f"{path.name}: the sidecar is no JSON object: write {{...}} with the recording's facts")
    schema = raw.get("schema", SCHEMA)
    if schema != SCHEMA:
        raise RecordingError(f"{path.name}: schema is {schema!r}, this version reads {SCHEMA!r}")
    return raw


def parse_sidecar(raw: Mapping[str, Any], file: str, defaults: Mapping[str, Any] | None = None) -> Sidecar:
    """A sidecar from its mapping; what it lacks is taken from ``defaults``.

    Args:
        raw: as loaded; empty where there is no sidecar.
        file: for messages.
        defaults: the same keys, from the command line. The sidecar wins.

    Raises:
        RecordingError: a field is of the wrong kind.
    """
    merged = {key: value for key, value in (defaults or {}).items() if value is not None}
    merged.update({key: value for key, value in raw.items() if value is not None})
    for key in _MAPPINGS:
        value = merged.get(key)
        if key == "servo" and isinstance(value, str):
            merged[key] = {"name": value}
        elif value is not None and not isinstance(value, dict):
            raise RecordingError(f"{file}: {key} in the sidecar is {value!r}: write a mapping, {{...}}")
    for key in ("trial", "robot"):
        if not isinstance(merged.get(key, ""), str):
            raise RecordingError(f"{file}: {key} in the sidecar is {merged[key]!r}: write text")
    _check_object(merged.get("object") or {}, file)
    for key in _SENSING:
        value = (merged.get("sensing") or {}).get(key)
        several = value if isinstance(value, list) else [value]
        if value is not None and not all(_is_number(number) for number in several):
            raise RecordingError(f"{file}: sensing.{key} in the sidecar is {value!r}: write a number")
    interface = merged.get("interface")
    if interface is not None and interface not in INTERFACES:
        raise RecordingError(f"{file}: interface in the sidecar is {interface!r}: write one of {', '.join(INTERFACES)}")
    rate = merged.get("rate_hz", 0.0)
    if not _is_number(rate) or rate < 0:
        raise RecordingError(f"{file}: rate_hz in the sidecar is {rate!r}: write a positive number [Hz]")
    units = merged.get("units")
    if units is not None and not all(isinstance(unit, str) for unit in units.values()):
        raise RecordingError(f'{file}: units in the sidecar must map columns to units, such as {{"time": "us"}}')
    return Sidecar(
        schema=SCHEMA,
        trial=merged.get("trial", ""),
        robot=merged.get("robot", ""),
        rate_hz=float(rate),
        interface=interface,
        servo=merged.get("servo"),
        sensing=merged.get("sensing"),
        object=merged.get("object"),
        initial=_initial(merged.get("initial"), file),
        goal=merged.get("goal"),
        motion=merged.get("motion"),
        source=merged.get("source"),
        units=units,
        raw=dict(raw),
    )


def sidecar_mapping(sidecar: Sidecar) -> dict[str, Any]:
    """What is written: the fields, and whatever else the raw mapping holds."""
    fields = {
        key: getattr(sidecar, key)
        for key in (
            *("schema", "trial", "robot", "rate_hz", "interface", "servo", "sensing", "object", "initial"),
            *("goal", "motion", "source", "units"),
        )
    }
    return plain({**{key: value for key, value in sidecar.raw.items() if key not in fields}, **fields})


def plain(value: Any) -> Any:
    """The same in JSON's own types; NaN and infinities become None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _check_object(said: Mapping[str, Any], file: str) -> None:
    for key, (signed, most) in _OBJECT.items():
        value = said.get(key)
        if value is None:
            continue
        if not _is_number(value) or (value <= 0 and not signed):
            raise RecordingError(
                f"{file}: object.{key} in the sidecar is {value!r}: write a {'' if signed else 'positive '}number"
            )
        if abs(value) > most:
            unit = key.rpartition("_")[2]
            raise RecordingError(
                f"{file}: object.{key} in the sidecar is {value!r}, more than {most:g} {unit}: is it in {unit}?"
            )


def _initial(value: Any, file: str) -> dict[str, dict[str, float]] | None:
    if value is None:
        return None
    for part, by_joint in value.items():
        if part not in INITIAL:
            raise RecordingError(f"{file}: initial.{part} in the sidecar is unknown: use {', '.join(INITIAL)}")
        if not isinstance(by_joint, dict) or not all(_is_number(number) for number in by_joint.values()):
            raise RecordingError(f"{file}: initial.{part} in the sidecar must map joints to numbers")
    return {part: {joint: float(number) for joint, number in by_joint.items()} for part, by_joint in value.items()}


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _line(fault: BaseException) -> str:
    return " ".join(str(fault).split())
