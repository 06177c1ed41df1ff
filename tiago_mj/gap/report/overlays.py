"""Plotly figures of measured, nominal and repaired signals: one per channel, phases shaded, the residual below.

Figures are plain dicts of Plotly's schema. Colours are left to the page, which knows whether it is light, dark or
printed: ``role`` in a trace's ``meta`` says what it shows. Curves are thinned to what a screen can show; every thinned
bucket keeps its lowest and highest sample, so that no peak is lost.
"""

from __future__ import annotations

import html
import itertools
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.result import PHASES, Overlay

Array = NDArray[np.float64]
Figure = dict[str, Any]

#: Numbers in all curves of a page together: about 1.5 MB.
NUMBERS: Final = 200_000
#: Samples of one curve: a screen has no more columns.
MOST, LEAST = 3000, 200
#: A pause this many times longer than the usual step is a gap in a curve.
PAUSE: Final = 8
#: Stretches of phases in one figure; beyond, the shortest are drawn as part of the one before.
STRETCHES: Final = 120
ROLES: Final = {"measured": "measured", "nominal": "nominal simulator", "repaired": "repaired simulator"}


def figures(overlay: Overlay, total: int) -> dict[str, Figure]:
    """One figure per measured channel.

    Args:
        overlay: a trial's signals.
        total: of figures on the page, to share the budget of numbers.
    """
    samples = int(np.clip(NUMBERS / (10 * max(total, 1)), LEAST, MOST))
    shaded = stretches(overlay.time, overlay.phases)
    return {name: _figure(overlay, name, samples, shaded) for name in overlay.measured}


def stretches(time: Array, phases: NDArray[np.int_]) -> list[tuple[int, float, float]]:
    """(phase, from, to) [s] of consecutive rows in one phase, the shortest merged until few enough are left."""
    if len(time) == 0:
        return []
    starts = np.flatnonzero(np.r_[True, np.diff(phases) != 0])
    edges = np.r_[time[starts], time[-1]]
    runs = [(int(phases[s]), float(a), float(b)) for s, a, b in zip(starts, edges[:-1], edges[1:], strict=True)]
    longest = set(sorted(range(len(runs)), key=lambda i: runs[i][1] - runs[i][2])[:STRETCHES])
    merged: list[tuple[int, float, float]] = []
    for index, (phase, a, b) in enumerate(runs):
        if merged and (merged[-1][0] == phase or index not in longest):
            merged[-1] = (merged[-1][0], merged[-1][1], b)
        else:
            merged.append((phase, a, b))
    return merged


def thinned(time: Array, values: Array, samples: int) -> tuple[list[float], list[float | None]]:
    """A curve with at most about ``samples`` points: the lowest and highest of every bucket; None breaks the line."""
    there = np.isfinite(values) & np.isfinite(time)
    x, y = time[there], values[there]
    if len(x) > samples:
        edges = np.linspace(0, len(x), samples // 2 + 1).astype(int)
        kept: set[int] = {0, len(x) - 1}
        for a, b in itertools.pairwise(edges):
            kept.update((a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b]))))
        chosen = np.array(sorted(kept))
        x, y = x[chosen], y[chosen]
    xs = [round(float(t), 5) for t in x]
    ys: list[float | None] = [float(f"{v:.6g}") for v in y]
    if len(x) > 2:
        steps = np.diff(x)
        for at in np.flatnonzero(steps > PAUSE * np.median(steps))[::-1]:
            xs.insert(at + 1, round(float((x[at] + x[at + 1]) / 2), 5))
            ys.insert(at + 1, None)
    return xs, ys


def _figure(overlay: Overlay, name: str, samples: int, shaded: list[tuple[int, float, float]]) -> Figure:
    time = overlay.time - overlay.time[0] if len(overlay.time) else overlay.time
    began = float(overlay.time[0]) if len(overlay.time) else 0.0
    unit = overlay.units.get(name, "")
    curves = {
        role: np.asarray(signals[name])
        for role, signals in _signals(overlay).items()
        if name in signals and np.isfinite(signals[name]).any()
    }
    data = [_trace(time, values, role, unit, samples) for role, values in curves.items()]
    measured = curves.get("measured")
    differences = {}
    if measured is not None:
        differences = {role: values - measured for role, values in curves.items() if role != "measured"}
    for role, values in differences.items():
        data.append({**_trace(time, values, role, unit, samples), "yaxis": "y2", "showlegend": False})
    span = float(time[-1]) if len(time) else 1.0
    shapes = [_shade(phase, a - began, b - began) for phase, a, b in shaded]
    floor = overlay.floor.get(name)
    if differences and floor is not None and np.isfinite(floor):
        shapes.append(_band(float(floor)))
    below = {
        "title": {"font": {"size": 11}, "standoff": 20, "text": _axis("sim − real", unit, "<br>")},
        "domain": [0.0, 0.33],
    }
    return {
        "data": data,
        "layout": {
            "shapes": shapes,
            "annotations": [
                _phase_name(phase, a - began, b - began)
                for phase, a, b in shaded
                if 0 <= phase < len(PHASES) and (b - a) / max(span, 1e-9) > 0.012 * len(PHASES[phase])
            ],
            "xaxis": {"title": {"text": "time [s]"}, "anchor": "y2" if differences else "y", "range": [0.0, span]},
            "yaxis": {
                "title": {"font": {"size": 11}, "standoff": 8, "text": _axis("signal", unit)},
                "domain": [0.42, 1.0] if differences else [0.0, 1.0],
            },
            **({"yaxis2": below} if differences else {}),
        },
    }


def _signals(overlay: Overlay) -> dict[str, Mapping[str, Array]]:
    return {"measured": overlay.measured, "nominal": overlay.nominal, "repaired": overlay.repaired}


def _trace(time: Array, values: Array, role: str, unit: str, samples: int) -> Figure:
    x, y = thinned(time, values, samples)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": ROLES[role],
        "meta": {"role": role},
        "hovertemplate": f"%{{y:.4g}} {html.escape(unit)}",
    }


def _shade(phase: int, start: float, end: float) -> Figure:
    name = PHASES[phase] if 0 <= phase < len(PHASES) else ""
    return {
        "type": "rect",
        "xref": "x",
        "yref": "paper",
        "x0": round(start, 5),
        "x1": round(end, 5),
        "y0": 0,
        "y1": 1,
        "line": {"width": 0},
        "layer": "below",
        "name": name,
    }


def _band(floor: float) -> Figure:
    """The noise floor, one standard deviation to either side of no residual."""
    return {
        "type": "rect",
        "xref": "paper",
        "yref": "y2",
        "x0": 0,
        "x1": 1,
        "y0": -floor,
        "y1": floor,
        "line": {"width": 0},
        "layer": "below",
        "name": "noise floor",
    }


def _phase_name(phase: int, start: float, end: float) -> Figure:
    return {
        "text": PHASES[phase],
        "x": round((start + end) / 2, 5),
        "xref": "x",
        "y": 1,
        "yref": "paper",
        "yanchor": "bottom",
        "showarrow": False,
    }


def _axis(what: str, unit: str, between: str = " ") -> str:
    return f"{what}{between}[{html.escape(unit)}]" if unit else what
