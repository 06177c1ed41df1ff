"""Curves beside a live environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.report import words
from tiago_mj.models.names import SIDES
from tiago_mj.view import colours, layout
from tiago_mj.view.charts import Chart, Curve, thin
from tiago_mj.view.overlay import Overlay
from tiago_mj.view.session import Row, Session

Array = NDArray[np.float64]

#: Seconds of the past in the charts, and their width [pixel].
PAST: Final = 4.0
LEFT: Final = 360
#: How a finger's name begins, which leaves no room on a slider.
GRIPPER: Final = "the gripper's "


class LiveCurves:
    """Charts of the last seconds: force, position of a chosen joint, its difference from the nominal twin, reward."""

    def __init__(self, gui: Any, watched: Session) -> None:
        self._session = watched
        panel = gui.add_panel()
        panel.dock_left()
        panel.set_width(LEFT)
        self._charts: dict[str, Chart] = {}
        blank, none = np.array([0.0, 1e-3]), np.full(2, np.nan)
        ink, red = colours.CURVE, colours.LOOKS["nominal"].colour
        with panel.add_tab("curves"):
            if watched.pad_forces():
                force = [Curve("right", colours.RIGHT, none), Curve("left", colours.LEFT, none)]
                if watched.force_goal() is not None:
                    force.append(Curve("goal", colours.GOAL, none, dashed=True))
                self._charts["force"] = Chart(gui, "force on the pads [N]", blank, force, height=190)
            self._labels = {short(joint): k for k, joint in enumerate(watched.joints)}
            self._joint = gui.add_dropdown("joint", tuple(self._labels), initial_value=list(self._labels)[-1])
            position = [
                Curve("set point", colours.GOAL, none, dashed=True),
                Curve("measured", ink, none),
                Curve("nominal", red, none, dashed=True),
            ]
            self._charts["joint"] = Chart(gui, "its position [mm, rad]", blank, position, height=210)
            off = "measured − nominal"
            self._charts["off"] = Chart(gui, f"{off} [mm, rad]", blank, [Curve(off, ink, none)], height=130)
            self._charts["reward"] = Chart(gui, "reward", blank, [Curve("reward", ink, none)], height=130)
            self._channels = self._known()
            self._shown: list[Row] = []
            with gui.add_folder("two curves over one another"):
                names = tuple(self._channels)
                self._overlay = Overlay(gui, names, self._read, (names[0], names[-1]))

    def _known(self) -> dict[str, Callable[[Row], float]]:
        """What can be drawn over one another: a number of a row, by its label."""
        known: dict[str, Callable[[Row], float]] = {}
        for k, joint in enumerate(self._session.joints):
            unit = "m" if self._session.core.wiring().targets.slides[k] else "rad"
            for what in ("position", "set_point", "nominal"):
                said = what.replace("_", " ")
                known[f"{short(joint)}: {said} [{unit}]"] = partial(_entry, what, k)
        if self._session.pad_forces():
            for k, side in enumerate(SIDES):
                known[f"force {side} [N]"] = partial(_entry, "force", k)
                known[f"load cell {side} [sensor units]"] = partial(_entry, "reading", k)
        return known | {"reward": attrgetter("reward")}

    def _read(self, label: str) -> tuple[Array, Array]:
        rows = self._shown
        if len(rows) < 2:
            return np.array([0.0, 1e-3]), np.full(2, np.nan)
        return np.array([row.time for row in rows]), np.array([self._channels[label](row) for row in rows])

    @property
    def layout(self) -> dict[str, str]:
        """What is drawn, as an address has it."""
        joint = layout.slug(str(self._joint.value), list(self._labels))
        return {"over": self._overlay.layout, "joint": joint}

    def give(self, parts: Mapping[str, str]) -> None:
        """Draw what an address asks for."""
        joint = layout.slugs(list(self._labels)).get(parts.get("joint", ""))
        if joint is not None:
            self._joint.value = joint
        self._overlay.give(parts.get("over", ""))

    def draw(self) -> None:
        """Draw what happened in the last seconds."""
        watched = self._session
        rows = list(watched.rows)
        first = next((k for k, row in enumerate(rows) if row.time >= rows[-1].time - PAST), 0)
        rows = [rows[first + k] for k in thin(np.arange(len(rows) - first, dtype=float))]
        if len(rows) < 2:
            return
        moments = np.array([row.time for row in rows])
        k = self._labels[str(self._joint.value)]
        factor = 1000.0 if watched.core.wiring().targets.slides[k] else 1.0
        measured = factor * np.array([row.position[k] for row in rows])
        nominal = factor * np.array([row.nominal[k] for row in rows])
        if "force" in self._charts:
            goal = watched.force_goal()
            force = [np.array([row.force[side] for row in rows]) for side in (0, 1)]
            more = [] if goal is None else [np.full(len(rows), goal)]
            self._charts["force"].give(moments, [*force, *more])
        set_point = factor * np.array([row.set_point[k] for row in rows])
        self._charts["joint"].give(moments, [set_point, measured, nominal])
        self._charts["off"].give(moments, [measured - nominal])
        self._shown = rows
        self._overlay.draw()
        self._charts["reward"].give(moments, [np.array([row.reward for row in rows])])


def _entry(what: str, k: int, row: Row) -> float:
    return float(getattr(row, what)[k])


def short(joint: str) -> str:
    """A joint's name as a slider has room for it."""
    return words.part(joint, "joint").removeprefix(GRIPPER)
