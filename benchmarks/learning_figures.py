"""Figures of the results of trained agents: a dot for each seed, a row for each policy, a panel for each setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tiago_mj.view.figures import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, STYLE, VERMILLION

#: Colour and marker of each row, from the top.
ROWS: Final = ((BLUE, "o"), (VERMILLION, "s"), (GREEN, "D"), (PURPLE, "^"), (ORANGE, "v"), (BLACK, "P"))


@dataclass(frozen=True)
class Panel:
    """A setting: its title, and the values of each row, one a seed; a row may have none."""

    title: str
    values: Mapping[str, Sequence[float]]


def dots(
    panels: Sequence[Panel], label: str, source: str, *, columns: int = 3, line: float | None = None, wide: float = 7.6
) -> Figure:
    """Panels side by side that share their rows.

    Args:
        panels: at least one; the rows are the first one's.
        label: of every horizontal axis.
        source: line below.
        columns: panels in a row.
        line: a vertical line at this value.
        wide: the figure's width [inch].
    """
    rows = list(panels[0].values)
    deep = -(-len(panels) // columns)
    with rc_context(STYLE):
        figure = Figure(
            figsize=(wide, 0.75 + deep * (0.75 + 0.26 * len(rows))),
            layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06),
        )
        FigureCanvasAgg(figure)
        axes = figure.subplots(deep, columns, squeeze=False, sharey=True)
        for axis, panel in zip(axes.flat, panels, strict=False):
            _panel(axis, panel, rows)
            if line is not None:
                axis.axvline(line, color=GREY, lw=1.0, ls="--", zorder=1)
        for axis in axes.flat[len(panels) :]:
            axis.set_axis_off()
        for axis in axes[-1]:
            if axis.axison:
                axis.set_xlabel(label)
        figure.supxlabel(source, fontsize=7.5, color=GREY, x=0.01, ha="left")
    return figure


def _panel(axis: Axes, panel: Panel, rows: Sequence[str]) -> None:
    for k, name in enumerate(rows):
        color, marker = ROWS[k % len(ROWS)]
        values = panel.values.get(name, ())
        if values:
            axis.plot([min(values), max(values)], [k, k], color=color, lw=1.2, alpha=0.5, solid_capstyle="round")
            axis.plot(values, [k] * len(values), ls="", marker=marker, ms=5.5, mec="white", mew=0.6, color=color)
    axis.set_title(panel.title)
    axis.set_yticks(range(len(rows)), rows)
    axis.set_ylim(len(rows) - 0.4, -0.6)
    axis.margins(x=0.12)


def courses(groups: Mapping[str, Sequence[tuple[Sequence[float], Sequence[float]]]], label: str, source: str) -> Figure:
    """Lines over environment steps, one a seed, in the colour and with the marker of their group.

    Args:
        groups: name to steps and values of every seed.
        label: of the values.
        source: line below.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(6.6, 3.8), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06))
        FigureCanvasAgg(figure)
        axis = figure.subplots()
        for (name, lines), (color, marker) in zip(groups.items(), ROWS, strict=False):
            for k, (steps, values) in enumerate(lines):
                thousands = [step / 1000 for step in steps]
                axis.plot(thousands, values, color=color, marker=marker, ms=4, lw=1.3, label=None if k else name)
        axis.set(xlabel="environment steps [thousands]", ylabel=label)
        figure.legend(*axis.get_legend_handles_labels(), loc="outside upper left", ncols=4)
        figure.supxlabel(source, fontsize=7.5, color=GREY, x=0.01, ha="left")
    return figure
