"""What is answered with other numbers: recordings of a blind check's run, or pairs of sessions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks import changed_pairs
from benchmarks.blind import efforts, plan, robots, run, score
from benchmarks.blind.cases import Case
from benchmarks.blind.store import Store
from tiago_mj.change.result import FILE_NAME


@dataclass(frozen=True)
class Answer:
    """What is compared of an answer.

    Attributes:
        kind: of the verdict.
        classes: that the best explanation names.
        right: by the label.
    """

    kind: str
    classes: tuple[str, ...]
    right: bool


class Diagnoses:
    """Of a run of the blind check, those that were answered with ``--jobs 1`` by this checkout.

    Attributes:
        drawn: what decides the run's recordings.
        cases: that are answered.
    """

    def __init__(self, root: Path) -> None:
        """Read the run that lies there."""
        self._store = Store(root)
        self.drawn: dict[str, Any] = self._store.run()
        self._planned = _planned(self.drawn)
        self.cases = [k for k in range(self.drawn["cases"]) if self._store.answer(k) is not None]

    def unchanged(self, case: int) -> Answer:
        """As the run has it."""
        return self._judged(case, self._store.answer(case))

    def answered(self, case: int, changed: Sequence[str], folder: Path) -> Answer:
        """By a command that changes numbers, followed by what is given to ``tiago-mj``; writes to a folder."""
        words = run.Diagnoser(jobs=1).command(self._planned[case], self._store.recordings(case), folder)
        return self._judged(case, _called([*changed, *words[words.index("diagnose") :]], folder / "diagnosis.json"))

    def _judged(self, case: int, answer: Mapping[str, Any] | None) -> Answer:
        judged = score.Judged(json.loads(self._store.label_file(case).read_text()), answer)
        return Answer(judged.verdict, judged.best or (), bool(score.right(judged)))


class Comparisons:
    """Of the pairs of :mod:`benchmarks.changed_pairs`, those that this checkout answered.

    Attributes:
        drawn: seed and number of pairs are in the result of that command.
        cases: that are answered.
    """

    def __init__(self, root: Path) -> None:
        """Read the pairs that lie there."""
        self._root = root
        self.cases = sorted(int(path.parent.name) for path in root.glob("*/answer.json"))
        self.drawn: dict[str, Any] = {"pairs": len(self.cases)}

    def unchanged(self, case: int) -> Answer:
        """As it was answered."""
        return self._judged(case, json.loads((self._folder(case) / "answer.json").read_text()))

    def answered(self, case: int, changed: Sequence[str], folder: Path) -> Answer:
        """As of :meth:`Diagnoses.answered`."""
        here = self._folder(case)
        words = ["compare", here / "before", here / "after", "--model", here / robots.PLAIN_FILE]
        command = [*changed, *map(str, words), "--jobs", "1", "--out", str(folder)]
        return self._judged(case, _called(command, folder / FILE_NAME))

    def _judged(self, case: int, answer: Mapping[str, Any] | None) -> Answer:
        if answer is None:
            return Answer("failed", (), False)
        label = json.loads((self._folder(case) / "label.json").read_text())
        named = tuple(sorted(changed_pairs.classes(answer["best"])))
        return Answer(answer["kind"], named, changed_pairs.outcome(label, answer) == "right")

    def _folder(self, case: int) -> Path:
        return self._root / f"{case:03d}"


def _planned(drawn: Mapping[str, Any]) -> Sequence[Case]:
    """The cases of a run."""
    if drawn.get("efforts"):
        return efforts.cases(drawn["cases"], drawn["seed"], drawn["kinds"])
    names = ("settings", "rates", "trials", "seconds")
    return plan.plan(drawn["cases"], drawn["seed"], only=drawn["kinds"], **{name: drawn[name] for name in names})


def _called(command: Sequence[str], written: Path) -> dict[str, Any] | None:
    """What a command writes; None, and its last line printed, where it fails."""
    status, said = run.call_command(list(command))
    if status:
        print(f"exit status {status}: {said.strip().splitlines()[-1:]}", flush=True)
        return None
    return dict(json.loads(written.read_text()))
