"""Curves beside a scene, drawn by viser's charts: with a line at the time that is shown, and the gap shaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.view import colours

Array = NDArray[np.float64]

#: Samples of a chart, however many rows there are.
SAMPLES: Final = 400
#: Height of a chart [pixel].
HEIGHT: Final = 150
#: A scale from 0 to 1 for what is no signal: the line of the time, and the shade.
SPAN: Final = "span"


@dataclass(frozen=True)
class Curve:
    """One curve of a chart: its name, its colour as hexadecimal digits, its values (n,), whether it is dashed."""

    name: str
    colour: str
    values: Array
    dashed: bool = False


class Chart:
    """One chart with several curves over time.

    Args:
        gui: of a viser server.
        title: what it shows, with its unit.
        time: (n,) [s].
        curves: over that time.
        shaded: of a recording: rows in which the gap lies, (n,), shaded behind a line at the time that is shown;
            None: no shade and no line.
        height: of the chart [pixel].
    """

    def __init__(
        self,
        gui: Any,
        title: str,
        time: Array,
        curves: Sequence[Curve],
        *,
        shaded: NDArray[np.bool_] | None = None,
        height: int = HEIGHT,
    ) -> None:
        self._time, self._values = time, [np.asarray(curve.values, dtype=float) for curve in curves]
        self._shade = None if shaded is None else np.where(shaded, 1.0, 0.0)
        self._cursor: Array | None = None if shaded is None else np.full(len(time), np.nan)
        series: list[Mapping[str, Any]] = [{"label": "s"}]
        series += [
            {"label": curve.name, "stroke": curve.colour, "width": 1.6, **({"dash": (5, 3)} if curve.dashed else {})}
            for curve in curves
        ]
        scales: dict[str, Any] = {"x": {"time": False}}
        if shaded is not None:
            series.append({"label": "gap", "scale": SPAN, "width": 0, "fill": f"{colours.LIT}22"})
            series.append({"label": "now", "scale": SPAN, "stroke": colours.CURVE, "width": 1})
            scales[SPAN] = {"auto": False, "range": (0.0, 1.0)}
        self.handle = gui.add_uplot(
            data=self._data(),
            series=tuple(series),
            title=title,
            scales=scales,
            axes=({"size": 34, "font": "11px sans-serif"}, {"size": 52, "font": "11px sans-serif"}),
            legend={"show": len(curves) > 1 and shaded is None, "live": False},
            cursor={"show": True, "drag": {"x": True, "y": False}},
            height=height,
        )

    def at(self, time: float) -> None:
        """Draw the line at a time [s]."""
        if self._cursor is None or len(self._time) < 3:
            return
        k = int(np.clip(np.searchsorted(self._time, time), 1, len(self._time) - 2))
        self._cursor[:] = np.nan
        self._cursor[k - 1 : k + 2] = 0.0, 1.0, 0.0
        self.handle.data = self._data()

    def give(self, time: Array, values: Sequence[Array]) -> None:
        """Draw other curves."""
        self._time, self._values = time, list(values)
        self.handle.data = self._data()

    def _data(self) -> tuple[Array, ...]:
        more = [one for one in (self._shade, self._cursor) if one is not None]
        return (self._time, *self._values, *more)


def thin(time: Array, samples: int = SAMPLES) -> NDArray[np.intp]:
    """Indices of at most ``samples`` evenly spaced rows."""
    return np.unique(np.linspace(0, len(time) - 1, min(samples, len(time))).astype(int))
