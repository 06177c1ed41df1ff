"""Do answers depend on the numbers that have no source? Each is halved and doubled on kept cases.

    python -m benchmarks.blind --cases 100 --seed 3737 --settings plain --out RUN --jobs 1
    python -m benchmarks.varied RUN --passes 8 --out VARIED
    python -m benchmarks.changed_pairs --pairs 16 --seed 4343 --first 8 --out PAIRS
    python -m benchmarks.varied PAIRS --passes 8 --out VARIED --save varied_pairs

Several numbers are changed at once (group testing, Dorfman 1943): where the answer, its kind and the classes that it
names, is as before, none of them decided it; where it is another one, the group is cut into halves until single numbers
are left that change it alone. A pass changes every number twice, each time in another case. ``VARIED`` keeps every
answer as it is made and goes on where it stopped; ``results/varied.json`` tells of each number how often it was
halved and doubled, how many answers changed, and how many of these became right or wrong. Numbers that stand for a
distance from 1 have that distance halved and doubled. Of diagnoses all numbers are varied but those of comparisons, of
pairs of sessions only these; ``--numbers`` takes some by name.
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
from typing import Final

import numpy as np

from benchmarks.machine import save
from benchmarks.varied import sites
from benchmarks.varied.subjects import Answer, Comparisons, Diagnoses

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
    """Answers with numbers changed, each kept as it is made."""

    def __init__(self, of: Diagnoses | Comparisons, out: Path) -> None:
        """Go on with what lies there.

        Args:
            of: what is answered.
            out: where answers are kept.
        """
        self._of, self._out = of, out
        self.cases = of.cases
        out.mkdir(parents=True, exist_ok=True)
        self._lock = threading.Lock()
        self._kept = out / "answers.jsonl"
        lines = self._kept.read_text().splitlines() if self._kept.exists() else []
        self._known = {
            self._key(row["case"], row["factors"]): Answer(**row["answer"]) for row in map(json.loads, lines)
        }

    @property
    def runs(self) -> int:
        """Answers with numbers changed."""
        return len(self._known)

    def unchanged(self, case: int) -> Answer:
        """The answer with all numbers as they are."""
        return self._of.unchanged(case)

    def answer(self, case: int, group: Sequence[Change]) -> Answer:
        """The answer with numbers changed; one that ends in a fault has the kind ``failed``."""
        factors = dict(group)
        if (known := self._known.get(self._key(case, factors))) is not None:
            return known
        with tempfile.TemporaryDirectory(dir=self._out) as apart:
            changed = [sys.executable, "-m", "benchmarks.varied.changed", json.dumps(factors)]
            answer = self._of.answered(case, changed, Path(apart) / "answer")
        with self._lock, self._kept.open("a") as file:
            row = {"case": case, "factors": factors, "answer": vars(answer)}
            file.write(json.dumps(row, sort_keys=True) + "\n")
            self._known[self._key(case, factors)] = answer
        return answer

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
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of the blind check or of pairs")
    parser.add_argument("--passes", type=int, default=8, metavar="N", help="cases that each number is varied in (8)")
    parser.add_argument("--group", type=int, default=12, metavar="N", help="numbers that are changed at once (12)")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="diagnoses that run side by side (1)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="another one gives other groups")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--save", default="varied", metavar="NAME", help="results/NAME.json")
    parser.add_argument("--numbers", nargs="+", metavar="NAME", help="only these")
    asked = parser.parse_args(words)
    root = asked.run.resolve()
    of = Comparisons(root) if (root / "000" / "label.json").exists() else Diagnoses(root)
    study = Study(of, asked.out.resolve())
    if not study.cases:
        parser.error(f"{asked.run.name}: no case is answered yet; run python -m benchmarks.blind … --out RUN")
    numbers = [site for site in sites.sites() if site.startswith(OF_COMPARISONS) == isinstance(of, Comparisons)]
    if asked.numbers:
        numbers = [site for site in sites.sites() if site.split(":")[1] in asked.numbers]
        if unknown := set(asked.numbers) - {site.split(":")[1] for site in numbers}:
            parser.error(f"no number that is varied: {', '.join(sorted(unknown))}")
    found = tallied(study, numbers, asked.passes, asked.group, asked.seed, asked.at_once)
    results = {
        "run": of.drawn,
        "cases": len(study.cases),
        "diagnoses": study.runs,
        "numbers": {name: {word: vars(tally) for word, tally in both.items()} for name, both in found.items()},
    }
    command = f"python -m benchmarks.varied RUN --passes {asked.passes} --group {asked.group} --seed {asked.seed}"
    command += f" --numbers {' '.join(asked.numbers)}" if asked.numbers else ""
    command += f" --save {asked.save}" if asked.save != "varied" else ""
    print(save(asked.save, results, f"{command} --out VARIED"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
