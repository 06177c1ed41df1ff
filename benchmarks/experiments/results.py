"""Where an experiment's figures go, case by case, with machine, commit and command."""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.experiments.kept_cases import Kept, every
from benchmarks.machine import RESULTS, machine
from tiago_mj.io import atomic


def path_of(name: str) -> Path:
    """File of an experiment's results."""
    return RESULTS / "experiments" / f"{name}.json"


def load(name: str) -> dict[str, Any]:
    """Results by case that there are."""
    path = path_of(name)
    return dict(json.loads(path.read_text())["results"]) if path.exists() else {}


def run(
    name: str, doc: str | None, cases: Sequence[str], one: Callable[[Kept], dict[str, Any]], prefix: str = ""
) -> None:
    """Run an experiment on cases, those of the command line or its own; what is there is not run again.

    Args:
        name: of the experiment.
        doc: its module's docstring.
        cases: its own.
        one: makes the results of a case.
        prefix: of the cases' keys in the results.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks.experiments.{name}", description=(doc or "").split("\n")[0]
    )
    parser.add_argument("cases", nargs="*", metavar="SEED:NUMBER", help=f"default: {' '.join(cases)}")
    given = parser.parse_args()
    kept = every()
    done = load(name)
    for case in given.cases or cases:
        if case not in kept:
            raise SystemExit(f"{name}: no kept case {case}: give SEED:NUMBER of benchmarks/results/blind/seed_*.json")
        if prefix + case in done:
            continue
        begun = time.process_time()
        try:
            found = one(kept[case])
        except Exception as fault:  # the next case is worth its time
            print(
                f"{case}: failed, {type(fault).__name__}: {fault}\n{traceback.format_exc()}",
                file=sys.stderr,
                flush=True,
            )
            continue
        done[prefix + case] = {**found, "seconds": round(time.process_time() - begun, 1)}
        save(name, done)
        print(case, json.dumps(done[prefix + case]), flush=True)


def save(name: str, results: dict[str, Any]) -> None:
    """Write results with what made them."""
    path = path_of(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    head = {"command": f"python -m benchmarks.experiments.{name}", "machine": machine()}
    rows = ",\n".join(f"  {json.dumps(key)}: {json.dumps(row)}" for key, row in results.items())
    atomic.write_text(path, f'{json.dumps(head, indent=1)[:-2]},\n "results": {{\n{rows}\n }}\n}}\n')
