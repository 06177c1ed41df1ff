"""Blind check of ``tiago-mj compare``: pairs of sessions, one changed effect or none, whose truth is withheld.

    python -m benchmarks.changed_pairs --pairs 60 --seed N --out DIR [--begin N] [--first N] [--save NAME]

Every other pair has a change. Right is: ``nothing_changed`` where nothing did; where an effect changed, ``changed``
with an effect of its class, or ``ambiguous`` with it among the alternatives (counted apart). A false alarm is an answer
that names a change where there is none. The run goes on where it stopped; ``--save`` writes the scores and all answers
to ``benchmarks/results/NAME.json``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks import machine
from benchmarks.blind import changes, recordings, robots
from benchmarks.blind.changes import Pair
from benchmarks.blind.score import class_of
from tiago_mj import cli
from tiago_mj.change import command
from tiago_mj.change.result import as_data
from tiago_mj.cli import compare as declared
from tiago_mj.io import atomic, outputs

PROG: Final = "python -m benchmarks.changed_pairs"
NAMING: Final = ("changed", "ambiguous")


def make(pair: Pair, folder: Path) -> None:
    """Record both sessions of a pair; the label lies beside the folders that are read."""
    for which, made in zip(("before", "after"), changes.record(pair, folder), strict=True):
        recordings.write(made, folder / which)
    atomic.write_text(folder / "label.json", json.dumps(changes.label(pair), indent=1) + "\n")


def answer(folder: Path) -> dict[str, Any]:
    """What the comparison says of a pair, with processor seconds."""
    parser = argparse.ArgumentParser()
    declared.add_arguments(parser)
    model = folder / robots.PLAIN_FILE
    words = [str(folder / "before"), str(folder / "after"), "--model", str(model), "--jobs", "1"]
    given = parser.parse_args([*words, "--out", str(folder / "out"), "--json"])
    begun = time.process_time()
    found = as_data(command.compared(given, given.before, given.after))
    return {**found, "processor_seconds": round(time.process_time() - begun, 1)}


def classes(one: Mapping[str, Any]) -> set[str]:
    """Of the effects of an explanation."""
    return {class_of(change["name"]) for change in one["changes"]}


def outcome(label: Mapping[str, Any], said: Mapping[str, Any]) -> str:
    """``right``, ``in the set``, ``missed``, ``unknown``, ``wrong`` or ``false alarm``."""
    kind, truth = said["kind"], label["effect"]
    if truth is None:
        return "right" if kind == "nothing_changed" else "unknown" if kind == "unknown_change" else "false alarm"
    if kind not in NAMING:
        return "missed" if kind == "nothing_changed" else "unknown"
    best = classes(said["best"])
    if kind == "changed":
        return "right" if best == {class_of(truth["name"])} else "wrong"
    among = [classes(one) for one in said["alternatives"]]
    return "in the set" if {class_of(truth["name"])} in among else "wrong"


def scores(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Counts over pairs, each with its label, answer and outcome."""
    changed = [row for row in rows if row["label"]["effect"] is not None]
    same = [row for row in rows if row["label"]["effect"] is None]

    def count(some: Sequence[Mapping[str, Any]]) -> dict[str, int]:
        found = [row["outcome"] for row in some]
        return {"pairs": len(some), **{name: found.count(name) for name in sorted(set(found))}}

    seconds = sorted(row["answer"]["processor_seconds"] for row in rows)
    steps = sorted(row["answer"]["physics_steps"] for row in rows)
    return {
        "pairs": len(rows),
        "right": sum(row["outcome"] == "right" for row in rows),
        "false_alarms": sum(row["outcome"] == "false alarm" for row in rows),
        "changed": count(changed),
        "nothing_changed": count(same),
        "same_commands": count([row for row in rows if row["label"]["same_motion"]]),
        "other_commands": count([row for row in rows if not row["label"]["same_motion"]]),
        "processor_seconds": {"median": seconds[len(seconds) // 2], "largest": seconds[-1]},
        "physics_steps": {"median": steps[len(steps) // 2], "largest": steps[-1]},
    }


def kept(row: Mapping[str, Any]) -> dict[str, Any]:
    """A pair as the result file has it: what was said, without lists of recordings and findings."""
    said = {key: value for key, value in row["answer"].items() if key not in ("findings", "before", "after", "ranking")}
    return {"pair": row["pair"], "outcome": row["outcome"], "label": row["label"], "answer": said}


def run(arguments: argparse.Namespace) -> int:
    """Record, compare and score."""
    rows = []
    last = arguments.pairs if arguments.first is None else min(arguments.first, arguments.pairs)
    for number in range(arguments.begin, last):
        folder = arguments.out / f"{number:03d}"
        if not (folder / "label.json").exists():
            make(changes.pair(arguments.pairs, arguments.seed, number), folder)
        if not (folder / "answer.json").exists():
            atomic.write_text(folder / "answer.json", json.dumps(answer(folder), indent=1) + "\n")
        said = json.loads((folder / "answer.json").read_text())
        label = json.loads((folder / "label.json").read_text())
        rows.append({"pair": number, "label": label, "answer": said, "outcome": outcome(label, said)})
        true = label["effect"]["name"] if label["effect"] else "nothing"
        told = [sorted(classes(one)) for one in said["alternatives"]]
        print(f"pair {number:03d}: {true} {label['change']}: {said['kind']} {told}: {rows[-1]['outcome']}", flush=True)
    found = scores(rows)
    print(json.dumps(found, indent=1))
    if arguments.save:
        words = f"{PROG} --pairs {arguments.pairs} --seed {arguments.seed} --out DIR --save {arguments.save}"
        words += f" --begin {arguments.begin}" if arguments.begin else ""
        words += f" --first {arguments.first}" if arguments.first is not None else ""
        machine.save(arguments.save, {"seed": arguments.seed, **found, "cases": [kept(row) for row in rows]}, words)
    return 0


def main(words: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = cli.Parser(prog=PROG, description="Check comparisons on pairs whose change is withheld.")
    parser.add_argument("--pairs", type=int, required=True, metavar="N", help="how many are planned")
    parser.add_argument("--seed", type=int, required=True, metavar="N", help="another one gives other pairs")
    parser.add_argument("--first", type=int, metavar="N", help="only the first so many of them")
    parser.add_argument("--begin", type=int, default=0, metavar="N", help="number of the pair to begin with")
    parser.add_argument("--out", type=outputs.folder, required=True, metavar="DIR", help="goes on where it stopped")
    parser.add_argument("--save", metavar="NAME", help="write benchmarks/results/NAME.json")
    parser.set_defaults(run=run)
    return cli.guarded(PROG, parser.parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
