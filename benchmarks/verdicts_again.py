"""Cases of runs of the blind check, with the evidence that a verdict is a function of, and verdicts on them anew.

What :mod:`benchmarks.calibrate` fits the verdict's numbers to.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from benchmarks.blind import kept, score
from benchmarks.blind.score import Judged
from tiago_mj.gap.analysis import promises
from tiago_mj.gap.analysis.outcome import STRANGE
from tiago_mj.gap.decision.verdict import Calibration, Option, decide
from tiago_mj.gap.report.consistency import LEFT
from tiago_mj.gap.result import FitQuality

#: Notes of kept answers, which are worded as they were then, and what they are now.
EARLIER: Final = {
    "What fits the other recordings best closes nothing of the gap on those that were kept aside: it is not "
    "named.": promises.CLOSES_NOTHING,
    "What fits the other recordings best closes nothing on those that were kept aside, where the simulator's own "
    "numbers leave no gap: it is not named.": promises.NOTHING_TO_CLOSE,
    "The simulator's own numbers, moved within what they are known to, explain the recordings to which they were "
    "fitted and not those that were kept aside.": promises.NOT_THOSE_ASIDE,
}


@dataclass(frozen=True)
class Case:
    """A diagnosed case of a run.

    Attributes:
        label: the truth.
        answer: the diagnosis.
        options: its explanations, as the verdict sees them.
        betrayed: whether all of them hold an effect that the readings betray.
    """

    label: Mapping[str, Any]
    answer: Mapping[str, Any]
    options: tuple[Option, ...]
    betrayed: bool

    @property
    def truths(self) -> set[frozenset[str]]:
        """What is right, by classes; of an effect that does not show it is right to see nothing, too."""
        true = frozenset(score.classes(self.label["effects"]))
        return {true} if self.label["oracle"]["detectable"] else {true, frozenset()}

    @property
    def explainable(self) -> bool:
        """Whether the library holds the truth."""
        return self.label["kind"] in ("none", "one", "two")

    @property
    def looked_at(self) -> bool:
        """Whether the truth is among the explanations."""
        return any(option.classes in self.truths for option in self.options)


def case(label: Mapping[str, Any], answer: Mapping[str, Any]) -> Case | None:
    """A case from its files; None where the diagnosis stored no evidence."""
    ranking = answer.get("ranking", [])
    if not ranking or any(one.get("evidence") is None for one in ranking):
        return None
    named = [frozenset(_named(effect) for effect in one["effects"]) for one in ranking]
    known = frozenset.intersection(*named)
    options = tuple(
        Option(effects - known, frozenset(score.classes(one["effects"])), FitQuality(**one["evidence"]))
        for effects, one in zip(named, ranking, strict=True)
    )
    return Case(label, answer, options, bool(known)) if any(not option.effects for option in options) else None


def _named(effect: Mapping[str, Any]) -> tuple[str, tuple[str, ...] | None]:
    target = effect.get("target", "all")
    if target == "all":
        return effect["name"], None
    return effect["name"], (target,) if isinstance(target, str) else tuple(target)


def read(root: Path) -> tuple[list[Case], dict[str, Any]]:
    """Cases of a finished run, or of one that was kept (:mod:`benchmarks.blind.kept`), and what it was.

    Raises:
        ValueError: the run is not finished.
    """
    if root.is_file():
        file = kept.load(root)
        run = {**file["run"], "seal": file["seal"]}
        rows = [case(row["label"], row["answer"]) for row in file["cases"] if row["answer"] is not None]
        run["used"] = sum(one is not None for one in rows)
        return [one for one in rows if one is not None], run
    if not (root / "labels.json").exists():
        raise ValueError(
            f"{root.name}/labels.json is missing: finish the run first (python -m benchmarks.blind … --out {root.name})"
        )
    labels = json.loads((root / "labels.json").read_text())
    run = json.loads((root / ".sealed" / "run.json").read_text())
    run["seal"] = (root / "seal.txt").read_text().split()[0]
    found = []
    for number, label in labels.items():
        path = root / "cases" / number / "diagnosis" / "diagnosis.json"
        if path.exists():
            found.append(case(label, json.loads(path.read_text())))
    run["used"] = sum(one is not None for one in found)
    return [one for one in found if one is not None], run


def _leaves_a_gap(shrink: Mapping[str, Any]) -> bool:
    """As :func:`tiago_mj.gap.report.consistency.leaves_a_gap`, of what is stored; kept answers may have no numbers."""
    left = shrink.get("accounted")
    return left is not None and left > LEFT and not any(name.startswith("force.") for name in shrink["per_channel"])


def again(one: Case, by: Calibration) -> Judged:
    """A case as it would be answered with other numbers."""
    said = promises.standing(decide(one.options, by, measured_on_readings=one.betrayed), one.options, by)
    ranking = one.answer["ranking"]
    notes = {EARLIER.get(note, note) for note in one.answer.get("notes", ())}
    if {promises.CLOSES_NOTHING, promises.NOTHING_TO_CLOSE} & notes:  # of trials kept aside, which are not stored
        said = replace(
            said, kind="no_gap", rivals=(next(k for k, option in enumerate(one.options) if not option.effects),)
        )
    gave_way = {promises.CLOSES_NOTHING, promises.SMALLER_PART, promises.NOT_THOSE_ASIDE} & notes
    loud = said.kind == "no_gap" and _leaves_a_gap(one.answer["shrink"])  # of trials kept aside, too
    unknown = bool(gave_way) or loud or any(STRANGE in note for note in notes)
    best = said.rivals[0]
    named = [k for k in said.rivals if ranking[k]["effects"]]
    told = {
        **one.answer["verdict"],
        "kind": "unknown" if unknown else said.kind,
        "effects": [{**effect, "parameters": {}} for effect in ranking[best]["effects"]],
        "probability": float(said.probability[best]),
        "evidence": ranking[best]["evidence"],
        "alternatives": [{"effects": ranking[k]["effects"]} for k in named],
        "remains": {"flag": said.remains and said.kind != "no_gap"},
    }
    return Judged(one.label, {**one.answer, "verdict": told})
