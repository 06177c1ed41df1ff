"""What users write of effects, in the form that it must have; which effects and parameters there are is declared."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field

from tiago_mj.io.loading import is_file, load_yaml, parse_json
from tiago_mj.io.quoting import quoted, unquoted
from tiago_mj.io.schema import Closed, Endless, Open, SchemaError, checked

SCHEMA: Final = "tiago_mj.calibration/1"
_NUMBER: Final = "give a number"


class _Fitted(Open):
    value: Endless


class _Entry(Closed):
    target: str | list[str] = Field(default="all", min_length=1, description="give a name, a list of names, or 'all'")
    parameters: dict[str, Endless | _Fitted] | None = Field(
        default=None, description="give a mapping of names to numbers"
    )


class _Calibration(Open):
    robot: str = Field(default="", description="write text")
    rate_hz: float | None = Field(default=None, gt=0, le=1e6, description="write a positive number [Hz]")
    interface: Literal["velocity", "position", "effort"] | None = Field(
        default=None, description="write velocity, position or effort"
    )
    timestep: float | None = Field(default=None, ge=1e-6, le=1, description="write a time from 1e-6 to 1 s")
    joints: list[str] | None = Field(default=None, description="write a list of names")
    actuators: list[str] | None = Field(default=None, description="write a list of names")
    effects: list[Any] | None = Field(default=None, description="write a list of effects")
    numbers: list[Any] | None = Field(default=None, description="write a list of numbers, each as an effect")


def load(source: str | Path) -> Any:
    """What JSON text or a YAML file holds.

    Raises:
        ValueError: it is neither, or there is no such file; one line.
    """
    if is_json(source):
        return parse_json(str(source), "effects are no valid JSON")
    path = Path(source)
    if not is_file(source):
        raise ValueError(
            f"no calibration file {quoted(str(source))}: give the path of a calibration.yaml, or effects as JSON"
        )
    return load_yaml(path, f"calibration {path.name} is no valid YAML")


def is_json(source: Any) -> bool:
    """Whether it is text of a list or mapping."""
    return isinstance(source, str) and source.lstrip().startswith(("{", "["))


def calibration(given: Mapping[str, Any]) -> Mapping[str, Any]:
    """A calibration whose parts have the right form; its effects are looked at one by one, by :func:`entry`.

    Raises:
        ValueError: one line.
    """
    if given["schema"] != SCHEMA:
        raise ValueError(f"calibration has schema {quoted(given['schema'])}: this version reads {SCHEMA!r}")
    try:
        checked(_Calibration, given)
    except SchemaError as fault:
        raise ValueError(f"calibration: {fault}") from fault
    return given


def without_numbers(given: Any) -> Any:
    """A calibration as it is loaded, without the nominal model's numbers as fitted; anything else as it is."""
    if not (isinstance(given, Mapping) and "schema" in given):
        return given
    return {key: value for key, value in given.items() if key != "numbers"}


def entry(name: str, given: Mapping[str, Any]) -> tuple[tuple[str, ...] | None, dict[str, float], bool]:
    """Target, parameters by name, and whether a diagnosis found them, of one effect.

    Args:
        name: of the effect.
        given: what stands beside it.

    Raises:
        ValueError: something has another form; one line.
    """
    try:
        said = checked(_Entry, given)
    except SchemaError as fault:
        part, *inner = fault.where or ("parts",)
        what = f" has {part} {fault.problem.removeprefix('is ')}: {fault.mend}"
        if inner and part == "parameters":
            what = f": {unquoted('.'.join(map(str, inner)))} {fault.problem}, {_NUMBER}"
        elif fault.problem == "is unknown":
            what = f" has an unknown key {quoted(part)}: use name, target, parameters"
        raise ValueError(f"effect {name!r}{what}") from fault
    target = said.target if isinstance(said.target, list) else [said.target]
    parameters = said.parameters or {}
    values = {key: one.value if isinstance(one, _Fitted) else one for key, one in parameters.items()}
    fitted = any(isinstance(one, _Fitted) for one in parameters.values())
    return None if target == ["all"] and said.target == "all" else tuple(target), values, fitted
