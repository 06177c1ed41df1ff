"""Do answers depend on the numbers that have no source? Each is halved and doubled on kept cases.

    python -m benchmarks.blind --cases 100 --seed 3737 --settings plain --out RUN --jobs 1
    python -m benchmarks.varied RUN --passes 8 --out VARIED

Several numbers are changed at once (group testing, Dorfman 1943): where the answer, its kind and the classes that it
names, is as before, none of them decided it; where it is another one, the group is cut into halves until single numbers
are left that change it alone. A pass changes every number twice, each time in another case. ``VARIED`` keeps every
answer as it is made and goes on where it stopped; ``results/varied.json`` tells of each number how often it was
halved and doubled, how many answers changed, and how many of these became right or wrong. Numbers that stand for a
distance from 1 have that distance halved and doubled.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.blind import plan, run, score
from benchmarks.blind.cases import Case
from benchmarks.blind.store import Store
from benchmarks.machine import save
from benchmarks.varied import sites

#: A number and the factor that it is multiplied with.
Change = tuple[str, float]
FACTORS: Final = {0.5: "halved", 2.0: "doubled"}
#: The rooms whose numbers a diagnosis never meets.
OF_COMPARISONS: Final = "tiago_mj.change."


@dataclass
class Tally:
    """What came of halving or doubling a number.

    Attributes:
        tried: cases.
        changed: of them, those whose answer became another one by this number alone.
        mended, broken: of those, became right, became wrong.
    """

    tried: int = 0
    changed: list[int] = field(default_factory=list)
    mended: int = 0
    broken: int = 0


@dataclass(frozen=True)
class Answer:
    """What is compared of a diagnosis.

    Attributes:
        kind: of the verdict.
        classes: that the best explanation names.
        right: by the label.
    """

    kind: str
    classes: tuple[str, ...]
    right: bool

    @classmethod
    def of(cls, label: Mapping[str, Any], answer: Mapping[str, Any] | None) -> Answer:
        """From a label and a ``diagnosis.json``."""
        judged = score.Judged(label, answer)
        return cls(judged.verdict, judged.best or (), bool(score.right(judged)))


def groups(numbers: Sequence[str], size: int, rng: np.random.Generator) -> list[tuple[Change, ...]]:
    """Every number halved once and doubled once, in groups that hold no number twice."""
    factors = rng.permuted(np.tile(list(FACTORS), (len(numbers), 1)), axis=1)
    out: list[tuple[Change, ...]] = []
    for turn in range(len(FACTORS)):
        order = rng.permutation(len(numbers))
        cut = [order[at : at + size] for at in range(0, len(order), size)]
        out += [tuple((numbers[i], float(factors[i, turn])) for i in part) for part in cut]
    return out


def deciding(
    group: tuple[Change, ...], changes: Callable[[tuple[Change, ...]], bool]
) -> tuple[tuple[Change, ...], tuple[Change, ...]]:
    """Of a group: the changes that change an answer alone, and those of which it is not known, since they do so only
    together."""
    if not changes(group):
        return (), ()
    if len(group) == 1:
        return group, ()
    half = len(group) // 2
    (first, unclear), (second, unclear_too) = (deciding(part, changes) for part in (group[:half], group[half:]))
    alone, open_ = first + second, unclear + unclear_too
    return (alone, open_) if alone or open_ else ((), group)


class Study:
    """Answers to the cases of a run with numbers changed, each kept as it is made."""

    def __init__(self, root: Path, out: Path) -> None:
        """Go on with what lies there.

        Args:
            root: of the blind check's run, answered by this checkout.
            out: where answers are kept.
        """
        self._store, self._out = Store(root), out
        drawn = self._store.run()
        self._planned: Sequence[Case] = plan.plan(
            drawn["cases"],
            drawn["seed"],
            only=drawn["kinds"],
            settings=drawn["settings"],
            rates=drawn["rates"],
            trials=drawn["trials"],
            seconds=drawn["seconds"],
        )
        self.drawn = drawn
        self.cases = [k for k in range(drawn["cases"]) if self._store.answer(k) is not None]
        out.mkdir(parents=True, exist_ok=True)
        self._lock = threading.Lock()
        self._kept = out / "answers.jsonl"
        lines = self._kept.read_text().splitlines() if self._kept.exists() else []
        self._known = {
            self._key(row["case"], row["factors"]): Answer(**row["answer"]) for row in map(json.loads, lines)
        }

    @property
    def runs(self) -> int:
        """Diagnoses with numbers changed."""
        return len(self._known)

    def unchanged(self, case: int) -> Answer:
        """The answer with all numbers as they are."""
        return Answer.of(self._label(case), self._store.answer(case))

    def answer(self, case: int, group: Sequence[Change]) -> Answer:
        """The answer with numbers changed; a diagnosis that ends in a fault has the kind ``failed``."""
        factors = dict(group)
        if (known := self._known.get(self._key(case, factors))) is not None:
            return known
        with tempfile.TemporaryDirectory(dir=self._out) as apart:
            answer = Answer.of(self._label(case), self._diagnosed(case, factors, Path(apart) / "diagnosis"))
        with self._lock, self._kept.open("a") as file:
            row = {"case": case, "factors": factors, "answer": vars(answer)}
            file.write(json.dumps(row, sort_keys=True) + "\n")
            self._known[self._key(case, factors)] = answer
        return answer

    def _diagnosed(self, case: int, factors: Mapping[str, float], folder: Path) -> dict[str, Any] | None:
        words = run.Diagnoser(jobs=1).command(self._planned[case], self._store.recordings(case), folder)
        changed = [sys.executable, "-m", "benchmarks.varied.changed", json.dumps(factors)]
        status, said = run.call_command([*changed, *words[words.index("diagnose") :]])
        if status:
            print(f"case {case}: exit status {status}: {said.strip().splitlines()[-1:]}", flush=True)
            return None
        return dict(json.loads((folder / "diagnosis.json").read_text()))

    def _label(self, case: int) -> dict[str, Any]:
        return dict(json.loads(self._store.label_file(case).read_text()))

    @staticmethod
    def _key(case: int, factors: Mapping[str, float]) -> tuple[int, tuple[Change, ...]]:
        return case, tuple(sorted((name, float(by)) for name, by in factors.items()))


def tallied(
    study: Study, numbers: Sequence[str], passes: int, size: int, seed: int, at_once: int = 1
) -> dict[str, dict[str, Tally]]:
    """Every number halved and doubled so many times, each time in the next case of the run.

    Args:
        study: answers.
        numbers: that are varied.
        passes: how many times.
        size: of a group.
        seed: of the groups.
        at_once: groups that are looked at side by side.
    """
    rng = np.random.default_rng(seed)
    out = {name: {word: Tally() for word in FACTORS.values()} for name in numbers}
    cases = itertools.cycle(study.cases)
    for turn in range(passes):
        todo = [(next(cases), group) for group in groups(numbers, size, rng)]
        with ThreadPoolExecutor(at_once) as pool:
            found = list(pool.map(lambda one: _looked_at(study, *one), todo))
        for (case, group), (alone, unclear) in zip(todo, found, strict=True):
            for name, factor in group:
                out[name][FACTORS[factor]].tried += (name, factor) not in unclear
            for name, factor in alone:
                _count(out[name][FACTORS[factor]], case, study.unchanged(case), study.answer(case, [(name, factor)]))
        print(f"pass {turn + 1} of {passes}: {study.runs} diagnoses", flush=True)
    return out


def _looked_at(study: Study, case: int, group: tuple[Change, ...]) -> tuple[tuple[Change, ...], tuple[Change, ...]]:
    """As of :func:`deciding`, of a case's answer."""
    before = study.unchanged(case)

    def changes(some: tuple[Change, ...]) -> bool:
        now = study.answer(case, some)
        return (now.kind, tuple(now.classes)) != (before.kind, before.classes)

    return deciding(group, changes)


