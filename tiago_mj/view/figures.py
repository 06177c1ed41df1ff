"""Every figure that the package draws: axes with units, a line with the source, colours that survive printing.

Colours are Okabe and Ito's (2008), told apart by every kind of colour vision; markers and line styles differ too.
Figures are made without pyplot, so that drawing changes no global state and needs no display.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tiago_mj.demo.arm_torque import ArmComparison
from tiago_mj.rollout import Trace
from tiago_mj.sensing.ta11_curve import MEASURED, SENT_ABOVE, Comparison, is_sent

BLACK, GREY = "#1a1a1a", "#5b6470"
ORANGE, GREEN, BLUE, VERMILLION, PURPLE = "#E69F00", "#009E73", "#0072B2", "#D55E00", "#CC79A7"
SIDE_STYLE: Final = {"right": (GREEN, "-"), "left": (PURPLE, (0, (4, 1)))}
OBJECT_STYLE: Final = {
    "wood": (BLUE, "o"),
    "pringles": (GREEN, "s"),
    "glue": (ORANGE, "^"),
    "sponge": (PURPLE, "D"),
}
STYLE: Final[dict[str, Any]] = {
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e6ea",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.edgecolor": GREY,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "figure.facecolor": "white",
}


def png(figure: Figure, *, dpi: int = 140) -> bytes:
    """The figure as a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi)
    return stream.getvalue()


def force(trace: Trace) -> Figure:
    """Readings, goal, threshold and first contacts over time, and the fingers' positions below."""
    with rc_context(STYLE):
        figure, (upper, lower) = _rows(2, (6.2, 4.0), heights=(2.4, 1))
        goal = float(trace.goal[0])
        upper.axhline(goal, color=BLACK, ls="--", lw=1.2)
        upper.text(0.004, goal, " goal", va="bottom", color=BLACK)
        limit = float(trace.threshold.max())
        upper.axhline(limit, color=BLACK, ls=":", lw=1.2)
        upper.text(0.004, limit, f" threshold {limit:.3f}", va="bottom", color=BLACK)
        touches = trace.contact_times()
        first = min((t for t in touches if t is not None), default=None)
        for i, ((side, (color, line)), touch) in enumerate(zip(SIDE_STYLE.items(), touches, strict=True)):
            upper.plot(trace.time, trace.force[:, i], color=color, ls=line, lw=1.4, label=f"{side} finger")
            lower.plot(trace.time, 1e3 * trace.position[:, i], color=color, ls=line, lw=1.4)
            if touch is not None:
                _instant((upper, lower), touch, color, f"{side} touches\n{touch:.2f} s", before=touch == first)
        upper.set(ylabel="load cell [sensor units]", title="Close, wait for both contacts, hold the goal force")
        upper.set_ylim(-0.05 * goal, 1.3 * max(goal, float(trace.force.max())))
        upper.legend(loc="center right")
        lower.set(ylabel="finger [mm]", xlabel="time [s]", xlim=(0, trace.time[-1]))
        _source(figure, "Source: tiago_mj/GripperTactile-v0 with the PI force controller; one episode.")
    return figure


def curve(comparison: Comparison) -> Figure:
    """The real force curves by object and the simulated one; slope against dead band beside it."""
    with rc_context(STYLE):
        figure = _figure((9.6, 3.2))
        left, right = figure.subplots(1, 2, width_ratios=(1.75, 1))
        for series, line in zip(MEASURED, comparison.measured, strict=True):
            color, marker = OBJECT_STYLE[series.object]
            filled = series.session == "A"
            style = {"color": color, "mfc": color if filled else "white", "mew": 1.3, "ls": "none", "ms": 5.5}
            name = f"{series.object}, series {series.session}"
            left.plot(1e3 * np.array(series.dq), series.force, marker=marker, label=name, **style)
            right.plot(1e3 * line.dead_band, line.slope, marker=marker, **{**style, "ms": 8})
        for replay in comparison.replays:
            last = replay is comparison.replays[-1]
            label = f"simulated ({', '.join(r.object for r in comparison.replays)})" if last else None
            sent = is_sent(replay.dq)
            left.plot(1e3 * replay.dq[sent], replay.force[sent].mean(axis=1), color=BLACK, lw=1.4, label=label)
            right.plot(1e3 * replay.line.dead_band, replay.line.slope, marker="*", color=BLACK, ms=13, ls="none")
        line = comparison.replays[0].line
        onset = np.array([line.dead_band, SENT_ABOVE])
        left.plot(1e3 * onset, line.slope * (onset - line.dead_band), color=BLACK, lw=1.0, ls=":")
        left.axvspan(0, 1e3 * SENT_ABOVE, color="#edeff2", lw=0)
        left.text(1e3 * SENT_ABOVE / 2, 0.3, "no command is sent", rotation=90, ha="center", va="bottom", color=GREY)
        left.set(xlabel="held servo error dq [mm]", ylabel="steady force [sensor units]")
        left.set(xlim=(0, 3.1), ylim=(-0.02, 1.05))
        left.set_title("Force over held servo error")
        left.legend(loc="upper left", bbox_to_anchor=(0.1, 1.04), fontsize=7.5, labelspacing=0.25)
        right.set(xlabel="dead band [mm]", ylabel="slope [sensor units per metre]", xlim=(-0.03, 0.34), ylim=(240, 350))
        right.set_title("Slope and dead band")
        right.annotate("simulated", (0.0, comparison.replays[0].line.slope), (14, -3), textcoords="offset points")
        _source(figure, "Real TIAGo gripper: llach/learning_fc ee792cf (A), 3dd34c2 (B); simulated: this package.")
    return figure


