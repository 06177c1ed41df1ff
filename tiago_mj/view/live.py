"""An environment in a browser: robot, forces and goal; sliders, policies and effects; curves beside it."""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import Entry
from tiago_mj.io.quoting import one_line
from tiago_mj.view import colours, layout, scene
from tiago_mj.view.address import Address
from tiago_mj.view.live_curves import LiveCurves, short
from tiago_mj.view.live_effects import POSITIONS, EffectChoice, EffectPanel, given_by, round_step
from tiago_mj.view.server import wait
from tiago_mj.view.session import HAND, Session, session
from tiago_mj.view.shapes import Part, extent, moving

Array = NDArray[np.float64]

__all__ = ["Live", "Session", "session"]

FPS: Final = 30.0
CHARTS_HZ: Final = 8.0
SPEEDS: Final = {"1x": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1, "1/30": 1 / 30}
#: Of an arrow [m/N]: that of the 16 N that a finger has at most stays in the picture.
LENGTH: Final = 0.005
#: Arrows float so far above the pads, out of the fingers that would hide them [m].
LIFTED: Final = np.array([0.0, 0.0, 0.03])
#: A tick that would have to catch up more than this gives up on being on time [s].
LATEST: Final = 0.2
WIDTH: Final = 400
#: Points of contact that are drawn.
CONTACTS: Final = 32


