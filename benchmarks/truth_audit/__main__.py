"""The library set to the true effect and the true numbers, against recordings of reality: what is left must be noise.

    python -m benchmarks.truth_audit [NAME ...] [--steps coarse,fine] [--every N] [--out results]

No search and no fit: each case of the list below is recorded in the blind check's reality, with nominal numbers that
are off by a few per cent, and simulated by the diagnosis's own simulator with those very numbers and the true effect.
Channel by channel and trial by trial the mean square of what is left is told in variances of the sensor's noise. Where
it is more than 1, no magnitude of any effect can mend it, and a diagnosis takes it for a further effect.

Numbers go in by the effects of the library, as the diagnosis could put them; nothing is clipped to a prior. Effects of
chance get reality's own draws. Readings on a grid are compared by randomised quantile residuals (Dunn and Smyth 1996,
J. Comput. Graph. Stat. 5, 236): standard normal where the prediction is right.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from benchmarks.machine import RESULTS, save
from benchmarks.truth_audit.audit import row
from benchmarks.truth_audit.plan import planned
from benchmarks.truth_audit.residuals import POOLED

NAME: Final = "truth_audit"


def main() -> None:
    """Audit, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="parts of names of cases, such as gripper/backlash; all by default")
    parser.add_argument("--every", type=int, default=1, help="each so many-th case alone")
    parser.add_argument("--steps", default="coarse,fine", help="which, by commas")
    parser.add_argument("--out", default=NAME, help="name of the result file; - writes none")
    parser.add_argument("--merge", action="store_true", help="put these cases into the result file, which keeps others")
    arguments = parser.parse_args()
    steps = arguments.steps.split(",")
    wanted = {n: c for n, c in planned().items() if not arguments.names or any(part in n for part in arguments.names)}
    rows = []
    for name, case in itertools.islice(wanted.items(), 0, None, arguments.every):
        rows.append(row(name, case, steps))
        print(_line(rows[-1], steps), flush=True)
        if arguments.out != "-" and arguments.merge:
            save(arguments.out, merged(arguments.out, rows), f"python -m benchmarks.{NAME}")
    counts = counted(rows, steps)
    print(f"{len(rows)} cases; only noise in {counts['passes']}, no more than {POOLED} in {counts['within_1.3']}")
    if arguments.out != "-" and not arguments.merge:
        save(arguments.out, {**counts, "rows": rows}, f"python -m benchmarks.{NAME}")


def counted(rows: Sequence[Mapping[str, Any]], ways: Sequence[str]) -> dict[str, Any]:
    """How many cases pass, by step."""
    return {
        "cases": len(rows),
        "passes": {way: sum(r[way]["passes"] for r in rows if way in r) for way in ways},
        "within_1.3": {way: sum(r[way]["worst"] <= POOLED for r in rows if way in r) for way in ways},
        "passes_with_onsets": {way: sum(r[way]["passes_with_onsets"] for r in rows if way in r) for way in ways},
    }


def merged(name: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A result file's rows with these in place of those of the same cases; by step each says which commit it is of."""
    path = RESULTS / f"{name}.json"
    kept = {r["case"]: r for r in json.loads(path.read_text())["results"]["rows"]} if path.exists() else {}
    for new in rows:
        kept[new["case"]] = {**kept.get(new["case"], {}), **new}
    order = list(planned())
    both = sorted((r for r in kept.values() if r["case"] in order), key=lambda r: order.index(r["case"]))
    return {**counted(both, ("coarse", "fine")), "rows": both}


def _line(one: Mapping[str, Any], steps: Sequence[str]) -> str:
    said = f"{one['case']:34}{one['rate_hz']:4.0f} Hz {one['interface']:9} without {one['without']:9.2f}"
    for step in steps:
        at = one[step]
        where = max(at["channels"], key=at["channels"].get)
        mark = "  " if at["passes"] else " !"
        said += f"  {step}: {at['worst']:7.2f} (trial {at['worst_trial']:7.2f}, {where[:14]}){mark}"
    return said


if __name__ == "__main__":
    main()
