"""Whether older versions of MuJoCo know every element and attribute of a file, by their own schemas."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Final

from tiago_mj.export.mjcf_text import Element, Mjcf

#: Versions that files are written for; the newest is the one that this package simulates with.
NEWEST: Final = "4.0"
VERSIONS: Final = ("3.11", "3.17", NEWEST)
#: Elements whose children are a body's.
_BODIES: Final = ("worldbody", "body", "frame", "replicate")


def check(file: Path, version: str) -> None:
    """Refuse a file that has what a version of MuJoCo does not know.

    Args:
        file: the main file.
        version: one of :data:`VERSIONS`.

    Raises:
        ValueError: it has; one line that names the elements and attributes.
    """
    if version == NEWEST:
        return
    newer = _newer()[version]
    unknown: dict[str, None] = {}
    for element in Mjcf(file).elements:
        key = _key(element)
        if key in newer:
            unknown[f"<{element.name}>"] = None
        unknown |= {f"{name} of <{element.name}>": None for name in element.attributes if f"{key}@{name}" in newer}
    if unknown:
        raise ValueError(
            f"{file.name} has {', '.join(unknown)}, which MuJoCo {version} does not know: take it away in your file, "
            "or use a newer MuJoCo"
        )


def _key(element: Element) -> str:
    """As the schema lists an element: its parent's name and its own."""
    above = element.parent.name if element.parent is not None else ""
    if above in _BODIES:
        above = "(world)body"
    own = "(world)body" if element.name in _BODIES[:2] else element.name
    return f"{above}/{own}"


@cache
def _newer() -> dict[str, frozenset[str]]:
    """What each version lacks; made by tests/export/make_newer.py of the versions' own schemas."""
    said = json.loads((Path(__file__).parent / "newer.json").read_text())
    return {version: frozenset(names) for version, names in said.items()}
