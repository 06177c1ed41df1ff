"""Controls of the effects of a live environment."""

from __future__ import annotations

import html
from typing import Any, Final

import numpy as np

from tiago_mj.effects import EFFECTS, Entry
from tiago_mj.effects.transmission.gear import Backlash
from tiago_mj.gap.report import words
from tiago_mj.gap.report.tables import STAGE_NAMES
from tiago_mj.io.quantities import scaled
from tiago_mj.view import colours, layout
from tiago_mj.view.session import Session, entry, knobs, offered, whom

#: Positions that a slider has.
POSITIONS: Final = 200


class EffectChoice:
    """Which effect is to be added: its stage of the signal chain, and its plain name there."""

    def __init__(self, gui: Any, watched: Session) -> None:
        self._by_stage: dict[str, dict[str, str]] = {}
        for name in offered(watched):
            stage = STAGE_NAMES[EFFECTS[name].stage]
            self._by_stage.setdefault(stage, {})[words.title(name)] = name
        first = STAGE_NAMES[Backlash.stage]
        stages = [stage for stage in STAGE_NAMES.values() if stage in self._by_stage]
        self._stage = gui.add_dropdown("stage", tuple(stages), initial_value=first if first in stages else stages[0])
        self._effect = gui.add_dropdown("effect", self._there(), initial_value=self._begin())
        self._stage.on_update(lambda _: self._other_stage())

    @property
    def name(self) -> str:
        """Of the effect that is chosen."""
        return self._by_stage[str(self._stage.value)][str(self._effect.value)]

    def _there(self) -> tuple[str, ...]:
        return tuple(self._by_stage[str(self._stage.value)])

    def _begin(self) -> str:
        wanted = words.title(Backlash.name)
        return wanted if wanted in self._there() else self._there()[0]

    def _other_stage(self) -> None:
        self._effect.options = self._there()
        self._effect.value = self._begin()


class EffectPanel:
    """Controls of one effect: on or off, targets, magnitudes."""

    def __init__(self, gui: Any, watched: Session, name: str, given: Entry | None, touched: Any, removed: Any) -> None:
        self._gui, self._session, self._name, self._touched = gui, watched, name, touched
        self._choices = whom(watched, name)
        self._folder = gui.add_folder(words.title(name))
        self._sliders: dict[str, tuple[Any, float]] = {}
        first = next(iter(self._choices))
        if given is not None:
            first = next((label for label, them in self._choices.items() if them == given.target), first)
        with self._folder:
            style = f"font-size:12px;line-height:1.35;color:{colours.SOFT};padding:2px 12px"
            gui.add_html(f'<div style="{style}">{html.escape(words.meaning(name))}</div>')
            self._on = gui.add_checkbox("acts", True)
            self._target = None
            if len(self._choices) > 1:
                self._target = gui.add_dropdown("on", tuple(self._choices), initial_value=first)
                self._target.on_update(lambda _: self._retarget())
            self._knobs = gui.add_folder("magnitude")
            self._remove = gui.add_button("Remove", color="gray")
        self._on.on_update(lambda _: touched())
        self._remove.on_click(lambda _: removed())
        self._make_sliders({} if given is None else dict(given.parameters))

    def entry(self) -> Entry | None:
        """The effect as set by the controls; None while it is off."""
        if not self._on.value:
            return None
        values = {name: float(slider.value) / factor for name, (slider, factor) in self._sliders.items()}
        return entry(self._name, self._chosen(), values)

    @property
    def text(self) -> layout.EffectText:
        """The effect as an address has it."""
        target = next(iter(self._choices)) if self._target is None else str(self._target.value)
        values = {name: float(slider.value) / factor for name, (slider, factor) in self._sliders.items()}
        return layout.EffectText(self._name, layout.slug(target, list(self._choices)), values, bool(self._on.value))

    def switch(self, *, acts: bool) -> None:
        """Switch the effect on or off."""
        self._on.value = acts

    def remove(self) -> None:
        """Take the controls away."""
        self._folder.remove()

    def _chosen(self) -> tuple[str, ...] | None:
        if self._target is None:
            return next(iter(self._choices.values()))
        return self._choices[str(self._target.value)]

    def _retarget(self) -> None:
        for slider, _ in self._sliders.values():
            slider.remove()
        self._make_sliders({})
        self._touched()

    def _make_sliders(self, values: dict[str, float]) -> None:
        self._sliders = {}
        with self._knobs:
            for knob in knobs(self._session, self._name, self._chosen()):
                value = values.get(knob.name, knob.default)
                low, high = min(knob.low, value), max(knob.high, value)
                factor, unit = scaled(abs(knob.default), knob.unit)
                label = f"{knob.name.replace('_', ' ')}{f' [{unit}]' if unit else ''}"
                slider = self._gui.add_slider(
                    label, factor * low, factor * high, round_step(factor * (high - low) / POSITIONS), factor * value
                )
                slider.on_update(lambda _: self._touched())
                self._sliders[knob.name] = slider, factor


def given_by(watched: Session, text: layout.EffectText) -> Entry | None:
    """Effect of an address on a robot, its values within what the sliders have; None where the robot has no such."""
    if text.name not in offered(watched):
        return None
    choices = whom(watched, text.name)
    label = layout.slugs(list(choices)).get(text.target)
    if label is None:
        return None
    values = {
        knob.name: float(np.clip(text.values.get(knob.name, knob.default), knob.low, knob.high))
        for knob in knobs(watched, text.name, choices[label])
    }
    return entry(text.name, choices[label], values)


def round_step(size: float) -> float:
    """A power of ten no larger than a size."""
    return float(10.0 ** np.floor(np.log10(max(size, 1e-9))))
