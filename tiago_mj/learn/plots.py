"""Learning curves over environment steps: median and range of the seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tiago_mj.figures import BLUE, GREY, STYLE, VERMILLION

#: A training's two curves in ``curves.json``: name, label, colour, line.
CURVES: Final = (
    ("evaluation", "without exploration", BLUE, "-"),
    ("training", "while training, mean of 20 episodes", VERMILLION, (0, (4, 1))),
)


def learning_curves(data: Mapping[str, Any], lines: Sequence[tuple[str, float]] = ()) -> Figure:
    """Return of the episodes without exploration and of the training's own.

    Args:
        data: contents of ``curves.json``.
        lines: name and return of what the curves are compared with.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(6.6, 3.6), layout=ConstrainedLayoutEngine(w_pad=0.05, h_pad=0.05))
        FigureCanvasAgg(figure)
        axis = figure.subplots()
        for name, label, color, line in CURVES:
            curve = data[name]
            axis.fill_between(curve["steps"], curve["lowest"], curve["highest"], color=color, alpha=0.15, lw=0)
            axis.plot(curve["steps"], curve["median"], color=color, ls=line, lw=1.4, label=label)
        for name, value in lines:
            axis.axhline(value, color=GREY, lw=0.9, ls=":")
            axis.annotate(name, (1.0, value), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=8)
        axis.set(xlabel="environment steps", ylabel="return of an episode")
        axis.legend(loc="lower right")
        count = data["seeds"]
        seeds = "one seed" if count == 1 else f"median and range of {count} seeds"
        text = f"Source: {data['algo']} on {data['env']}, {seeds}."
        figure.supxlabel(text, fontsize=7.5, color=GREY, x=0.01, ha="left")
    return figure
