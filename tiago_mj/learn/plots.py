"""Learning curves over environment steps: median and range of the seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any, Final

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tiago_mj.view.figures import BLACK, BLUE, GREEN, GREY, ORANGE, STYLE, VERMILLION

#: A training's two curves in ``curves.json``: name, label, colour, line.
CURVES: Final = (
    ("evaluation", "without exploration", BLUE, "-"),
    ("training", "while training, mean of 20 episodes", VERMILLION, (0, (4, 1))),
)
#: What the curves are compared with.
LINES: Final = ((GREEN, "-."), (ORANGE, "--"), (BLACK, ":"))


def learning_curves(data: Mapping[str, Any], lines: Sequence[tuple[str, float]] = ()) -> Figure:
    """Return of the episodes without exploration and of the training's own.

    Args:
        data: contents of ``curves.json``.
        lines: name and return of what the curves are compared with.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(6.6, 4.0), layout=ConstrainedLayoutEngine(w_pad=0.05, h_pad=0.05))
        FigureCanvasAgg(figure)
        axis = figure.subplots()
        for name, label, color, line in CURVES:
            curve = data[name]
            axis.fill_between(curve["steps"], curve["lowest"], curve["highest"], color=color, alpha=0.15, lw=0)
            axis.plot(curve["steps"], curve["median"], color=color, ls=line, lw=1.4, label=label)
        for (name, value), (color, style) in zip(lines, cycle(LINES)):
            axis.axhline(value, color=color, lw=1.0, ls=style, label=f"{name} ({value:.1f})")
        axis.set(xlabel="environment steps [thousands]", ylabel="return of an episode")
        axis.set_xlim(0, data["evaluation"]["steps"][-1])
        axis.xaxis.set_major_formatter(lambda steps, _: f"{steps / 1000:g}")
        figure.legend(*axis.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        count = data["seeds"]
        seeds = "one seed" if count == 1 else f"median and range of {count} seeds"
        text = f"Source: {data['algo']} on {data['env']}, {seeds}."
        figure.supxlabel(text, fontsize=7.5, color=GREY, x=0.01, ha="left")
    return figure
