"""Schemas of files: what one may hold is declared once, and the first thing that is wrong becomes one line.

pydantic, not msgspec: its errors are data (key, value, rule), where msgspec's are a sentence that does not name a
mapping's key; and a dozen people keep it, where msgspec has one. Its price, 11 MB and 0.2 s, is paid when it is needed.

A field's ``description`` is the mend with which a complaint of it ends: ``write a positive number``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Annotated, Any, Final, TypeVar, get_args, get_origin

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from tiago_mj.io.quoting import QUOTED, did_you_mean, is_one_of, quoted

M = TypeVar("M", bound=BaseModel)
#: How alike a key must be to one that is known, to be taken for a slip: ``rate_Hz``, ``radius``.
ALIKE: Final = 0.85
#: Of so many unknown keys no slip is sought.
_MANY: Final = 100


class Open(BaseModel):
    """Schema of a mapping with room for the user's own keys, except misspellings of known ones."""

    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False, protected_namespaces=())

    @model_validator(mode="before")
    @classmethod
    def _without_slips(cls, given: Any) -> Any:
        known = {field.alias or name for name, field in cls.model_fields.items()}
        if isinstance(given, Mapping) and cls.model_config["extra"] == "allow" and len(given) < _MANY:
            for key in given:
                if key in known or not isinstance(key, str) or len(key) > QUOTED:
                    continue
                if get_close_matches(key.lower(), known, 1, ALIKE):
                    raise PydanticCustomError("slip", "slip", {"key": key})
        return given


class Closed(Open):
    """Schema of a mapping without other keys."""

    model_config = ConfigDict(extra="forbid")


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


#: A number as Python's callers give it, NumPy's among them; booleans and text are none.
Number = Annotated[float, BeforeValidator(_plain)]
#: The same or an infinite one, or NaN.
Endless = Annotated[float, Field(allow_inf_nan=True), BeforeValidator(_plain)]


class SchemaError(ValueError):
    """The first fault of a file, ``object.radius_m is 'wide': write a positive number``, and its parts.

    Attributes:
        where: keys and places, such as ``("object", "radius_m")``; empty for the whole.
        path: the same as text, ``object.radius_m``.
        problem: ``is 'wide'``, ``is missing`` or ``is unknown``.
        mend: what to write.
        limits: of the rule that was broken, such as ``{"le": 0.25}``.
    """

    def __init__(self, where: Sequence[Any], problem: str, mend: str, limits: Mapping[str, Any]) -> None:
        self.where, self.path = tuple(where), "".join(map(_step, where)).removeprefix(".")
        self.problem, self.mend, self.limits = problem, mend, limits
        super().__init__(f"{self.path} {problem}: {mend}".lstrip())


def checked(model: type[M], given: Any, mend: str = "write a mapping, {...}") -> M:
    """A value that was read, validated by a model.

    Args:
        model: the form.
        given: dicts, lists, text, numbers, booleans and None.
        mend: what to write where it is no mapping at all.

    Raises:
        SchemaError: it has another form.
    """
    try:
        return model.model_validate(given)
    except ValidationError as error:
        first = _first(error, given)
    kind, limits = first["type"], first.get("ctx") or {}
    where, value = _walk(given, first)
    inner: type[BaseModel] | None = model
    levels = 0
    known: list[str] = []
    for part in where:
        known = _names(inner) if inner is not None and not levels else []
        if levels:
            levels -= 1
        elif inner is not None and part in known:
            field = next(field for name, field in inner.model_fields.items() if part in (name, field.alias))
            mend = field.description or mend
            levels, inner = _within(field.annotation)
    if kind == "missing":
        raise SchemaError(where, "is missing", mend, {})
    if kind == "slip" or (kind == "extra_forbidden" and known):
        raise SchemaError(where, "is unknown", did_you_mean(where[-1], known), {})
    raise SchemaError(where, f"is {quoted(value)}", mend, limits)


def first_fault(error: ValidationError, given: Any) -> SchemaError:
    """The first thing that is wrong with what was read, without what to write instead."""
    first = _first(error, given)
    where, value = _walk(given, first)
    return SchemaError(where, "is missing" if first["type"] == "missing" else f"is {quoted(value)}", "", {})


def _first(error: ValidationError, given: Any) -> Mapping[str, Any]:
    """Of several forms that a field may have, each has its complaint: that of the one which fits farthest counts."""
    errors: list[Any] = error.errors(include_url=False)
    return max(
        (one for one in errors if one["loc"][:1] == errors[0]["loc"][:1]), key=lambda one: len(_walk(given, one)[0])
    )


def _walk(given: Any, error: Mapping[str, Any]) -> tuple[list[Any], Any]:
    """Path to an error of pydantic's in the file, without its names for types (``float``), and the value there."""
    where: list[Any] = []
    location = [*error["loc"], *([error["ctx"]["key"]] if error["type"] == "slip" else [])]
    for part in location:
        there = range(len(given)) if isinstance(given, (list, tuple)) else given if isinstance(given, Mapping) else ()
        if is_one_of(part, there):
            where.append(part)
            given = given[part]
    return where + location[-1:] * (error["type"] == "missing"), given


def _names(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items()]


def _within(annotation: Any) -> tuple[int, type[BaseModel] | None]:
    """The model in a field's type, and in how many dicts and lists it lies."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return 0, annotation
    held = get_origin(annotation) in (dict, list, tuple, Mapping, Sequence)
    found = [_within(part) for part in get_args(annotation)]
    levels, model = next((one for one in reversed(found) if one[1] is not None), (0, None))
    return levels + held, model


def _step(part: Any) -> str:
    if isinstance(part, int):
        return f"[{part}]"
    return f".{part if isinstance(part, str) and part.isprintable() and len(part) <= QUOTED else quoted(part)}"
