"""Colours of the robots and of what is marked, alike in scenes, curves, pages and stills.

Measured, nominal and repaired have the colours that they have in ``report.html``, and a colour means one thing
everywhere. They are Okabe and Ito's (2008), which every kind of colour vision tells apart; what is lit has one of its
own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """Name, colour and opacity of one of several robots.

    Attributes:
        name: for the legend.
        colour: of its curves and its swatch, as hexadecimal digits.
        opacity: of its body, from 0 to 1.
    """

    name: str
    colour: str
    opacity: float


LOOKS: Final[Mapping[str, Look]] = MappingProxyType(
    {
        "measured": Look("measured", "#1a1f26", 1.0),
        "nominal": Look("nominal simulator", "#d55e00", 0.42),
        "repaired": Look("repaired simulator", "#0072b2", 0.24),
    }
)
#: What is lit: the joint or finger that the diagnosis names, and the place of the gap on the time line.
LIT: Final = "#d6007f"
#: Fingers and the forces on their pads, right and left; points of contact; a goal.
RIGHT: Final = "#009e73"
LEFT: Final = "#cc79a7"
CONTACT: Final = "#f0e442"
GOAL: Final = "#56b4e9"

#: A measured curve in a chart of a view, and text beside it: on white as well as on a dark panel they can be read.
CURVE: Final = "#7b838c"
SOFT: Final = "var(--mantine-color-dimmed)"
WARNING: Final = "light-dark(#b04a00, #f2995c)"


def in_charts(role: str) -> str:
    """Colour of a robot's curves in the charts of a view, whose panel is light or dark."""
    return CURVE if role == "measured" else LOOKS[role].colour


def rgb(colour: str) -> Colour:
    """Red, green and blue from 0 to 1 of ``#rrggbb``."""
    value = int(colour.removeprefix("#"), 16)
    return (value >> 16) / 255, (value >> 8 & 255) / 255, (value & 255) / 255


def rgb255(colour: str) -> tuple[int, int, int]:
    """Red, green and blue from 0 to 255 of ``#rrggbb``."""
    value = int(colour.removeprefix("#"), 16)
    return value >> 16, value >> 8 & 255, value & 255


def mixed(one: Colour, other: Colour, share: float) -> Colour:
    """Mixture of two colours with ``share`` of the second."""
    a, b, c = (x + share * (y - x) for x, y in zip(one, other, strict=True))
    return a, b, c


def grey(colour: Colour) -> Colour:
    """A light grey of about the same brightness, for the body of a robot on which something is lit."""
    level = 0.45 + 0.42 * (0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2])
    return level, level, level
