"""Numbers as the formats of simulators write them."""

from __future__ import annotations

from typing import Final

#: Digits that are written: what is rounded in the last ones is 0.3 and not 0.30000000000000004.
DIGITS: Final = 15


def numbers(*values: float) -> str:
    """Numbers as text, separated by blanks: the fewest digits that give back each to fifteen."""
    return " ".join(number(value) for value in values)


def number(value: float) -> str:
    """A number as text; whole ones without a point."""
    rounded = float(f"{float(value):.{DIGITS}g}")
    return f"{int(rounded)}" if rounded == int(rounded) and abs(rounded) < 1e15 else repr(rounded)
