"""Curves beside a scene, as viser's charts draw them: with a line at the time that is shown, and the gap shaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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


class Chart:
    """One chart with several curves over time.

    Args:
        gui: of a viser server.
        title: what it shows, with its unit.
        names: of the curves.
        tints: of the curves, as hexadecimal digits.
        time: (n,) [s].
        values: of the curves, each (n,).
        shaded: rows that are shaded, (n,); None: nothing is.
        cursor: whether there is a line at a time.
        dashed: names of curves that are dashed.
        height: of the chart [pixel].
    """

    def __init__(
        self,
        gui: Any,
        title: str,
        names: Sequence[str],
        tints: Sequence[str],
        time: Array,
        values: Sequence[Array],
        *,
        shaded: NDArray[np.bool_] | None = None,
        cursor: bool = False,
        dashed: Sequence[str] = (),
        height: int = HEIGHT,
    ) -> None:
        self._time, self._values = time, [np.asarray(v, dtype=float) for v in values]
        self._shade = None if shaded is None else np.where(shaded, 1.0, 0.0)
        self._cursor: Array | None = np.full(len(time), np.nan) if cursor else None
        series: list[Mapping[str, Any]] = [{"label": "s"}]
        series += [
            {"label": name, "stroke": tint, "width": 1.6, **({"dash": (5, 3)} if name in dashed else {})}
            for name, tint in zip(names, tints, strict=True)
        ]
        scales: dict[str, Any] = {"x": {"time": False}}
        if self._shade is not None:
            series.append({"label": "gap", "scale": SPAN, "width": 0, "fill": f"{colours.LIT}22"})
        if self._cursor is not None:
            series.append({"label": "now", "scale": SPAN, "stroke": "#1a1f26", "width": 1})
        if self._shade is not None or self._cursor is not None:
            scales[SPAN] = {"auto": False, "range": (0.0, 1.0)}
        self.handle = gui.add_uplot(
            data=self._data(),
            series=tuple(series),
            title=title,
            scales=scales,
            axes=({"size": 34, "font": "11px sans-serif"}, {"size": 52, "font": "11px sans-serif"}),
            legend={"show": len(names) > 1 and not cursor, "live": False},
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
    """Rows that are drawn of so many."""
    return np.unique(np.linspace(0, len(time) - 1, min(samples, len(time))).astype(int))
