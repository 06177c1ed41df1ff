"""Force and finger position over time, one column a controller."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tiago_mj.evaluate.play import Played
from tiago_mj.rollout import Trace
from tiago_mj.view.figures import BLACK, GREY, SIDE_STYLE, STYLE

#: Width of a controller's column, and height of a row [inch].
COLUMN, ROW = 3.6, 2.5
#: Episodes behind the first are drawn this faint.
FAINT: Final = 0.22


def episodes(played: Sequence[Played], environment: str) -> Figure:
    """Contact forces (where there are load cells) and finger positions of every controller's episodes.

    The first episode is drawn in full, the others faintly; steps without contact of either finger, after its first, are
    marked below the forces.
    """
    first = played[0].traces[0]
    feels = first.force.shape[1] > 0
    rows = 2 if feels else 1
    with rc_context(STYLE):
        size = (max(5.0, COLUMN * len(played) + 0.6), ROW * rows + 0.7)
        figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.05, h_pad=0.05))
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, len(played), sharex=True, sharey="row", squeeze=False)
        for column, one in enumerate(played):
            axes[0, column].set_title(one.name)
            axes[-1, column].set_xlabel("time [s]")
            for number, trace in enumerate(one.traces):
                if feels:
                    _forces(axes[0, column], trace, leading=number == 0)
                _positions(axes[-1, column], trace, leading=number == 0)
        if feels:
            axes[0, 0].set_ylabel("contact force [N]")
        axes[-1, 0].set_ylabel("finger position [mm]")
        axes[-1, 0].set_xlim(0, first.time[-1])
        figure.legend(*axes[-1, 0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
        count = len(played[0].seeds)
        text = f"Source: {environment}, seeds {played[0].seeds[0]} to {played[0].seeds[-1]}"
        lost = "; dots: contact is lost" if feels else ""
        figure.supxlabel(f"{text}; the first of {count} in full{lost}.", fontsize=7.5, color=GREY, x=0.01, ha="left")
    return figure


def _forces(axis: Axes, trace: Trace, *, leading: bool) -> None:
    if leading and trace.goal_newtons is not None:
        axis.axhline(float(trace.goal_newtons[0]), color=BLACK, ls="--", lw=1.0)
    touched = np.logical_or.accumulate(trace.in_contact, axis=0)
    for i, (color, line) in enumerate(SIDE_STYLE.values()):
        axis.plot(trace.time, trace.force_contact[:, i], color=color, ls=line, lw=1.3, alpha=1 if leading else FAINT)
        if leading:
            lost = touched[:, i] & ~trace.in_contact[:, i]
            axis.plot(trace.time[lost], np.full(lost.sum(), -0.25 - 0.35 * i), color=color, ls="none", marker=".", ms=3)


def _positions(axis: Axes, trace: Trace, *, leading: bool) -> None:
    fingers = trace.position[:, -2:]
    for i, (side, (color, line)) in enumerate(SIDE_STYLE.items()):
        label = f"{side} finger" if leading else None
        alpha = 1 if leading else FAINT
        axis.plot(trace.time, 1e3 * fingers[:, i], color=color, ls=line, lw=1.3, alpha=alpha, label=label)
