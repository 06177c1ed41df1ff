"""What the comment above numbers says of them once they were varied."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

RESULT: Final = Path(__file__).resolve().parents[1] / "results" / "varied.json"
#: A sentence of a comment, by what came of it.
UNCHANGED: Final = "Halved and doubled, none of {tried} answers about hinges changes (varied.json)."
CHANGED: Final = (
    "Halved and doubled, {changed} of {tried} answers about hinges change, {mended} to right, {broken} to wrong "
    "(varied.json)."
)


def tallies(path: Path = RESULT) -> dict[str, dict[str, Any]]:
    """Of every number that was varied, ``tried``, ``changed``, ``mended``, ``broken``: halved and doubled together."""
    found: Mapping[str, Mapping[str, Mapping[str, Any]]] = json.loads(path.read_text())["results"]["numbers"]
    return {
        name: _sum([{**one, "changed": len(one["changed"])} for one in both.values()]) for name, both in found.items()
    }


def sentence(some: Iterable[Mapping[str, int]]) -> str:
    """Of the numbers under one comment, by their tallies."""
    total = _sum(some)
    return (CHANGED if total["changed"] else UNCHANGED).format(**total)


def _sum(some: Iterable[Mapping[str, int]]) -> dict[str, int]:
    rows = list(some)
    return {key: sum(row[key] for row in rows) for key in ("tried", "changed", "mended", "broken")}
