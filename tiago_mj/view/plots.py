"""Curves of a story as SVG paths, in pixels."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.report import words
from tiago_mj.gap.report.overlays import thinned
from tiago_mj.io.quantities import bare, number, scaled
from tiago_mj.view.story import Mark, Story, curves

Array = NDArray[np.float64]

#: Size of a plot, and the space around its axes: left, right, top, bottom [pixel].
WIDTH, HEIGHT, LOW = 380, 128, 92
AROUND: Final = (50, 8, 8, 20)
#: Samples of a curve.
SAMPLES: Final = 700
#: Plots of a page.
PLOTS: Final = 3


@dataclass(frozen=True)
class Line:
    """One curve: its robot, path and colour."""

    role: str
    path: str


@dataclass(frozen=True)
class Plot:
    """One channel.

    Attributes:
        title: what it is, with its unit.
        height: of all of it [pixel].
        lines: of the robots.
        ticks: of the vertical axis: height [pixel] and number.
        times: of the horizontal axis: place [pixel] and number.
        marks: where the gap is: place and width [pixel].
    """

    title: str
    height: int
    lines: tuple[Line, ...]
    ticks: tuple[tuple[float, str], ...]
    times: tuple[tuple[float, str], ...]
    marks: tuple[tuple[float, float], ...]


def plots(story: Story, most: int = PLOTS) -> tuple[Plot, ...]:
    """Plots of the channels with the largest gap, each with the simulators' differences below it."""
    out = []
    for name in shown(story, most):
        out.append(plot(story, name))
        if away := differences(story, name):
            out.append(_plot(story, "simulated − measured", away, story.signals.units.get(name, ""), LOW))
    return tuple(out)


def differences(story: Story, name: str) -> Mapping[str, Array]:
    """Simulated minus measured curves of a channel, by role, each (T,)."""
    of = curves(story.signals, name)
    return {role: values - of["measured"] for role, values in of.items() if role != "measured"}


def shown(story: Story, most: int) -> list[str]:
    """Channels to be drawn: those with the largest gap, positions before the velocities of the same joint."""
    kinds = {"position": 0, "force": 0, "effort": 0, "velocity": 1}
    return sorted(story.channels, key=lambda name: kinds.get(name.partition(".")[0], 1))[:most]


def plot(story: Story, name: str) -> Plot:
    """Curves of one channel."""
    return _plot(
        story, words.begin(words.channel(name)), curves(story.signals, name), story.signals.units.get(name, "")
    )


def _plot(story: Story, title: str, of: Mapping[str, Array], unit: str, height: int = HEIGHT) -> Plot:
    factor, unit = unit_of(of.values(), unit)
    ends = [factor * v[np.isfinite(v)] for v in of.values() if np.isfinite(v).any()]
    # What runs away must not flatten what was measured.
    low, high = _range(factor * next(iter(of.values())), ends)
    left, right, top, bottom = AROUND
    start, end = float(story.time[0]), float(story.time[-1])

    def x(time: float) -> float:
        return round(left + (time - start) / max(end - start, 1e-9) * (WIDTH - left - right), 1)

    def y(value: float) -> float:
        inside = min(max(value, low - (high - low)), high + (high - low))
        return round(top + (high - inside) / (high - low) * (height - top - bottom), 1)

    lines = []
    for role, values in of.items():
        times, heights = thinned(story.time, factor * values, SAMPLES)
        path, pen = [], "M"
        for time, value in zip(times, heights, strict=True):
            if value is None:
                pen = "M"
                continue
            path.append(f"{pen}{x(time):g} {y(value):g}")
            pen = "L"
        lines.append(Line(role, "".join(path)))
    return Plot(
        title=f"{title}{f' [{unit}]' if unit else ''}",
        height=height,
        lines=tuple(lines),
        ticks=tuple((y(value), bare(number(value))) for value in nice(low, high, 4 if height == HEIGHT else 3)),
        times=tuple((x(value), f"{value:g}") for value in nice(start, end, 5)),
        marks=tuple(
            (x(mark.start), round(x(mark.end) - x(mark.start), 1)) for mark in visible(story.marks, start, end)
        ),
    )


def unit_of(values: Collection[Array], unit: str) -> tuple[float, str]:
    """Factor and display unit of a channel: millimetres for small metres, radians stay."""
    largest = max((float(np.nanmax(np.abs(v))) for v in values if np.isfinite(v).any()), default=0.0)
    return scaled(largest, unit)


def nice(low: float, high: float, most: int) -> list[float]:
    """At most ``count`` round numbers within a range."""
    span = high - low
    if not span > 0:
        return [low]
    step = 10.0 ** np.floor(np.log10(span / most))
    while span / step > most:
        step *= 2.5 if str(f"{step:e}").startswith("2.0") else 2
    first = np.ceil(low / step - 1e-9) * step
    return [round(float(v), 10) + 0.0 for v in np.arange(first, high + 1e-9 * span, step)]


def visible(marks: Sequence[Mark], start: float, end: float) -> list[Mark]:
    """Marks within a stretch of time."""
    return [mark for mark in marks if mark.end > start and mark.start < end]


def _range(measured: Array, ends: Sequence[Array]) -> tuple[float, float]:
    everything = np.concatenate(ends) if ends else np.zeros(1)
    seen = measured[np.isfinite(measured)] if np.isfinite(measured).any() else everything
    span = max(float(np.ptp(seen)), 1e-9)
    low = max(float(everything.min()), float(seen.min()) - 2 * span)
    high = min(float(everything.max()), float(seen.max()) + 2 * span)
    pad = 0.06 * (high - low) if high > low else max(abs(high), 1.0) * 0.05
    return low - pad, high + pad
