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
#: What drives report instead of a torque: amperes, or a converter's raw counts. What a motor makes of them a map says.
CURRENTS: Final[Mapping[str, float]] = MappingProxyType({"A": 1.0, "mA": 1e-3})
COUNTS: Final = "counts"
#: How to say what an effort's numbers are.
ASKED: Final = (
    "unit: Nm (or N), unit: A or mA with torque_constant (N·m per A of the motor) and ratio (of its gear), or unit: "
    "counts with scale (N·m per count, or A per count with torque_constant and ratio)"
)


def of_drive(unit: str, scale: float | None, constant: float | None, ratio: float | None) -> float:
    """N·m at the joint per A, mA or count of a drive.

    Args:
        unit: of :data:`CURRENTS`, or :data:`COUNTS`.
        scale: factor of the column; None: not said.
        constant: torque of the motor per current [N·m/A]; None: not said.
        ratio: of the gear between motor and joint; None: not said.

    Raises:
        ValueError: what the numbers cannot be converted without is not said; asks for it.
    """
    by_current = unit in CURRENTS or constant is not None or ratio is not None
    if by_current and (constant is None or ratio is None):
        raise ValueError(
            f"an effort in {unit} needs torque_constant (N·m per A of the motor) and ratio (of its gear, 1 where the "
            "constant is the joint's): give both"
        )
    if unit == COUNTS and scale is None:
        raise ValueError(
            "an effort in counts needs scale: N·m per count, or A per count with torque_constant and ratio"
        )
    return CURRENTS.get(unit, 1.0) * (scale or 1.0) * (constant or 1.0) * (ratio or 1.0)


def factor(kind: str, unit: str) -> float:
    """Factor from a unit to the SI unit of a kind of channel.

    Raises:
        ValueError: the unit is no unit of that kind; says which are.
    """
    known = FACTORS.get(kind, {})
    if unit not in known:
        more = "; of a drive's A, mA or counts the map (--map) says what they make" if kind == "effort" else ""
        raise ValueError(f"unit {quoted(unit)} of a {kind} is unknown: use one of {', '.join(known)}{more}")
    return known[unit]
