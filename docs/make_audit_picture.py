"""Draw what the audit at the truth leaves, case by case: ``docs/images/truth_audit.png``, of its result file.

python docs/make_audit_picture.py
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks/results/truth_audit.json"
PICTURE = ROOT / "docs/images/truth_audit.png"
ROBOTS = {"gripper": "gripper", "plain": "hinge", "arm": "arm"}
#: Most noise variances that a channel may leave.
POOLED = 1.3


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """A dot a case and a physics step, sorted by what the fine step leaves."""
    each = {name: [row for row in rows if row["case"].startswith(name)] for name in ROBOTS}
    figure, axes = plt.subplots(1, len(each), figsize=(10, 4.2), sharey=True, layout="constrained")
    for axis, (name, some) in zip(axes, each.items(), strict=True):
        some = sorted(some, key=lambda row: row["fine"]["worst"])
        at = np.arange(len(some))
        axis.plot(at, [row["without"] for row in some], "x", color="0.6", ms=4, label="without the effect")
        axis.plot(at, [row["coarse"]["worst"] for row in some], "D", color="tab:orange", ms=4, label="step of 2 ms")
        axis.plot(at, [row["fine"]["worst"] for row in some], "o", color="tab:blue", ms=4, label="fine step")
        axis.axhline(POOLED, color="0.3", ls="--", lw=1)
        axis.set_yscale("log")
        axis.set_title(f"{ROBOTS[name]}, {len(some)} cases", fontsize=10)
        axis.set_xlabel("cases, by what is left")
    axes[0].set_ylabel("left in the worst channel [noise variances]")
    axes[0].legend(frameon=False, fontsize=8, loc="upper left")
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=90)
    plt.close(figure)


if __name__ == "__main__":
    draw(json.loads(RESULT.read_text(encoding="utf-8"))["results"]["rows"], PICTURE)
