"""Regressions behind the truths, made again from the user's recordings.

    python -m benchmarks.real.regression --data DIR [--only emps,xl330] [--save]

Every robot's module has its own; each is a least squares along filtered motions (``signals``), and none has a recording
that is diagnosed by a case whose truth it gives, but for what is only compared with a published number. ``--save``
writes ``benchmarks/results/real_regression.json``, a source at a time.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from benchmarks.machine import RESULTS, save
from benchmarks.real.cases import REGRESSIONS, SOURCES, wrong

NAME = "real_regression"


def made(data: Path, name: str) -> dict[str, float]:
    """One source's regressions; four digits.

    Raises:
        ValueError: a file is missing or another.
    """
    for file in SOURCES[name].files:
        if said := wrong(data, file):
            raise ValueError(f"{file.place} {said}: python -m benchmarks.real fetch-list says where it is from")
    return {key: float(f"{value:.4g}") for key, value in REGRESSIONS[name](data).items()}


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.real.regression", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of the published recordings")
    parser.add_argument("--only", default=",".join(REGRESSIONS), help=f"some of {','.join(REGRESSIONS)}")
    parser.add_argument("--save", action="store_true", help=f"write benchmarks/results/{NAME}.json")
    asked = parser.parse_args()
    chosen = [name.strip() for name in asked.only.split(",")]
    if unknown := [name for name in chosen if name not in REGRESSIONS]:
        parser.error(f"{unknown[0]!r} is unknown: use some of {', '.join(REGRESSIONS)}")
    path = RESULTS / f"{NAME}.json"
    results: dict[str, Any] = json.loads(path.read_text())["results"] if path.exists() else {}
    for name in chosen:
        try:
            results[name] = made(asked.data, name)
        except ValueError as fault:
            print(f"{name}: {fault}")
            continue
        for key, value in results[name].items():
            print(f"{name}: {key} = {value:g}")
    if asked.save:
        save(NAME, results, "python -m benchmarks.real.regression --data DIR --save")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
