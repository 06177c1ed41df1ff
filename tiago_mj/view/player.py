"""Recordings in a browser: the robots on their stage, one time line, and the curves beside it."""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from tiago_mj.gap.report import words
from tiago_mj.io.quoting import one_line
from tiago_mj.view import colours, layout, plots
from tiago_mj.view.address import Address
from tiago_mj.view.charts import Chart, Curve, thin
from tiago_mj.view.overlay import Overlay
from tiago_mj.view.page import slow_motion
from tiago_mj.view.server import DROPPED, in_browser, wait
from tiago_mj.view.stage import LARGER, Stage
from tiago_mj.view.story import Story, curves

#: Pictures a second.
FPS: Final = 30.0
#: How fast it plays: label, and seconds of the recording in a second.
SPEEDS: Final = {"1x": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1, "1/20": 0.05}
#: The charts' line of the time moves so many times a second: each move sends the curves again.
CHARTS_HZ: Final = 8.0
PLACES: Final = ("ghosts in one place", "side by side")
WIDTH: Final = 430


class Player:
    """Scene and panel that play recordings.

    Args:
        server: a ``viser.ViserServer``.
        trials: names of those that can be chosen.
        tell: story of a trial, by its name.
        first: trial that is shown at first.
        beside: whether the robots stand side by side at first.
        add: takes a recording that is dropped on the page, by its name and content, and returns the trials that can be
            chosen then, its own last; raises ValueError with a line where it cannot be used. None: none is taken.

    Attributes:
        stage: with the robots.
    """

    stage: Stage
    _charts: list[Chart]
    _again: bool
    _charted: int
    _boxes: dict[str, Any]
    _overlay: Overlay | None

    def __init__(
        self,
        server: Any,
        trials: Sequence[str],
        tell: Callable[[str], Story],
        first: str,
        *,
        beside: bool = False,
        add: Callable[[str, bytes], Sequence[str]] | None = None,
    ) -> None:
        self._server, self._tell, self._lock = server, tell, threading.RLock()
        self._beside = beside
        self._clock, self._drawn, self._last = 0.0, 0.0, time.monotonic()
        self._wanted: str | None = None
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(WIDTH)
        self._controls: list[Any] = []
        self._choice = server.gui.add_dropdown("recording", tuple(trials), initial_value=first, visible=len(trials) > 1)
        self._choice.on_update(lambda _: self._want(str(self._choice.value)))
        if add is not None:
            self._said = server.gui.add_html("")
            button = server.gui.add_upload_button("Add a recording", hint="or drop one on the page")
            button.on_upload(lambda _: self._add(button.value, add))
            server.on_client_connect(lambda client: in_browser(client, DROPPED))
        self._begin(tell(first))
        self._address = Address(server, self._layout, self._apply)

    def run(self) -> None:
        """Play and draw until the program is told to end."""
        wait(self.tick, 1 / FPS)

    def tick(self) -> None:
        """Advance the time line by the time that has passed, and draw."""
        with self._lock:
            if self._wanted is not None:
                story, self._wanted = self._tell(self._wanted), None
                self._begin(story)
            now = time.monotonic()
            passed, self._last = now - self._last, now
            start, end = self._span
            if self._playing.value:
                self._clock += passed * SPEEDS[str(self._speed.value)]
                if self._clock > end:
                    self._clock = start
                self._slider.value = round(self._clock, 3)
            row = int(np.clip(np.searchsorted(self.stage.story.time, self._clock), 0, len(self.stage.story.time) - 1))
            if row != self.stage.row or self._again:
                self._again = False
                self.stage.show(row)
            if now - self._drawn > 1 / CHARTS_HZ and self._charted != row:
                self._drawn, self._charted = now, row
                for chart in self._charts:
                    chart.at(self._clock)
            self._address.tick()

    def _add(self, file: Any, add: Callable[[str, bytes], Sequence[str]]) -> None:
        """Take a recording and show it; or say why it cannot be used."""
        with self._lock:
            try:
                names = tuple(add(str(file.name), bytes(file.content)))
            except ValueError as fault:
                style = f"margin:2px 12px;color:{colours.WARNING};font-size:13px"
                self._said.content = f'<div style="{style}">{html.escape(one_line(fault))}</div>'
                return
            self._said.content = ""
            self._choice.options, self._choice.visible = names, True
            self._choice.value = names[-1]
            self._want(names[-1])

    def _want(self, trial: str) -> None:
        self._wanted = trial

    def _begin(self, story: Story) -> None:
        """Show another story."""
        for control in self._controls:
            control.remove()
        self._server.scene.reset()
        self.stage = Stage(self._server, story, beside=self._beside)
        self._span = float(story.time[0]), float(story.time[-1])
        self._clock, self._charted, self._again = self._span[0], -1, True
        self._controls, self._boxes, self._overlay = [], {}, None
        gui = self._server.gui
        self._keep(gui.add_html(legend(story)))
        self._time_line(gui, story)
        self._how_drawn(gui, story)
        self._charts = []
        for name in plots.shown(story, plots.PLOTS):
            self._charts += self._charts_of(gui, story, name)
        self._over_one_another(gui, story)

    def _keep(self, control: Any) -> Any:
        self._controls.append(control)
        return control

    def _time_line(self, gui: Any, story: Story) -> None:
        start, end = self._span
        marks = tuple((round(mark.start, 3), "gap" if k == 0 else "") for k, mark in enumerate(story.marks[:8]))
        self._slider = self._keep(
            gui.add_slider("time [s]", start, max(end, start + 1e-3), 0.001, start, marks=marks or None)
        )

        def go(event: Any) -> None:
            if event.client is not None:  # a hand, not the clock
                with self._lock:
                    self._clock = float(self._slider.value)

        self._slider.on_update(go)
        self._playing = self._keep(gui.add_checkbox("play", True))
        slower = slow_motion(end - start)
        speed = min(SPEEDS, key=lambda name: abs(SPEEDS[name] - 1 / slower))
        self._speed = self._keep(gui.add_dropdown("speed", tuple(SPEEDS), initial_value=speed))
        if story.marks:
            button = self._keep(gui.add_button("Go to the gap"))
            button.on_click(lambda _: self._go(story.marks[0].start))

    def _go(self, moment: float) -> None:
        with self._lock:
            self._playing.value = False
            self._clock = moment
            self._slider.value = round(moment, 3)

    def _how_drawn(self, gui: Any, story: Story) -> None:
        if len(story.motions) == 1:
            return
        folder = self._keep(gui.add_folder("robots"))
        with folder:
            place = self._place = gui.add_dropdown("where", PLACES, initial_value=PLACES[int(self._beside)])
            larger = self._larger = gui.add_dropdown(
                "differences", tuple(f"{k} times" for k in LARGER), initial_value=f"{self.stage.larger} times"
            )
            for motion in story.motions:
                box = self._boxes[motion.role] = gui.add_checkbox(colours.LOOKS[motion.role].name, True)
                box.on_update(lambda event, role=motion.role: self._hide(role, not event.target.value))

        def arrange(_: Any) -> None:
            with self._lock:
                self._beside = place.value == PLACES[1]
                self.stage.arrange(self._beside)

        def enlarge(_: Any) -> None:
            with self._lock:
                self.stage.larger = int(str(larger.value).partition(" ")[0])
                self._again = True

        place.on_update(arrange)
        larger.on_update(enlarge)

    def _hide(self, role: str, hidden: bool) -> None:
        with self._lock:
            self.stage.hide(role, hidden)

    def _layout(self) -> dict[str, str]:
        """The view as an address has it: the time only while it stands still."""
        parts = {
            "recording": layout.slug(str(self._choice.value), self._choice.options),
            "speed": layout.slug(str(self._speed.value), list(SPEEDS)),
            "paused": "no" if self._playing.value else "yes",
            "time": "" if self._playing.value else layout.rounded([self._clock]),
            "over": "" if self._overlay is None else self._overlay.layout,
        }
        if self._boxes:
            parts["where"] = layout.slug(str(self._place.value), PLACES)
            parts["larger"] = str(self.stage.larger)
            parts["hidden"] = ",".join(role for role, box in self._boxes.items() if not box.value) or "none"
        return parts

    def _apply(self, parts: Mapping[str, str]) -> None:
        with self._lock:
            name = layout.slugs(self._choice.options).get(parts.get("recording", ""))
            if name is not None and name != self._choice.value:
                self._choice.value = name
                self._begin(self._tell(name))
                self._wanted = None
            speed = layout.slugs(list(SPEEDS)).get(parts.get("speed", ""))
            self._speed.value = speed or self._speed.value
            if "paused" in parts:
                self._playing.value = parts["paused"] != "yes"
            moment = layout.numbers(parts.get("time", ""), 1)
            if moment is not None:
                self._go(float(np.clip(moment[0], *self._span)))
            if self._overlay is not None:
                self._overlay.give(parts.get("over", ""))
            if self._boxes:
                self._apply_drawn(parts)

    def _apply_drawn(self, parts: Mapping[str, str]) -> None:
        place = layout.slugs(PLACES).get(parts.get("where", ""))
        self._place.value = place or self._place.value
        if parts.get("larger", "") in map(str, LARGER):
            self._larger.value = f"{parts['larger']} times"
        if "hidden" in parts:
            for role, box in self._boxes.items():
                box.value = role not in parts["hidden"].split(",")

    def _over_one_another(self, gui: Any, story: Story) -> None:
        """Any two curves of the recording over one another."""
        rows = thin(story.time)
        known: dict[str, tuple[str, str]] = {}
        for name in story.channels:
            for role in curves(story.signals, name):
                unit = story.signals.units.get(name, "")
                said = f"{words.channel(name)}, {colours.LOOKS[role].name}"
                known[f"{said} [{unit}]" if unit else said] = name, role
        measured = [label for label, (_, role) in known.items() if role == "measured"]
        if len(known) < 2:
            return

        def read(label: str) -> tuple[Any, Any]:
            name, role = known[label]
            return story.time[rows], curves(story.signals, name)[role][rows]

        with self._keep(gui.add_folder("two curves over one another")):
            first = measured[0], measured[1] if len(measured) > 1 else list(known)[1]
            self._overlay = Overlay(gui, tuple(known), read, first)

    def _charts_of(self, gui: Any, story: Story, name: str) -> list[Chart]:
        rows = thin(story.time)
        moments = story.time[rows]
        shaded = np.zeros(len(rows), dtype=bool)
        for mark in story.marks:
            shaded |= (moments >= mark.start) & (moments <= mark.end)
        made = []
        title = words.begin(words.channel(name))
        for what, of, height in (
            (title, curves(story.signals, name), 150),
            ("simulated − measured", plots.differences(story, name), 110),
        ):
            if not of:
                continue
            factor, unit = plots.unit_of(list(of.values()), story.signals.units.get(name, ""))
            chart = Chart(
                gui,
                f"{what} [{unit}]" if unit else what,
                moments,
                [
                    Curve(colours.LOOKS[role].name, colours.in_charts(role), factor * values[rows], role == "nominal")
                    for role, values in of.items()
                ],
                shaded=shaded,
                height=height,
            )
            self._keep(chart.handle)
            made.append(chart)
        return made


