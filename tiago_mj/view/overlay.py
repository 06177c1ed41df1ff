"""Two channels over one another in one chart, each with an axis of its own, chosen while one looks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.view import colours, layout

Array = NDArray[np.float64]

#: Colours of the first and the second channel, and of their axes.
COLOURS: Final = (colours.CURVE, colours.GOAL)
#: Height of the chart [pixel], and the choice that draws no second channel.
HEIGHT: Final = 200
NOTHING: Final = "nothing"


class Overlay:
    """Two dropdowns, and the chart of what they choose.

    Args:
        gui: of a viser server.
        channels: labels with their units, in their order.
        read: time (T,) [s] and values (T,) of a channel by its label.
        chosen: the two that are shown at first.
        kept: told of every control that is made.

    Attributes:
        chosen: labels of the two channels.
    """

    def __init__(
        self,
        gui: Any,
        channels: Sequence[str],
        read: Callable[[str], tuple[Array, Array]],
        chosen: tuple[str, str],
        kept: Callable[[Any], Any] = lambda control: control,
    ) -> None:
        self._read = read
        self._names = tuple(channels), (NOTHING, *channels)
        first = kept(gui.add_dropdown("channel", self._names[0], initial_value=chosen[0]))
        second = kept(gui.add_dropdown("over it", self._names[1], initial_value=chosen[1]))
        self._choices = first, second
        self._chart = kept(
            gui.add_uplot(
                data=self._data(),
                series=self._series(),
                scales={"x": {"time": False}, "y": {"auto": True}, "over": {"auto": True}},
                axes=self._axes(),
                legend={"show": True, "live": False},
                cursor={"show": True, "drag": {"x": True, "y": False}},
                height=HEIGHT,
            )
        )
        for one in self._choices:
            one.on_update(lambda _: self.draw(changed=True))

    @property
    def chosen(self) -> tuple[str, str]:
        """Labels of the first and the second channel."""
        return str(self._choices[0].value), str(self._choices[1].value)

    @property
    def layout(self) -> str:
        """Both channels as an address has them."""
        return ",".join(layout.slug(one, names) for one, names in zip(self.chosen, self._names, strict=True))

    def give(self, text: str) -> None:
        """Choose the channels of an address; one that there is not stays as it is."""
        for control, names, short in zip(self._choices, self._names, text.split(","), strict=False):
            label = layout.slugs(names).get(short)
            if label is not None and label != control.value:
                control.value = label

    def draw(self, *, changed: bool = False) -> None:
        """Draw the channels as they are now; ``changed``: other ones than before."""
        if changed:
            self._chart.series, self._chart.axes = self._series(), self._axes()
        self._chart.data = self._data()

    def _data(self) -> tuple[Array, ...]:
        first, second = self.chosen
        time, values = self._read(first)
        if second == NOTHING:
            return time, values, np.full(len(time), np.nan)
        when, others = self._read(second)
        over = others if len(when) == len(time) else np.interp(time, when, others)
        return time, values, over

    def _series(self) -> tuple[Mapping[str, Any], ...]:
        first, second = self.chosen
        return (
            {"label": "s"},
            {"label": first, "stroke": COLOURS[0], "width": 1.6},
            {"label": second, "stroke": COLOURS[1], "width": 1.6, "scale": "over"},
        )

    def _axes(self) -> tuple[Mapping[str, Any], ...]:
        font = "11px sans-serif"
        there = self.chosen[1] != NOTHING
        return (
            {"size": 34, "font": font},
            {"size": 52, "font": font, "stroke": COLOURS[0]},
            {"size": 52, "font": font, "stroke": COLOURS[1], "side": 1, "scale": "over", "show": there},
        )
