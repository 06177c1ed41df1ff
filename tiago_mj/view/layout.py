"""Layout of a view as text: the query of its address, which a person can read, edit and send to another.

Whatever is unknown or malformed in an address is left out; nothing in it is evaluated.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qsl

#: Parts of a layout, in the order in which an address has them.
KEYS: Final = (
    "recording", "time", "over", "joint", "policy", "speed", "paused", "effects", "where", "larger", "hidden", "camera",
)  # fmt: skip
#: Part that the browser writes itself: whether the panel is folded, where that is not what its window begins with.
PANEL: Final = "panel"
#: A longer address is no layout [characters].
LONGEST: Final = 4000
#: Effects that an address can have.
MAX_EFFECTS: Final = 16
#: What a value consists of, so that it stands in an address as it is.
SAFE: Final = re.compile(r"[A-Za-z0-9_.,:;~+-]+")
#: Digits of a number of an address.
DIGITS: Final = 6


@dataclass(frozen=True)
class EffectText:
    """An effect as an address has it: its name, the slug of its target's label, its values, whether it acts."""

    name: str
    target: str
    values: Mapping[str, float]
    acts: bool = True


def read(query: str) -> dict[str, str]:
    """Parts of a layout in the query of an address, with or without its question mark; those that are unusable are
    left out."""
    if len(query) > LONGEST:
        return {}
    try:
        # A plus of a number such as 1e+06 is no space here.
        pairs = parse_qsl(query.removeprefix("?").replace("+", "%2B"), max_num_fields=64)
    except ValueError:  # too many of them
        return {}
    return {key: value for key, value in pairs if key in (*KEYS, PANEL) and SAFE.fullmatch(value)}


def write(parts: Mapping[str, str]) -> str:
    """Query with the parts that are not empty, without the question mark."""
    return "&".join(f"{key}={parts[key]}" for key in KEYS if SAFE.fullmatch(parts.get(key, "")))


def slugs(labels: Sequence[str]) -> dict[str, str]:
    """Labels by what stands for them in an address; labels that would be alike there are numbered."""
    found: dict[str, str] = {}
    for number, label in enumerate(labels):
        plain = re.sub(r"[^a-z0-9_.]+", "-", label.lower()).strip("-")
        found[plain if plain and plain not in found else f"{plain}-{number}".strip("-")] = label
    return found


def slug(label: str, labels: Sequence[str]) -> str:
    """What stands for one of several labels in an address; empty where it is none of them."""
    return next((short for short, one in slugs(labels).items() if one == label), "")


def numbers(text: str, count: int) -> tuple[float, ...] | None:
    """So many finite numbers with commas between them; None where the text is no such."""
    try:
        values = tuple(float(one) for one in text.split(","))
    except ValueError:
        return None
    return values if len(values) == count and all(map(math.isfinite, values)) else None


def rounded(values: Sequence[float]) -> str:
    """Numbers with commas between them."""
    return ",".join(f"{value:.{DIGITS}g}" for value in values)


def write_effects(effects: Sequence[EffectText]) -> str:
    """Text of effects: ``name~target~width:0.002``, several with semicolons between them, ``~off`` after one that
    does not act."""
    said = []
    for one in effects:
        values = ",".join(f"{name}:{value:.{DIGITS}g}" for name, value in one.values.items())
        said.append(f"{one.name}~{one.target}~{values}{'' if one.acts else '~off'}")
    return ";".join(said)


def read_effects(text: str) -> tuple[EffectText, ...]:
    """Effects of a text as :func:`write_effects` gives it; those that are malformed are left out."""
    found = []
    for one in text.split(";")[:MAX_EFFECTS]:
        name, *rest = one.split("~")
        if len(rest) not in (2, 3) or rest[2:] not in ([], ["off"]):
            continue
        values = {}
        for pair in filter(None, rest[1].split(",")):
            parameter, _, value = pair.partition(":")
            number = numbers(value, 1)
            if number is not None:
                values[parameter] = number[0]
        found.append(EffectText(name, rest[0], values, acts=len(rest) == 2))
    return tuple(found)