def legend(story: Story) -> str:
    """Legend as HTML: what was found, and the colours of the robots."""
    rows = [_row(colours.in_charts(m.role), colours.LOOKS[m.role].name) for m in story.motions]
    if story.lit:
        rows.append(_row(colours.LIT, story.where))
    if story.marks:
        rows.append(_row(f"{colours.LIT}33", "where most of the gap is"))
    notes = list(story.notes)
    if story.unmeasured and len(story.motions) > 1:
        notes.append("Where the object was is not recorded: only the simulators have one.")
    said = "".join(f'<p style="margin:4px 0;color:{colours.SOFT}">{html.escape(note)}</p>' for note in notes)
    verdict = f'<div style="font-weight:600;margin:0 0 6px">{html.escape(story.verdict)}</div>' if story.verdict else ""
    head = f'<div style="color:{colours.SOFT}">{html.escape(story.robot)}</div>'
    return f'<div style="font-size:13px;line-height:1.4;padding:4px 12px">{head}{verdict}{"".join(rows)}{said}</div>'


def _row(colour: str, text: str) -> str:
    swatch = f"display:inline-block;width:22px;height:11px;border-radius:2px;margin-right:8px;background:{colour}"
    return f'<div><span style="{swatch}"></span>{html.escape(text)}</div>'
