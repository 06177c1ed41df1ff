"""A case of the truth ladder again, from what the ladder kept of it: no search is repeated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.experiments import results
from benchmarks.experiments.kept_cases import Kept
from benchmarks.experiments.opened import Opened, judge, open_case, with_scatter
from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.search import beginning

#: Rungs that are begun again: what a search may name, and the best of the truth.
WANTED = ("nominal", "truth", "from_truth", "from_name", "part", "answer")


@dataclass(frozen=True)
class Again:
    """A case, what judges its explanations, and where those of the ladder ended.

    Attributes:
        opened: the case.
        by: the ladder's fitter, before the tolerance of what nothing tells apart.
        starts: of each set of effects the best, by the ladder's name of it.
    """

    opened: Opened
    by: Fitter
    starts: dict[str, Start]

    def tolerant(self) -> Fitter:
        """With that tolerance, as the ladder had it."""
        nominal = self.starts["nominal"]
        assert nominal.nuisance is not None
        at = Fitted((), np.zeros(0), np.zeros(0), nominal.nuisance, 0.0, 0.0)
        plain = replace(self.by, iterations=0).fit_all([nominal])[0]
        return with_scatter(self.by, at) if plain.misfit < beginning.HOPELESS_NOMINAL_MISFIT else self.by


def again(kept: Kept) -> Again:
    """Open a case that the ladder has climbed.

    Raises:
        ValueError: it has not.
    """
    ladder = "without_effect" if kept.label["kind"] == "none" else "truth_ladder"
    rows = results.load(ladder)
    if kept.name not in rows:
        raise ValueError(f"{kept.name}: run `python -m benchmarks.experiments.{ladder} {kept.name}` first")
    row = rows[kept.name]
    opened = open_case(kept)
    predict = replace(opened.predict, corrected=row["corrected"])
    by = judge(opened, predict, np.array(row["weight"]), row["trials"])
    return Again(opened, by, _starts(opened, row["rungs"]))


def _starts(opened: Opened, rungs: Mapping[str, Any]) -> dict[str, Start]:
    best: dict[object, tuple[float, str, Start]] = {}
    for name, rung in rungs.items():
        if name not in WANTED and not name.startswith("rival"):
            continue
        parts = tuple(_part(opened, *one) for one in rung["parts"])
        start = Start(parts, np.array(rung["values"]), np.array(rung["nuisance"]))
        key = frozenset(part.label for part in parts)
        if key not in best or rung["evidence"] > best[key][0]:
            best[key] = rung["evidence"], name, start
    return {name: start for _, name, start in best.values()}


def _part(opened: Opened, name: str, target: Any, fixed: Mapping[str, float]) -> Candidate:
    mine = opened.candidates(name, None if target is None else tuple(target))
    return replace(mine[0], fixed=tuple((key, fixed[key]) for key, _ in mine[0].fixed))
