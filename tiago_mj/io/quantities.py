"""Quantities for display: 0.5 mm rather than 0.0005 m, 30 ms rather than 0.03 s. Files keep SI units."""

from __future__ import annotations

import math
from typing import Final

#: Unit: the thousandth of it in which a reader expects small amounts, and below which amount.
SMALLER: Final = {
    "m": ("mm", 1.0),
    "s": ("ms", 1.0),
    "m/s": ("mm/s", 1.0),
    "rad": ("mrad", 0.1),
    "rad/s": ("mrad/s", 0.1),
    "kg": ("g", 0.1),
}
#: 90 % of a normal distribution lie within so many standard deviations.
NINETY: Final = 1.645
#: What stands for no unit.
BARE: Final = ("-", "–", "1", "")


def scaled(value: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a quantity of about ``value`` [unit] is displayed."""
    smaller, below = SMALLER.get(unit, ("", 0.0))
    return (1000.0, smaller) if 0 < abs(value) < below else (1.0, "" if unit in BARE else unit)


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A quantity with its unit, to so many significant digits: ``0.5 mm``."""
    factor, said = scaled(value, unit)
    return f"{bare(number(value * factor, digits))} {said}".rstrip()


#: Smaller amounts are what sums of floating-point numbers leave of nothing.
NOTHING: Final = 1e-9
#: Smaller amounts are written with a power of ten: a row of zeros is misread.
TINY: Final = 1e-6
_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 3) -> str:
    """To so many significant digits, with a true minus sign; a dash where nothing is known."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if abs(value) < NOTHING:
        return "0"
    if abs(value) < TINY:
        mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
        return f"{bare(mantissa.replace('-', '−'))}·10{str(int(power)).translate(_RAISED)}"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    return fixed(round(value, decimals), max(decimals, 0))


def fixed(value: float, decimals: int) -> str:
    """A number with fixed decimals and a typographic minus sign; zero has no sign."""
    text = f"{value + 0.0:.{decimals}f}"
    if float(text) == 0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def bare(text: str) -> str:
    """A number without trailing zeros."""
    if "·" in text:
        return text
    return text.rstrip("0").rstrip(".") if "." in text else text
