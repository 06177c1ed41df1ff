"""What a diagnosis is not sure of: other explanations, whose cost is told beside the best one's, and sentences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tiago_mj.effects import written
from tiago_mj.export.found import calibration_file
from tiago_mj.gap.report.json import NAME, load
from tiago_mj.gap.result import Result
from tiago_mj.policy_cost.magnitudes import NUMBERS, Item, items_of


def result_of(given: Any) -> Result | None:
    """The whole result of what was given as a diagnosis, where it is one or lies beside its calibration.

    Raises:
        ValueError: the file beside the calibration is unusable; one line.
    """
    if isinstance(given, Result):
        return given
    if not isinstance(given, (str, Path)) or written.is_json(given):
        return None
    path = calibration_file(Path(given)).with_name(NAME)
    return load(path) if path.is_file() else None


def others_of(result: Result | None, items: Sequence[Item]) -> tuple[tuple[Item, ...], ...]:
    """Explanations that the recordings cannot tell from the best, each with what was known before the diagnosis.

    Args:
        result: of :func:`result_of`.
        items: of the best, from its calibration.
    """
    if result is None:
        return ()
    best = {item.label for item in items_of(list(result.best.effects))} if result.best.effects else set()
    known = tuple(item for item in items if item.label not in best and item.name != NUMBERS)
    others = [one.effects for one in result.alternatives if one.effects != result.verdict.effects]
    return tuple((*(items_of(list(effects)) if effects else ()), *known) for effects in others)


def sentences(result: Result | None) -> list[str]:
    """What a reader should know of a diagnosis before acting on what its effects cost."""
    if result is None:
        return []
    said = []
    if not result.complete:
        said.append("The diagnosis was ended before its end: what it names is provisional.")
    if result.remains or result.verdict.part:
        said.append("A part of the gap has no name; what that costs is not among these numbers.")
    return said
