"""Values as Python source."""

from __future__ import annotations

import math
from collections.abc import Mapping

from tiago_mj.export.numbers import number


def literal(value: float | None) -> str:
    """A number as Python source; infinity and None as None."""
    if value is None or math.isinf(value):
        return "None"
    text = number(value)
    return text if any(sign in text for sign in ".en") else f"{text}.0"


def by_name(values: Mapping[str, float], indent: str) -> str:
    """A dictionary of numbers as Python source, one to a line; those that are infinite are left out."""
    finite = {name: value for name, value in values.items() if math.isfinite(value)}
    if not finite:
        return "None"
    lines = "".join(f"{indent}    {name!r}: {literal(value)},\n" for name, value in finite.items())
    return f"{{\n{lines}{indent}}}"


def steps(seconds: float, step: float) -> int:
    """A time in whole physics steps."""
    return max(round(seconds / step), 0)
