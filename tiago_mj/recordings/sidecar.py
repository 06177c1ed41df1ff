"""Reading and writing a recording's JSON sidecar."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import AfterValidator, Field

from tiago_mj.io.loading import load_json
from tiago_mj.io.quoting import quoted
from tiago_mj.io.schema import Closed, Open, SchemaError, checked
from tiago_mj.recordings.recording import INTERFACES, SCHEMA, RecordingError, Sidecar
from tiago_mj.recordings.usable import RATE, is_rate

#: What recorders write as they like.
_FREE: Final = ("goal", "motion", "source")

#: What a map and the command line may say of the model, too.
OF_MODEL: Final = ("gains", "base", "like", "tie")

_Text = Annotated[str, Field(description="write text")]
_Mapping = Annotated[dict[str, Any] | None, Field(description="write a mapping, {...}")]
_Number = Annotated[float | None, Field(description="write a number")]
_Numbers = Annotated[float | list[float] | None, Field(description="write a number")]
_ByJoint = Annotated[dict[str, float], Field(description="write a number")]


def _positive(most: float = math.inf) -> Any:
    return Field(default=None, gt=0, le=most, description="write a positive number")


def _rate(value: float) -> float:
    if value and not is_rate(value):  # 0: it is not said
        raise ValueError
    return value


class _Servo(Open):
    name: str | None = Field(default=None, description="write text")
    effort_limit: dict[str, float] | None = Field(default=None, description="write limits by joint, {...}")


class _Sensing(Open):
    scale: _Numbers = None
    contact_unit: _Numbers = None
    average: _Numbers = None
    noise: _Numbers = None
    bias: _Numbers = None


class _Object(Open):
    """Object of a grasp, with bounds on its size."""

    shape: Annotated[str | None, Field(description="write text")] = None
    radius_m: float | None = _positive(0.25)
    width_m: float | None = _positive(0.5)
    height_m: float | None = _positive(1.0)
    mass_kg: float | None = _positive(50.0)
    offset_m: float | None = Field(default=None, ge=-0.25, le=0.25, description="write a number")
    stiffness: float | None = _positive()
    damping: _Number = None
    friction: float | None = _positive()
    position_m: list[float] | None = Field(default=None, min_length=2, description="write a list of numbers")


class _Initial(Closed):
    position: _ByJoint = Field(default={})
    velocity: _ByJoint = Field(default={})
    set_point: _ByJoint = Field(default={})


class _Written(Open):
    """Keys of a sidecar that are read; others are ignored."""

    written: Literal["tiago_mj.recording/1"] = Field(default=SCHEMA, alias="schema")
    trial: _Text = ""
    robot: _Text = ""
    rate_hz: Annotated[float, AfterValidator(_rate)] = Field(default=0.0, description=RATE)
    interface: Literal["velocity", "position", "effort"] | None = Field(
        default=None, description=f"write one of {', '.join(INTERFACES)}"
    )
    servo: _Servo | None = Field(default=None, description="write a mapping, {...}")
    sensing: _Sensing | None = Field(default=None, description="write a mapping, {...}")
    object: _Object | None = Field(default=None, description="write a mapping, {...}")
    initial: _Initial | None = Field(default=None, description="write a mapping, {...}")
    units: dict[str, str] | None = Field(default=None, description='map columns to units, such as {"time": "us"}')
    uncertainty: dict[str, float] | None = Field(
        default=None, description='write columns or kinds and numbers, such as {"force": 0.02}'
    )
    gains: str | dict[str, Any] | None = Field(default=None, description="write gains, such as {kp: 50 ± 30 %}")
    base: Literal["fixed", "free"] | None = Field(default=None, description="write fixed or free")
    like: list[str] | None = Field(default=None, description="write what like parts begin with, such as [FL, FR]")
    tie: bool | None = Field(default=None, description="write true where like parts share their magnitudes")
    command_reference: Literal["measured"] | None = Field(default=None, description='write "measured", or leave it out')


def load_sidecar(path: Path) -> dict[str, Any]:
    """The mapping in a sidecar.

    Raises:
        RecordingError: it is no JSON object, or of another schema.
    """
    lead = f"{path.name}: the sidecar is not readable JSON"
    raw = load_json(path, lead, mend="mend or delete it", error=RecordingError)
    if not isinstance(raw, dict):
        raise RecordingError(f"{path.name}: the sidecar is no JSON object: write {{...}} with the recording's facts")
    schema = raw.get("schema", SCHEMA)
    if schema != SCHEMA:
        raise RecordingError(f"{path.name}: schema is {quoted(schema)}, this version reads {SCHEMA!r}")
    return raw


def parse_sidecar(raw: Mapping[str, Any], file: str, defaults: Mapping[str, Any] | None = None) -> Sidecar:
    """A sidecar from its mapping, missing entries from ``defaults``.

    Args:
        raw: as loaded; empty where there is no sidecar.
        file: for messages.
        defaults: the same keys, from the command line. The sidecar wins.

    Raises:
        RecordingError: a field is of the wrong kind.
    """
    merged = {key: value for key, value in (defaults or {}).items() if value is not None}
    merged.update({key: value for key, value in raw.items() if value is not None})
    if isinstance(merged.get("servo"), str):
        merged["servo"] = {"name": merged["servo"]}
    try:
        checked(_Written, merged)
    except SchemaError as fault:
        mend = f": {fault.mend}"
        if most := fault.limits.get("le", -fault.limits.get("ge", 0)):
            unit = fault.path.rpartition("_")[2]
            mend = f", more than {most:g} {unit}: is it in {unit}?"
        raise RecordingError(f"{file}: {fault.path} in the sidecar {fault.problem}{mend}") from fault
    initial = merged.get("initial")
    taken = ("interface", "servo", "sensing", "object", "units", *_FREE)
    others: dict[str, Any] = {key: merged.get(key) for key in taken}
    return Sidecar(
        trial=merged.get("trial", ""),
        robot=merged.get("robot", ""),
        rate_hz=float(merged.get("rate_hz", 0.0)),
        initial=initial and {part: {k: float(v) for k, v in by_joint.items()} for part, by_joint in initial.items()},
        raw={**raw, **_known_to(raw, merged, defaults or {})},
        **others,
    )


def _known_to(raw: Mapping[str, Any], merged: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """What values and the model's numbers are known to, whether its base is held, and which of its parts are alike: a
    map and the command line may say it beside a sidecar."""
    said = {**(defaults.get("uncertainty") or {}), **(raw.get("uncertainty") or {})}
    stated = {key: merged[key] for key in OF_MODEL if merged.get(key) is not None}
    return {**({"uncertainty": said} if said else {}), **stated}


def sidecar_mapping(sidecar: Sidecar) -> dict[str, Any]:
    """Mapping to be written: the fields, and other entries of the raw mapping."""
    fields = {
        key: getattr(sidecar, key)
        for key in (
            *("schema", "trial", "robot", "rate_hz", "interface", "servo", "sensing", "object", "initial"),
            *(*_FREE, "units"),
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
