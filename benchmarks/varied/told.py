"""What the comment above numbers says of them once they were varied."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

RESULTS: Final = Path(__file__).resolve().parents[1] / "results"
#: What answers are about, by the name of the result.
ABOUT: Final = {
    "varied.json": "hinges",
    "varied_pairs.json": "pairs of sessions",
    "varied_grasps.json": "grasps",
    "varied_efforts.json": "efforts",
}
#: A sentence of a comment, by what came of it.
UNCHANGED: Final = "Halved and doubled, none of {tried} answers about {about} changes ({file})."
CHANGED: Final = (
    "Halved and doubled, {changed} of {tried} answers about {about} change, {mended} to right, {broken} to wrong "
    "({file})."
)


def tallies(path: Path) -> dict[str, dict[str, Any]]:
    """Of every number that was varied, ``tried``, ``changed``, ``mended``, ``broken``: halved and doubled together."""
    found: Mapping[str, Mapping[str, Mapping[str, Any]]] = json.loads(path.read_text())["results"]["numbers"]
    return {
        name: _sum([{**one, "changed": len(one["changed"])} for one in both.values()]) for name, both in found.items()
    }


def sentence(some: Iterable[Mapping[str, int]], file: str = "varied.json") -> str:
    """Of the numbers under one comment, by their tallies in a result file."""
    total = _sum(some)
    return (CHANGED if total["changed"] else UNCHANGED).format(**total, about=ABOUT[file], file=file)


def _sum(some: Iterable[Mapping[str, int]]) -> dict[str, int]:
    rows = list(some)
    return {key: sum(row[key] for row in rows) for key in ("tried", "changed", "mended", "broken")}