def _count(tally: Tally, case: int, before: Answer, now: Answer) -> None:
    tally.changed.append(case)
    tally.mended += now.right and not before.right
    tally.broken += before.right and not now.right


def main(words: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.varied", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of the blind check, answered with --jobs 1")
    parser.add_argument("--passes", type=int, default=8, metavar="N", help="cases that each number is varied in (8)")
    parser.add_argument("--group", type=int, default=12, metavar="N", help="numbers that are changed at once (12)")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="diagnoses that run side by side (1)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="another one gives other groups")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--save", default="varied", metavar="NAME", help="results/NAME.json")
    asked = parser.parse_args(words)
    study = Study(asked.run.resolve(), asked.out.resolve())
    if not study.cases:
        parser.error(f"{asked.run.name}: no case is answered yet; run python -m benchmarks.blind … --out RUN")
    numbers = [site for site in sites.sites() if not site.startswith(OF_COMPARISONS)]
    found = tallied(study, numbers, asked.passes, asked.group, asked.seed, asked.at_once)
    results = {
        "run": study.drawn,
        "cases": len(study.cases),
        "diagnoses": study.runs,
        "numbers": {name: {word: vars(tally) for word, tally in both.items()} for name, both in found.items()},
    }
    command = f"python -m benchmarks.varied RUN --passes {asked.passes} --group {asked.group} --seed {asked.seed}"
    print(save(asked.save, results, f"{command} --out VARIED"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
