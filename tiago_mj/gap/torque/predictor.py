"""Predicted efforts of many explanations along measured motions: inverse dynamics in the place of a simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.spec import Entry, arrays
from tiago_mj.gap.inference.predictor import Array, Effects, Predictor
from tiago_mj.gap.torque.torques import STAGES, Torques

#: Rows that are compared per period of the cut-off. Noise behind the filter is then as good as independent from row to
#: row: with reality's own numbers, residuals of six arms had an integrated time of 1.0 to 1.4 rows.
ROWS_PER_PERIOD: Final = 1.25


@dataclass
class EffortPredictor(Predictor):
    """Efforts along the motions of one plant's trials.

    Attributes:
        torques: of each trial.
        whole: of all trials, one after the other: one explanation is asked for all of them at once. None: each alone.
        every: rows of the torques' grid per row that is compared.
    """

    torques: tuple[Torques, ...] = ()
    whole: Torques | None = None
    every: int = 1
    _known: dict[tuple[int, Effects], Array] = field(default_factory=dict)

    @property
    def replays(self) -> bool:
        """No: efforts are compared along a motion."""
        return False

    def __call__(self, wanted: Sequence[tuple[int, Effects]], *, keep: bool = False) -> Array:
        """Predicted efforts, (nwanted, T, C) [N, N·m], of (trial, effects) pairs; 0 where a trial is over.

        Args:
            wanted: pairs.
            keep: remember them for later calls.

        Raises:
            OutOfTimeError: the deadline is over.
        """
        asked: dict[Effects, list[int]] = {}
        for trial, effects in wanted:
            if (trial, effects) not in self._known:
                asked.setdefault(effects, []).append(trial)
        done = {}
        for effects, trials in asked.items():
            for trial, one in self._efforts(effects, trials):
                done[(trial, effects)] = one
        if keep:
            self._known.update(done)
        out = np.zeros((len(wanted), *self.data.value.shape[1:]))
        for k, key in enumerate(wanted):
            found = done[key] if key in done else self._known[key]
            out[k, : len(found)] = found
        return out

    def with_delivered(self, delivered: Array) -> Predictor:
        """The same: nothing was commanded."""
        return self

    def as_simulated(self) -> Predictor:
        """The same: there is no physics step whose error could be put right."""
        return self

    def beside_each(self, explanations: Sequence[Effects], trials: Sequence[int]) -> Array:
        """As :meth:`all_trials`, as of :meth:`as_simulated`."""
        return self.all_trials(explanations, trials)

    def corrected_beside(self, wanted: Sequence[tuple[int, Effects]]) -> Predictor:
        """The same, as of :meth:`as_simulated`."""
        return self

    def with_step_correction(self, share: float) -> Predictor | None:
        """None, as of :meth:`as_simulated`."""
        del share
        return None

    def _efforts(self, effects: Effects, trials: Sequence[int]) -> Iterator[tuple[int, Array]]:
        """What a recording says of the efforts of some trials, (T, C) each [N, N·m]."""
        whole = self.whole if len(trials) > 1 and self.whole is not None else None
        for torques, mine in ((whole, trials),) if whole is not None else ((self.torques[t], [t]) for t in trials):
            along = torques.by(self.deadline)
            effort, course = along.of([e for e in effects if EFFECTS[e.name].stage in STAGES]), along.course
            late = sum(_delay(entry) for entry in effects)
            if late:
                effort = course.shifted(effort, late)
            read = _read(along, effects, effort)[:, course.columns]
            steps = len(mine) * self.data.value.shape[1]
            self.tally.update(simulations=len(mine), physics_steps=steps)
            self.simulated(steps)
            for trial in mine:
                yield trial, (read if whole is None else read[self._rows(trial)])[:: self.every]

    def _rows(self, trial: int) -> slice:
        """Of a trial in the whole course."""
        lengths = [sum(one.course.lengths) for one in self.torques]
        return slice(sum(lengths[:trial]), sum(lengths[: trial + 1]))


def _delay(entry: Entry) -> float:
    """By how much an effect makes the measured motion late [s]."""
    name = EFFECTS[entry.name].delays_readings
    return float(entry.parameters.get(name, EFFECTS[entry.name].parameters[name].default[0])) if name else 0.0


def _read(torques: Torques, effects: Effects, effort: Array) -> Array:
    """What a recording says of efforts, (T, m) [N, N·m]."""
    targets, read = torques.wiring.targets, effort
    for name in dict.fromkeys(entry.name for entry in effects):
        if overrides(EFFECTS[name], "measure_effort"):
            effect = arrays(EFFECTS[name], [[e for e in effects if e.name == name]], targets)
            read = read.copy()
            read[:, list(targets.actuated)] = effect.measure_effort(read[:, list(targets.actuated)])
    return read
