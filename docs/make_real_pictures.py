"""Pictures of docs/real-data.md: `python docs/make_real_pictures.py NAME=RECORDING[,RECORDING...] ...`.

Each diagnosis is made as `tiago-mj diagnose` makes it, from imported recordings, and what it predicts for trials that
were kept aside is drawn over what was measured, into docs/images/NAME.png. A row a channel, a column a trial.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings import lint
from tiago_mj.recordings.read import read_recordings

mpl.use("Agg")
import matplotlib.pyplot as plt  # after the backend is chosen

IMAGES = Path(__file__).parent / "images"
#: Trials side by side at most.
COLUMNS = 2


def diagnosed(recordings: Sequence[Path]) -> Diagnosis:
    """As the command does it."""
    read = read_recordings(list(recordings))
    findings = (*read.findings, *lint.inspect(read.trials, lint.JointRanges.of_model(plant_of(read.trials).model)))
    lint.refuse(read.trials, findings)
    usable = frozenset.intersection(*(lint.usable(trial, findings) for trial in read.trials))
    with threadpool_limits(1):
        return diagnose(read.trials, findings=findings, usable=usable, threads=2)


def picture(found: Diagnosis, path: Path) -> None:
    """Measured, nominal and repaired signals of the trials that were kept aside."""
    shown = found.overlays[:COLUMNS]
    channels = list(dict.fromkeys(name for overlay in shown for name in overlay.measured))
    size = (5.4 * len(shown) + 0.6, 2.2 * len(channels) + 0.6)
    figure, axes = plt.subplots(len(channels), len(shown), figsize=size, squeeze=False, layout="constrained")
    for column, overlay in enumerate(shown):
        for row, name in enumerate(channels):
            axis = axes[row, column]
            axis.plot(overlay.time, overlay.measured[name], "k.", ms=2, label="measured")
            axis.plot(overlay.time, overlay.nominal[name], color="0.6", lw=1, label="nominal")
            axis.plot(overlay.time, overlay.repaired[name], color="tab:blue", lw=1.2, label="with what is named")
            axis.set_title(f"{name}, {overlay.trial}" if row == 0 else name, fontsize=9)
            axis.set_ylabel(overlay.units[name])
            if row == len(channels) - 1:
                axis.set_xlabel("time [s]")
    axes[0, 0].legend(frameon=False, fontsize=8, markerscale=4)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main(arguments: Sequence[str]) -> None:
    """Draw one picture an argument."""
    for argument in arguments:
        name, _, folders = argument.partition("=")
        found = diagnosed([Path(folder) for folder in folders.split(",")])
        picture(found, IMAGES / f"{name}.png")
        effects = [f"{e.name} {e.target}" for e in found.best.effects]
        print(f"{name}: {found.kind}, closed {found.shrink.closed}, {'; '.join(effects)}")


if __name__ == "__main__":
    main(sys.argv[1:])
