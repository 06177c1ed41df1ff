"""The table and the picture of docs/real-data.md's fingertip: `python docs/make_ta11_picture.py RECORDINGS DIAGNOSES`.

RECORDINGS is what `tiago-mj import ta11-curve` wrote, DIAGNOSES holds a diagnosis of every series under its name. Every
explanation of a diagnosis is simulated with its parameters at their values and at the ends of their intervals, through
the same recordings, and a line is fitted to what it predicts: slope and dead band in the units of the measured ones.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from tiago_mj.effects import read_effects
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings
from tiago_mj.sensing.ta11_curve import Line, fit_line

mpl.use("Agg")
import matplotlib.pyplot as plt  # after the backend is chosen

IMAGES = Path(__file__).parent / "images"


def explanations(diagnosis: dict[str, Any]) -> list[list[dict[str, Any]]]:
    """Those that the data cannot tell from the best, with their parameters."""
    named = [sorted(e["name"] for e in a["effects"]) for a in diagnosis["verdict"]["alternatives"]]
    found: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for entry in diagnosis["ranking"]:
        names = sorted(e["name"] for e in entry["effects"])
        if names and names in named:
            effects = [{**e, "parameters": entry["parameters"].get(e["name"], {})} for e in entry["effects"]]
            found.setdefault(tuple(names), effects)
    return list(found.values())


def at(effects: Sequence[dict[str, Any]], which: str) -> list[dict[str, Any]]:
    """The effects with their parameters at ``value``, ``low`` or ``high``."""
    return [
        {
            "name": e["name"],
            "target": e["target"],
            "parameters": {
                key: p["value"] if p[which] is None else p[which] for key, p in (e.get("parameters") or {}).items()
            },
        }
        for e in effects
    ]


class Bench:
    """The squeezes of one series."""

    def __init__(self, folder: Path) -> None:
        self.trials = read_recordings([folder]).trials
        self.plant = plant_of(self.trials)
        self.on = replay.grid(self.plant, self.trials)
        self.dq = np.array([-next(iter(t.commands.values()))[0] for t in self.trials])
        self.measured = np.array([t.forces["right"][-1] for t in self.trials])

    def predict(self, effects: Any) -> np.ndarray:
        """Steady readings, (n,), mean of both fingers."""
        sims = [(k, read_effects(effects)) for k in range(len(self.trials))]
        return replay.simulate(self.plant, self.on, sims).reading[:, -1].mean(axis=1)

    def line(self, effects: Any) -> Line:
        """Slope and dead band that effects make."""
        force = self.predict(effects)
        return fit_line(self.dq[force > 0], force[force > 0])


def main(recordings: Path, diagnoses: Path) -> None:
    """Print a row an explanation, draw the six series."""
    figure, axes = plt.subplots(2, 3, figsize=(10, 5.6), sharex=True, sharey=True, layout="constrained")
    for axis, folder in zip(axes.flat, sorted(recordings.iterdir()), strict=False):
        bench = Bench(folder)
        diagnosis = json.loads((diagnoses / folder.name / "diagnosis.json").read_text(encoding="utf-8"))
        hand = fit_line(bench.dq, bench.measured)
        print(f"{folder.name}: {diagnosis['verdict']['kind']}, closed {diagnosis['shrink']['closed']}")
        print(f"  by hand: slope {hand.slope:.0f}, dead band {hand.dead_band * 1e3:.2f} mm")
        nominal = bench.predict([])
        axis.plot(bench.dq * 1e3, nominal, color="0.6", label="nominal")
        found = explanations(diagnosis)
        predictions = []
        for effects in found:
            lines = [bench.line(at(effects, which)) for which in ("value", "low", "high")]
            bands = [line.dead_band * 1e3 for line in lines]
            names = " + ".join(e["name"] for e in effects)
            values = "; ".join(
                f"{key} {p['value']:.4g}" + ("" if p["low"] is None else f" [{p['low']:.3g}, {p['high']:.3g}]")
                for e in effects
                for key, p in e["parameters"].items()
            )
            print(
                f"  {names}: {values}: slope {lines[0].slope:.0f}, dead band {bands[0]:.2f} mm "
                f"[{min(bands):.2f}, {max(bands):.2f}]"
            )
            predictions.append(bench.predict(at(effects, "value")))
        for k, force in enumerate(predictions):
            label = f"{len(found)} explanations" if k == 0 else None
            axis.plot(bench.dq * 1e3, force, color="tab:blue", lw=1, alpha=0.6, label=label)
        axis.plot(bench.dq * 1e3, bench.measured, "k.", label="measured")
        axis.set_title(folder.name)
        axis.legend(frameon=False, fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("held servo error [mm]")
    for axis in axes[:, 0]:
        axis.set_ylabel("steady force [sensor units]")
    figure.savefig(IMAGES / "ta11_diagnosed.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