class Live:
    """Scene and panels of a live environment.

    Args:
        server: a ``viser.ViserServer``.
        watched: the environment.
    """

    _redraw = True

    def __init__(self, server: Any, watched: Session) -> None:
        self._server, self._session, self._lock = server, watched, threading.RLock()
        self._last, self._behind, self._charted = time.monotonic(), 0.0, 0.0
        self._single = 0
        self._changed = False
        self._panels: dict[int, EffectPanel] = {}
        self._count = 0
        self._scene()
        self._panel()
        self._curves = LiveCurves(server.gui, watched)
        self._address = Address(server, self._layout, self._apply)
        self._draw()

    def run(self) -> None:
        """Simulate and draw until the program is told to end."""
        wait(self.tick, 1 / FPS)

    def tick(self) -> None:
        """Simulate the time that has passed, and draw."""
        with self._lock:
            watched = self._session
            if self._changed:
                self._changed = False
                self._give()
            now = time.monotonic()
            passed, self._last = min(now - self._last, LATEST), now
            if self._pause.value:
                steps, self._single = self._single, 0
            else:
                self._behind += passed * SPEEDS[str(self._speed.value)]
                steps = int(self._behind / watched.core.dt)
                self._behind -= steps * watched.core.dt
            for _ in range(steps):
                watched.step()
                if self._again.value and watched.steps >= watched.limit > 0:
                    self._reset()
                    break
            if steps or self._redraw:
                self._redraw = False
                self._draw()
            if now - self._charted > 1 / CHARTS_HZ and watched.rows:
                self._charted = now
                with self._server.atomic():
                    self._curves.draw()
            self._address.tick()

    # The scene --------------------------------------------------------------------------------------------------------

    def _scene(self) -> None:
        model = self._session.core.model
        orange = colours.rgb(colours.LOOKS["nominal"].colour)
        moves = moving(model)

        def ghostly(part: Part) -> tuple[colours.Colour, float]:
            return colours.mixed(orange, (1.0, 1.0, 1.0), 0.12), colours.LOOKS["nominal"].opacity

        still = [body for body in range(model.nbody) if not moves[body]]
        self._robot = scene.draw(self._server.scene, "/robot", model)
        self._ghost = scene.draw(self._server.scene, "/nominal", model, paint=ghostly, shadows=False, without=still)
        data = self._session.core.data
        seen = np.arange(model.nbody) > 0
        scene.furnish(self._server, model, *extent(model, data.xpos[None].copy(), seen))
        self._arrows = {
            side: self._server.scene.add_arrows(
                f"/force/{side}",
                np.array([[place, place + 1e-6]]),
                colours.rgb255(colours.RIGHT if side == "right" else colours.LEFT),
                shaft_radius=0.0022,
                head_radius=0.0055,
                head_length=0.012,
            )
            for side, place, _ in self._session.pad_forces()
        }
        self._newtons = {
            side: self._server.scene.add_label(f"/newtons/{side}", "", anchor="center-left") for side in self._arrows
        }
        self._contacts = self._server.scene.add_point_cloud(
            "/contacts", np.zeros((1, 3)), colours.rgb255(colours.CONTACT), point_size=0.004, point_shape="circle"
        )
        self._goal_arrows: dict[str, Any] = {}
        self._goal: Any = None
        if self._session.place_goal() is not None:
            self._goal = self._server.scene.add_icosphere(
                "/goal", radius=0.02, color=colours.rgb255(colours.GOAL), opacity=0.7
            )

    def _draw(self) -> None:
        watched = self._session
        core, twin = watched.core, watched.nominal
        with self._server.atomic():
            self._robot.pose(core.data.xpos, core.data.xquat)
            self._ghost.root.visible = bool(self._twin.value and watched.effects)  # else it is where the robot is
            if self._ghost.root.visible:
                self._ghost.pose(twin.data.xpos, twin.data.xquat)
            for side, place, force in watched.pad_forces():
                newtons = float(np.linalg.norm(force))
                arrow, label = self._arrows[side], self._newtons[side]
                arrow.visible = label.visible = newtons > 0.02
                if arrow.visible:
                    tip = place + LIFTED + LENGTH * force
                    arrow.points = np.array([[place + LIFTED, tip]], dtype=np.float32)
                    label.text, label.position = f"{newtons:.1f} N", tuple(tip)
            points = watched.contacts()[:CONTACTS]
            self._contacts.visible = len(points) > 0
            if len(points):
                self._contacts.points = points.astype(np.float32)
            place_goal = watched.place_goal()
            if self._goal is not None and place_goal is not None:
                self._goal.position = tuple(place_goal)

    # Panels -----------------------------------------------------------------------------------------------------------

    def _panel(self) -> None:
        gui, watched = self._server.gui, self._session
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        gui.add_html(_key(bool(self._arrows), self._goal is not None, watched.force_goal()))
        self._said = gui.add_html("")
        self._pause = gui.add_checkbox("pause", False)
        row = gui.add_button_group("", ("one step", "reset"))
        row.on_click(lambda event: self._step() if event.target.value == "one step" else self._reset_now())
        self._speed = gui.add_dropdown(
            "speed", tuple(SPEEDS), initial_value="1/4" if 1 / watched.core.dt > 100 else "1x"
        )
        self._policy = gui.add_dropdown("policy", watched.policies, initial_value=watched.commander)
        self._policy.on_update(lambda _: self._command_by(str(self._policy.value)))
        self._again = gui.add_checkbox(
            "repeat episode", watched.commander != HAND, hint=f"start anew after {watched.limit} steps"
        )
        self._twin = gui.add_checkbox(
            "nominal ghost", True, hint="the simulator without effects, given the same actions"
        )
        self._twin.on_update(lambda _: setattr(self, "_redraw", True))
        self._folder_of_sliders(gui)
        with gui.add_folder("effects"):
            choice = EffectChoice(gui, watched)
            add = gui.add_button("Add this effect")
            self._effects_folder = gui.add_folder("that act")
        add.on_click(lambda _: self._add(choice.name))
        for one in watched.effects:
            self._add(one.name, one)

    def _folder_of_sliders(self, gui: Any) -> None:
        watched, core = self._session, self._session.core
        velocity = core.control == "velocity"
        self._sliders: list[tuple[Any, float, float]] = []
        held = core.drive.held
        with gui.add_folder("actions by hand"):
            for k, joint in enumerate(watched.joints):
                if k in held:
                    continue
                low, high = float(core.drive.low[k]), float(core.drive.high[k])
                if velocity:
                    high = float(core.velocity_limit[k])
                    low = -high
                slides = core.wiring().targets.slides[k]
                unit = ("m" if slides else "rad") + ("/s" if velocity else "")
                factor, said = (1000.0, f"m{unit}") if slides else (1.0, unit)
                step = round_step(factor * (high - low) / POSITIONS)
                slider = gui.add_slider(
                    f"{short(joint)} [{said}]",
                    round(factor * low, 6),
                    round(factor * high, 6),
                    step,
                    0.0 if velocity else round(factor * float(core.state.position[k]), 6),
                )
                self._sliders.append((slider, factor * low, factor * high))
                slider.on_update(partial(self._act, k=k, low=factor * low, high=factor * high))
            if velocity:
                still = gui.add_button("Stand still")
                still.on_click(lambda _: self._still())
        self._columns = [k for k in range(len(watched.joints)) if k not in held]

    def _act(self, event: Any, k: int, low: float, high: float) -> None:
        with self._lock:
            self._session.action[k] = np.clip(2 * (float(event.target.value) - low) / (high - low) - 1, -1, 1)
            if event.client is not None and self._session.commander != HAND:
                self._say("a policy commands: choose “by hand” for the sliders to act")

    def _still(self) -> None:
        with self._lock:
            for slider, _, _ in self._sliders:
                slider.value = 0.0
            self._session.action[:] = 0.0

    def _step(self) -> None:
        with self._lock:
            self._pause.value = True
            self._single += 1

    def _reset_now(self) -> None:
        with self._lock:
            self._reset()

    def _reset(self) -> None:
        self._session.reset()
        self._behind, self._redraw = 0.0, True
        for (slider, low, high), k in zip(self._sliders, self._columns, strict=True):
            slider.value = round(low + (self._session.action[k] + 1) / 2 * (high - low), 6)

    def _command_by(self, name: str) -> None:
        with self._lock:
            try:
                self._session.command_by(name)
                self._again.value = name != HAND
                if name != HAND:
                    self._reset()
                self._say("")
            except (ValueError, ModuleNotFoundError) as fault:
                self._say(one_line(fault))

    def _say(self, text: str) -> None:
        style = f"margin:2px 12px;color:{colours.WARNING};font-size:13px"
        self._said.content = f'<div style="{style}">{html.escape(text)}</div>' if text else ""

    # Effects ----------------------------------------------------------------------------------------------------------

    def _add(self, name: str, given: Entry | None = None, *, acts: bool = True) -> None:
        with self._lock:
            key, self._count = self._count, self._count + 1
            with self._effects_folder:
                self._panels[key] = EffectPanel(
                    self._server.gui, self._session, name, given, self._touched, lambda: self._remove(key)
                )
            self._panels[key].switch(acts=acts)
            self._changed = True

    def _remove(self, key: int) -> None:
        with self._lock:
            self._panels.pop(key).remove()
            self._changed = True

    def _touched(self) -> None:
        self._changed = True

    def _give(self) -> None:
        try:
            self._session.give([one for panel in self._panels.values() if (one := panel.entry()) is not None])
            self._say("")
        except ValueError as fault:
            self._say(one_line(fault))

    # Layout in the address --------------------------------------------------------------------------------------------

    def _layout(self) -> dict[str, str]:
        return {
            **self._curves.layout,
            "policy": layout.slug(self._session.commander, self._session.policies),
            "speed": layout.slug(str(self._speed.value), list(SPEEDS)),
            "paused": "yes" if self._pause.value else "no",
            "hidden": "none" if self._twin.value else "nominal",
            "effects": layout.write_effects([panel.text for panel in self._panels.values()]) or "none",
        }

    def _apply(self, parts: Mapping[str, str]) -> None:
        with self._lock:
            self._curves.give(parts)
            policy = layout.slugs(self._session.policies).get(parts.get("policy", ""))
            if policy is not None and policy != self._session.commander:
                self._policy.value = policy
            speed = layout.slugs(list(SPEEDS)).get(parts.get("speed", ""))
            self._speed.value = speed or self._speed.value
            if "paused" in parts:
                self._pause.value = parts["paused"] == "yes"
            if "hidden" in parts:
                self._twin.value = parts["hidden"] != "nominal"
            if "effects" in parts and parts["effects"] != self._layout()["effects"]:
                self._replace(layout.read_effects(parts["effects"]))

    def _replace(self, texts: Sequence[layout.EffectText]) -> None:
        """Those effects of an address that this robot can have, in place of those that there are."""
        for key in list(self._panels):
            self._remove(key)
        for text in texts:
            given = given_by(self._session, text)
            if given is not None:
                self._add(text.name, given, acts=text.acts)


def _key(forces: bool, place: bool, goal: float | None) -> str:
    rows = []
    if forces:
        rows += [(colours.RIGHT, "force on the right pad"), (colours.LEFT, "force on the left pad")]
    rows.append((colours.CONTACT, "points of contact"))
    rows.append((colours.LOOKS["nominal"].colour, "nominal ghost: without effects, same actions"))
    if place:
        rows.append((colours.GOAL, "goal"))
    if goal is not None:
        rows.append((colours.GOAL, f"goal: {goal:.2f} N on each pad"))
    swatch = "display:inline-block;width:22px;height:11px;border-radius:2px;margin-right:8px;background:"
    said = "".join(f'<div><span style="{swatch}{colour}"></span>{text}</div>' for colour, text in rows)
    return f'<div style="font-size:13px;line-height:1.4;padding:4px 12px">{said}</div>'
