"""``python -m benchmarks.user_robots``: record and diagnose cases, and say how many were right."""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.machine import RESULTS, machine
from benchmarks.user_robots.case import Case, run
from benchmarks.user_robots.models import USER_ROBOTS
from benchmarks.user_robots.truths import TRUTHS


def table(rows: Sequence[dict[str, Any]]) -> str:
    """One line a case."""
    head = f"{'case':25}{'right':>6} {'verdict':10}{'named':44}{'value in interval':30}{'s':>6}{'lines':>7}  trouble"
    return "\n".join([head, *(_line(row) for row in rows)])


def _line(row: dict[str, Any]) -> str:
    named = ", ".join(f"{one['name']}@{_target(one['target'])}" for one in row["named"]) or "-"
    value = ""
    if "value" in row:
        told = row["value"]
        low, high = ("?" if told[k] is None else f"{told[k]:.3g}" for k in ("low", "high"))
        value = f"{told['truth']:.3g} in {low}..{high}" if row["within"] else f"{told['truth']:.3g} NOT {low}..{high}"
    trouble = [f"exit {row['exit_status']}"] if row["exit_status"] != 0 else []
    trouble += [f"left {', '.join(list(row['files_left'])[:3])}"] if row["files_left"] else []
    trouble += ["incomplete"] if row.get("complete") is False else []
    trouble += [row["last_line"][:120]] if row["exit_status"] != 0 else []
    case = f"{row['model']} {row['truth']['kind']} {row['seed']}"
    return (
        f"{case:25}{'yes' if row['right'] else 'NO':>6} {row['verdict']!s:10}{named[:43]:44}{value:30}"
        f"{row['seconds']:6.0f}{row['lines']:7d}  {'; '.join(trouble)}"
    )


def _target(target: Any) -> str:
    return "+".join(target) if isinstance(target, list) else str(target)


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What the rows come to."""
    without = [row for row in rows if row["truth"]["kind"] == "none"]
    within = [row["within"] for row in rows if row.get("within") is not None]
    return {
        "cases": len(rows),
        "right": sum(row["right"] for row in rows),
        "right_by_truth": {
            kind: [sum(row["right"] for row in some), len(some)]
            for kind in TRUTHS
            if (some := [row for row in rows if row["truth"]["kind"] == kind])
        },
        "right_by_model": {
            name: [sum(row["right"] for row in some), len(some)]
            for name in USER_ROBOTS
            if (some := [row for row in rows if row["model"] == name])
        },
        "false_names_without_effect": [sum(bool(row["false_names"]) for row in without), len(without)],
        "values_within": [sum(within), len(within)],
        "crashes": sum(row["crashed"] for row in rows),
        "refused": sum(row["exit_status"] == 2 for row in rows),
        "incomplete": sum(row.get("complete") is False for row in rows),
        "files_left": sum(bool(row["files_left"]) for row in rows),
        "most_lines": max((row["lines"] for row in rows), default=0),
        "seconds": {
            "median": statistics.median(row["seconds"] for row in rows) if rows else None,
            "most": max((row["seconds"] for row in rows), default=None),
        },
    }


def _names(text: str, known: Sequence[str], what: str) -> list[str]:
    chosen = list(known) if text == "all" else [name.strip() for name in text.split(",") if name.strip()]
    wrong = [name for name in chosen if name not in known]
    if wrong:
        raise SystemExit(f"{what} {wrong[0]!r} is unknown: use all, or some of {', '.join(known)}")
    return chosen


def _seeds(text: str) -> list[int]:
    """``3`` is the first three, ``5,7`` are those."""
    try:
        numbers = [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: give a number of seeds, or seeds with commas between") from None
    return numbers if "," in text else list(range(numbers[0]))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.user_robots", description=(__doc__ or "").strip())
    parser.add_argument("--models", default="all", help=f"all, or some of {','.join(USER_ROBOTS)}")
    parser.add_argument("--truths", default="all", help=f"all, or some of {','.join(TRUTHS)}")
    parser.add_argument("--seeds", type=_seeds, default=[0, 1, 2], help="how many, or which: 5,7 or 5,")
    parser.add_argument("--out", type=Path, required=True, help="folder; what lies there is not made again")
    parser.add_argument("--time-budget", type=float, help="of one diagnosis [s]; default: none")
    parser.add_argument("--jobs", type=int, default=1, help="cases at once; they share the processors")
    parser.add_argument("--logs", type=int, help="recordings of a case, instead of 3 to 20")
    parser.add_argument("--seconds", type=float, help="of a recording, instead of 2.5 to 6")
    parser.add_argument("--rate", type=float, help="of a recording [Hz], instead of 50 to 500")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/user_robots.json, too")
    asked = parser.parse_args()
    cases = [
        Case(model, truth, seed, asked.logs, asked.seconds, asked.rate)
        for seed in asked.seeds
        for model in _names(asked.models, list(USER_ROBOTS), "model")
        for truth in _names(asked.truths, TRUTHS, "truth")
    ]
    threads = max((os.cpu_count() or 1) // asked.jobs, 1) if asked.jobs > 1 else 0

    def one(case: Case) -> dict[str, Any]:
        row = run(case, asked.out / "cases" / case.name, budget=asked.time_budget, threads=threads)
        print(_line(row), flush=True)
        return row

    with ThreadPoolExecutor(max(asked.jobs, 1)) as pool:
        rows = list(pool.map(one, cases))
    said = summary(rows)
    words = [word for word in sys.argv[1:] if word != "--save"]
    words = ["DIR" if word == str(asked.out) else word for word in words]
    whole = {
        "command": f"python -m benchmarks.user_robots {' '.join(words)}",
        "machine": machine(),
        "results": {"summary": said, "cases": rows},
    }
    paths = [asked.out / "user_robots.json", *([RESULTS / "user_robots.json"] if asked.save else [])]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(whole, indent=1) + "\n")
    print("\n" + table(rows))
    print("\n" + json.dumps(said, indent=1))
    print("wrote", *paths)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
