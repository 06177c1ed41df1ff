"""Conversion factors from units of recordings to SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from tiago_mj.io.quoting import quoted

_DEGREE: Final = math.pi / 180

#: Unit: factor to s, m, rad, N, N·m or their rates. Force channels are in sensor units, which have no factor.
_TIME: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_PLACE: Final = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "rad": 1.0, "mrad": 1e-3, "deg": _DEGREE}
_RATE: Final = {f"{unit}/s": factor for unit, factor in _PLACE.items()} | {"rpm": 2 * math.pi / 60}
_EFFORT: Final = {"N": 1.0, "mN": 1e-3, "Nm": 1.0, "N·m": 1.0, "N*m": 1.0, "mNm": 1e-3, "mN·m": 1e-3, "N·mm": 1e-3}
FACTORS: Final[Mapping[str, Mapping[str, float]]] = MappingProxyType(
    {
        "time": _TIME,
        "position": _PLACE,
        "velocity": _RATE,
        "effort": _EFFORT,
        "command": _PLACE | _RATE | _EFFORT,
        "force": {"sensor units": 1.0},
    }
)


def factor(kind: str, unit: str) -> float:
    """Factor from a unit to the SI unit of a kind of channel.

    Raises:
        ValueError: the unit is no unit of that kind; says which are.
    """
    known = FACTORS.get(kind, {})
    if unit not in known:
        raise ValueError(f"unit {quoted(unit)} of a {kind} is unknown: use one of {', '.join(known)}")
    return known[unit]