def arm(comparison: ArmComparison, *, start: float = 10.0, length: float = 30.0) -> Figure:
    """Measured and predicted torque of every compared joint over a window [s]."""
    with rc_context(STYLE):
        figure, axes = _rows(len(comparison.joints), (9.6, 7.6))
        shown = (comparison.time >= start) & (comparison.time <= start + length)
        time = comparison.time[shown]
        for j, (axis, row) in enumerate(zip(axes, comparison.rows, strict=True)):
            measured, predicted = comparison.measured[shown, j], comparison.predicted[shown, j]
            axis.fill_between(time, measured, predicted, color="#dfe4ea", lw=0, label="gap")
            axis.plot(time, measured, color=BLACK, lw=1.4, label="measured: motor current × constant")
            axis.plot(time, predicted, color=VERMILLION, lw=1.4, ls=(0, (5, 1.5)), label="predicted: nominal model")
            axis.set(ylabel="torque [N·m]")
            share = f"{100 * row.explained:.0f} % of the variance explained"
            axis.set_title(f"{row.joint}: {share}, gap {row.gap_rms:.1f} N·m RMS", fontsize=9.5)
        axes[-1].set(xlabel="time in the recording [s]", xlim=(start, start + length))
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
        _source(figure, "Real TIAGo: thanhndv212/figaroh-plus c3b5172; predicted: inverse dynamics of tiago_ta11.")
    return figure


def gap(overlay: Any, sensor: str, joint: str) -> Figure:
    """A load cell and a joint over a recording: measured, by the nominal and by the repaired simulator.

    Args:
        overlay: of the recording (:class:`tiago_mj.gap.result.Overlay`).
        sensor, joint: names of its channels, such as ``force.right`` and ``position.gripper_right_finger_joint``.
    """
    lines = (("measured", BLACK, "-", 3.2), ("nominal", VERMILLION, (0, (5, 1.5)), 1.5), ("repaired", BLUE, "-", 1.3))
    with rc_context(STYLE):
        figure = _figure((9.6, 2.4))
        left, right = figure.subplots(1, 2)
        for name, color, line, width in lines:
            signals = getattr(overlay, name)
            left.plot(overlay.time, signals[sensor], color=color, ls=line, lw=width, label=name)
            right.plot(overlay.time, 1e3 * signals[joint], color=color, ls=line, lw=width, label=name)
        left.set(ylabel="right load cell")
        right.set(ylabel="right finger [mm]")
        right.legend(loc="upper right")
        for axis in (left, right):
            axis.set(xlabel="time [s]", xlim=(0, overlay.time[-1]))
        _source(figure, "A recording that was kept aside: the diagnosis has not seen it.")
    return figure


def _figure(size: tuple[float, float]) -> Figure:
    figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05))
    FigureCanvasAgg(figure)
    return figure


def _rows(count: int, size: tuple[float, float], heights: Sequence[float] | None = None) -> tuple[Figure, list[Axes]]:
    figure = _figure(size)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=heights)
    return figure, list(axes[:, 0])


def _instant(axes: Sequence[Axes], time: float, color: str, text: str, *, before: bool) -> None:
    """A vertical line with a text at its left (``before``) or right."""
    for axis in axes:
        axis.axvline(time, color=color, lw=0.9, ls=(0, (2, 2)))
    axes[0].annotate(
        text,
        (time, 0.98),
        (-4 if before else 4, 0),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        ha="right" if before else "left",
        va="top",
        color=color,
    )


def _source(figure: Figure, text: str) -> None:
    figure.supxlabel(text, fontsize=7.5, color=GREY, x=0.01, ha="left")
