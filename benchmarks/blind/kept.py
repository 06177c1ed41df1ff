"""Compact file of a run of the blind check: every label, and of every answer what scores and calibration need.

    python -m benchmarks.blind.kept write RUN FILE
    python -m benchmarks.blind.kept score FILE...

A run's folder holds hundreds of megabytes of recordings, which its seed makes again; a kept file holds some kilobytes a
case, and is committed. A big run may so be made of several, each with its own seed and seal, on whatever machine has
time: scores are of all their cases together.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.blind import baselines, score
from benchmarks.blind.page import WORDS, number
from benchmarks.blind.score import Judged
from benchmarks.blind.store import Store
from benchmarks.machine import machine
from tiago_mj.io import atomic

SCHEMA: Final = "tiago_mj.blind/1"
#: Of an answer; of its ranking only these.
ANSWER: Final = ("verdict", "seconds", "physics_steps", "notes", "complete")
RANKED: Final = ("effects", "evidence")


def keep(root: Path, commit: str | None = None) -> dict[str, Any]:
    """A run's cases that have their answer, in one object.

    Args:
        root: the run's folder.
        commit: of the code that diagnosed, where it is not that of this checkout.

    Raises:
        ValueError: the run is not sealed, or no case is answered.
    """
    store = Store(root)
    run = store.run()
    answered = [k for k in range(run["cases"]) if store.answered(k)]
    if not answered:
        raise ValueError(f"{root.name}: no case has its answer yet; run python -m benchmarks.blind … --out DIR")
    seal = store.seal(run["cases"])
    rows = []
    for k in answered:
        row = {"case": k, "label": json.loads(store.label_file(k).read_text()), "answer": _trimmed(store.answer(k))}
        if (followed := store.followed(k)) is not None:
            row["resolved"] = followed["resolved"]
        if fitted := baselines.answers(store, k):
            row["baselines"] = {name: _trimmed(one) for name, one in fitted.items()}
        rows.append(row)
    by = machine() if commit is None else {**machine(), "commit": commit}
    return {"schema": SCHEMA, "run": run, "seal": seal, "machine": by, "cases": rows}


def load(path: Path) -> dict[str, Any]:
    """A kept file.

    Raises:
        ValueError: it is none.
    """
    try:
        kept = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise ValueError(f"{path.name}: not readable as JSON ({error}); give a file of `kept write`") from error
    if not isinstance(kept, dict) or kept.get("schema") != SCHEMA:
        raise ValueError(f"{path.name}: no file of `kept write` (its schema is not {SCHEMA})")
    return kept


def judged(kept: Mapping[str, Any]) -> list[Judged]:
    """Its cases, to be scored."""
    return [Judged(row["label"], row["answer"]) for row in kept["cases"]]


def together(several: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Scores of all cases of kept files; under ``baselines`` those of other methods, and under ``beside``, by their
    names, the diagnosis's own on the cases that they answered.

    Raises:
        ValueError: two of them have the same case.
    """
    counts = Counter((kept["run"]["seed"], row["case"]) for kept in several for row in kept["cases"])
    if twice := [key for key, count in counts.items() if count > 1]:
        raise ValueError("case {1} of seed {0} is in two of the files: a case counts once".format(*twice[0]))
    cases = [j for kept in several for j in judged(kept)]
    scores = score.score(cases, [row["resolved"] for kept in several for row in kept["cases"] if "resolved" in row])
    rows = [row for kept in several for row in kept["cases"]]
    scores["baselines"] = {"most_frequent": score.score(baselines.most_frequent(cases))}
    scores["beside"] = {}
    for name in sorted({name for row in rows for name in row.get("baselines", ())}):
        theirs = [Judged(row["label"], row["baselines"][name]) for row in rows if name in row.get("baselines", ())]
        ours = [one for one, row in zip(cases, rows, strict=True) if name in row.get("baselines", ())]
        scores["baselines"][name], scores["beside"][name] = score.score(theirs), score.score(ours)
    scores["by_class"], scores["by_strength"] = score.by_class(cases), score.by_strength(cases)
    scores["of"] = [
        {"seed": k["run"]["seed"], "seal": k["seal"], "cases": len(k["cases"]), "commit": k["machine"]["commit"]}
        for k in several
    ]
    return scores


def write(kept: Mapping[str, Any], path: Path) -> None:
    """One line a case."""
    head = {name: value for name, value in kept.items() if name != "cases"}
    lines = ",\n".join(json.dumps(row, separators=(",", ":"), sort_keys=True) for row in kept["cases"])
    atomic.write_text(path, f'{json.dumps(head)[:-1]}, "cases": [\n{lines}\n]}}\n')


def _trimmed(answer: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if answer is None:
        return None
    ranking = [{name: one.get(name) for name in RANKED} for one in answer.get("ranking", ())]
    closed = answer.get("shrink", {}).get("closed")
    return {**{name: answer.get(name) for name in ANSWER}, "ranking": ranking, "shrink": {"closed": closed}}


def main(words: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.kept", description=(__doc__ or "").split("\n")[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    writing = verbs.add_parser("write", help="keep a run, finished or not")
    writing.add_argument("run", type=Path, metavar="RUN", help="its folder (python -m benchmarks.blind … --out RUN)")
    writing.add_argument("file", type=Path, metavar="FILE")
    writing.add_argument("--commit", metavar="HASH", help="of the code that diagnosed, where it is not this checkout's")
    scoring = verbs.add_parser("score", help="score the cases of kept runs together")
    scoring.add_argument("files", nargs="+", type=Path, metavar="FILE")
    scoring.add_argument("--out", type=Path, metavar="FILE", help="where to write all scores as JSON")
    given = parser.parse_args(words)
    try:
        if given.verb == "write":
            write(keep(given.run, given.commit), given.file)
            print(f"Written: {given.file}")
            return 0
        scores = together([load(path) for path in given.files])
    except (OSError, ValueError) as error:
        print(f"kept: {error}", file=sys.stderr)
        return 2
    for name, meaning in WORDS.items():
        entry = scores[name]
        if entry["n"]:
            low, high = (number(name, entry[end]) for end in ("low", "high"))
            print(f"{number(name, entry['value']):>8}  {meaning} (n = {entry['n']}, 90 %: {low} to {high})")
    for word, entry in scores["by_strength"].items():
        print(f"{entry['value']:8.1%}  of those that stand out {word} what is ordinary (n = {entry['n']})")
    for method, ours in scores["beside"].items():
        print(f"{method}, and in brackets the diagnosis on the same cases:")
        for name, meaning in WORDS.items():
            theirs = scores["baselines"][method][name]
            if theirs["n"]:
                own = number(name, ours[name]["value"])
                print(f"{number(name, theirs['value']):>8}  {f'({own})':>9}  {meaning} (n = {theirs['n']})")
    if given.out is not None:
        atomic.write_text(given.out, json.dumps(scores, indent=1, allow_nan=False) + "\n")
        print(f"Written: {given.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
