"""Paired comparison of two versions of the diagnosis on the same cases (McNemar): cases that one answers and the
other does not.

    python -m benchmarks.blind.paired BEFORE.json AFTER.json [--out FILE]

Both are kept runs (:mod:`benchmarks.blind.kept`) of one seed; cases that only one of them has are left out. Beside each
row stands McNemar's exact test: of the cases in which the versions differ, were the better one no better, each would
win half.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from scipy.stats import binomtest

from benchmarks.blind import kept, score
from benchmarks.blind.score import Judged
from tiago_mj.io import atomic

#: Rows, and which cases enter each.
ROWS: Final[Mapping[str, Callable[[Judged], bool]]] = {
    "one effect": lambda j: j.kind == "one" and j.detectable,
    "two effects": lambda j: j.kind == "two" and j.detectable,
    "no effect": lambda j: j.kind == "none",
    "outside the library": lambda j: j.kind == "outside" and j.detectable,
    "deleted from the library": lambda j: j.kind == "left_out" and j.detectable,
    "gripper": lambda j: j.label.get("setting") == "gripper",
    "arm": lambda j: j.label.get("setting") == "arm",
    "hinge": lambda j: j.label.get("setting") == "plain",
    "all": lambda j: True,
}


def compare(before: Sequence[Judged], after: Sequence[Judged]) -> dict[str, dict[str, Any]]:
    """Counts and p of every row that has a case; the two are of the same cases, in the same order."""
    out = {}
    for name, enters in ROWS.items():
        pairs = [(score.right(a), score.right(b)) for a, b in zip(before, after, strict=True) if enters(a)]
        if not pairs:
            continue
        mended, broken = sum(b and not a for a, b in pairs), sum(a and not b for a, b in pairs)
        out[name] = {
            "cases": len(pairs),
            "before": sum(a for a, _ in pairs),
            "after": sum(b for _, b in pairs),
            "mended": mended,
            "broken": broken,
            "p": float(binomtest(mended, mended + broken).pvalue) if mended + broken else 1.0,
        }
    return out


def same_cases(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[list[Judged], list[Judged]]:
    """The cases that both files have, in the same order.

    Raises:
        ValueError: they are of different seals, or have no case in common.
    """
    if before["seal"] != after["seal"]:
        raise ValueError("the files are of different runs: their labels were sealed under other sums")
    first, second = ({row["case"]: row for row in one["cases"]} for one in (before, after))
    common = sorted(set(first) & set(second))
    if not common:
        raise ValueError("the files have no case in common")
    both = [[Judged(rows[k]["label"], rows[k]["answer"]) for k in common] for rows in (first, second)]
    return both[0], both[1]


def main(words: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blind.paired", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("before", type=Path, metavar="BEFORE", help="a kept run of the one version")
    parser.add_argument("after", type=Path, metavar="AFTER", help="and of the other")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where to write the table as JSON")
    given = parser.parse_args(words)
    try:
        rows = compare(*same_cases(kept.load(given.before), kept.load(given.after)))
    except ValueError as error:
        print(f"paired: {error}", file=sys.stderr)
        return 2
    print(f"{'':26}{'cases':>7}{'before':>8}{'after':>7}{'mended':>8}{'broken':>8}{'p':>8}")
    for name, row in rows.items():
        print(
            f"{name:26}{row['cases']:7}{row['before']:8}{row['after']:7}{row['mended']:8}{row['broken']:8}{row['p']:8.3f}"
        )
    if given.out is not None:
        atomic.write_text(given.out, json.dumps(rows, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
