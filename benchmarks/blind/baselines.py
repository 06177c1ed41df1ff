"""Baselines that a diagnosis must beat, scored on the same cases by the same rules.

* ``most_frequent``: whatever is recorded, the class of effect that this run's single effects have most often; it knows
  the labels' mix, which no diagnosis does.

Other baselines leave an answer of the diagnosis's form in ``cases/NNN/baselines/NAME.json``, scored under that name.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from typing import Any

from benchmarks.blind.score import Judged, class_of, score
from benchmarks.blind.store import Store


def most_frequent(judged: Sequence[Judged]) -> list[Judged]:
    """The same answer to every case: the commonest effect of the commonest class, as often right as it is common."""
    single = [j.label["effects"][0]["name"] for j in judged if j.kind == "one"]
    if not single:
        return [Judged(j.label, _answer([], 1.0)) for j in judged]
    by_class = Counter(class_of(name) for name in single)
    commonest = by_class.most_common(1)[0][0]
    name = Counter(n for n in single if class_of(n) == commonest).most_common(1)[0][0]
    share = sum(j.kind == "one" and class_of(j.label["effects"][0]["name"]) == commonest for j in judged) / len(judged)
    return [Judged(j.label, _answer([{"name": name, "target": "all", "parameters": {}}], share)) for j in judged]


def answers(store: Store, number: int) -> dict[str, dict[str, Any]]:
    """What other methods answered to a case, by their names."""
    return {
        path.stem: json.loads(path.read_text()) for path in sorted((store.case(number) / "baselines").glob("*.json"))
    }


def scores(judged: Sequence[Judged], store: Store) -> dict[str, Any]:
    """Scores of every baseline that there is, by name."""
    theirs: dict[str, list[Judged]] = {"most_frequent": most_frequent(judged)}
    for number, j in enumerate(judged):
        for name, answer in answers(store, number).items():
            theirs.setdefault(name, []).append(Judged(j.label, answer))
    return {name: score(those) for name, those in sorted(theirs.items())}


def _answer(effects: list[dict[str, Any]], probability: float) -> dict[str, Any]:
    verdict = {
        "kind": "effect" if effects else "no_gap",
        "effects": effects,
        "probability": probability,
        "alternatives": [],
        "not_excited": [],
    }
    return {"verdict": verdict, "shrink": {"closed": 0.0}, "seconds": 0.0}
