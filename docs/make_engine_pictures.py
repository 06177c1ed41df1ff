"""Pictures of docs/another-engine.md: `python docs/make_engine_pictures.py`, from benchmarks/results/bullet_story.json.

engine_hold.png: the force of a grasp that is told to hold still, in PyBullet and in the nominal simulator.
engine_gaps.png: of every session the gap of each kind of channel, of the nominal simulator and with what was named.
"""

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt  # after the backend is chosen

HERE = Path(__file__).parent
RESULT = HERE.parent / "benchmarks" / "results" / "bullet_story.json"
IMAGES = HERE / "images"
#: Iterations that are drawn, and in which colour.
SHOWN = {"20": "tab:orange", "50": "tab:red", "100": "tab:green", "500": "tab:blue"}
KINDS = ("position", "velocity", "force")


def hold(held: dict[str, Any], path: Path) -> None:
    """Force over time since the command to stand still."""
    figure, axis = plt.subplots(figsize=(7.2, 3.2), layout="constrained")
    for name, colour in SHOWN.items():
        one = held[name]
        time = np.arange(len(one["newtons"])) * one["interval"]
        label = f"Bullet, {name} iterations" + (" (default)" if name == "50" else "")
        axis.plot(time, one["newtons"], color=colour, lw=1.4, label=label)
    one = held["nominal"]
    axis.plot(
        np.arange(len(one["newtons"])) * one["interval"], one["newtons"], "k--", lw=1.2, label="MuJoCo, ideal servo"
    )
    axis.set_xlabel("time since the fingers were told to stand still [s]")
    axis.set_ylabel("force of a pad [N]")
    axis.set_ylim(bottom=-0.5)
    axis.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def gaps(tellings: list[dict[str, Any]], path: Path) -> None:
    """Mean squared residual in units of the noise, a row a session."""
    figure, axes = plt.subplots(
        1, len(KINDS), figsize=(9, 0.42 * len(tellings) + 1.1), sharey=True, layout="constrained"
    )
    rows = np.arange(len(tellings))[::-1]
    for axis, kind in zip(axes, KINDS, strict=True):
        for row, one in zip(rows, tellings, strict=True):
            channels = [c for name, c in one["per_channel"].items() if name.startswith(kind)]
            before, after = (float(np.mean([c[key] for c in channels])) for key in ("before", "after"))
            axis.plot([before, after], [row, row], color="0.8", lw=2, zorder=1)
            axis.plot(before, row, "D", color="tab:orange", ms=6, label="nominal" if row == rows[0] else None)
            axis.plot(after, row, "o", color="tab:blue", ms=6, label="with what is named" if row == rows[0] else None)
        axis.axvline(1, color="0.4", ls="--", lw=1)
        axis.set_xscale("log")
        axis.set_title(kind, fontsize=10)
        axis.set_xlabel("gap [noise²]")
        axis.set_yticks(rows, [one["name"] for one in tellings])
    axes[-1].legend(frameon=False, fontsize=8, loc="upper left", handletextpad=0.2)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main() -> None:
    """Draw both."""
    results = json.loads(RESULT.read_text(encoding="utf-8"))["results"]
    hold(results["held"], IMAGES / "engine_hold.png")
    gaps(results["tellings"], IMAGES / "engine_gaps.png")


if __name__ == "__main__":
    main()
