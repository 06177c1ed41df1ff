"""Predictions of many explanations for many trials, each physics run made once.

What the simulator's step gets wrong is the same for all of them but for little: it is taken from the nominal model, run
once more with shorter steps, and put right in every prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap import floor, replay, score
from tiago_mj.gap.effects.spec import Entry
from tiago_mj.gap.plant import Plant
from tiago_mj.gap.recording import RecordingError, Trial
from tiago_mj.gap.replay import Grid, Signals, sensor_only

Array = NDArray[np.float64]
Effects = tuple[Entry, ...]

#: Effects that draw at random are predicted by the mean over this many draws.
DRAWS = 6
RANDOM = ("dropped_commands", "force_dropout")


@dataclass
class Predictor:
    """Runs and remembers simulations of one plant and its trials.

    Attributes:
        plant, on, data: what is simulated and compared.
        threads: of the batches.
        seed: of random effects.
        off: what the step makes wrong in the nominal signals of every trial (:func:`tiago_mj.gap.floor.off_by_step`);
            None: not known, predictions are as they are simulated.
        runs: number of physics simulations made.
    """

    plant: Plant
    on: Grid
    data: floor.Data
    threads: int = 0
    seed: int = 0
    off: Signals | None = None
    runs: int = 0
    _kept: dict[tuple[int, Effects], tuple[Array, ...]] = field(default_factory=dict)

    def __call__(self, wanted: Sequence[tuple[int, Effects]], *, keep: bool = False) -> Array:
        """Predicted channels, (nwanted, T, C), of (trial, effects) pairs.

        Args:
            wanted: pairs; effects that draw at random are averaged over draws.
            keep: remember the physics for later calls (of the nominal model, say).
        """
        drawn = self.on.luck is None
        draws = [
            DRAWS if drawn and any(e.name in RANDOM and not sensor_only(e) for e in effects) else 1
            for _, effects in wanted
        ]
        keys: dict[tuple[int, Effects, int], None] = {}
        for (trial, effects), count in zip(wanted, draws, strict=True):
            physics = tuple(e for e in effects if not sensor_only(e))
            for draw in range(count):
                keys[(trial, physics, draw)] = None
        true = self._physics(list(keys), keep)
        rows, sims, owner = [], [], []
        for k, ((trial, effects), count) in enumerate(zip(wanted, draws, strict=True)):
            physics = tuple(e for e in effects if not sensor_only(e))
            for draw in range(count):
                rows.append(true[(trial, physics, draw)])
                sims.append((trial, tuple(e for e in effects if sensor_only(e) and e.name not in RANDOM)))
                owner.append(k)
        signals = Signals(*(np.stack(parts) for parts in zip(*rows, strict=True)))
        measuring = np.array([bool(effects) for _, effects in sims])
        if measuring.any():
            index = np.nonzero(measuring)[0]
            some = Signals(*(getattr(signals, f)[index] for f in Signals.__dataclass_fields__))
            measured = replay.measure(self.plant, self.on, some, [sims[i] for i in index], seed=self.seed)
            for name in ("position", "velocity", "reading"):
                getattr(signals, name)[index] = getattr(measured, name)
        channels = floor.predicted(self.data, signals)
        if len(owner) == len(wanted):
            return channels
        total = np.zeros((len(wanted), *channels.shape[1:]))
        np.add.at(total, owner, channels)
        return total / np.array(draws)[:, None, None]

    def all_trials(self, explanations: Sequence[Effects], trials: Sequence[int], *, keep: bool = False) -> Array:
        """(nexplanations, ntrials, T, C): every explanation on every trial."""
        wanted = [(t, effects) for effects in explanations for t in trials]
        out = self(wanted, keep=keep)
        return out.reshape(len(explanations), len(trials), *out.shape[1:])

    def with_luck(self, luck: Array) -> Predictor:
        """The same with the commands that were lost, (ntrials, T - 1, nactuators), instead of drawn ones."""
        kept = {key: run for key, run in self._kept.items() if not any(entry.name in RANDOM for entry in key[1])}
        return replace(self, on=replace(self.on, luck=luck), runs=0, _kept=kept)

    def closely(self) -> Predictor:
        """The same with the shorter steps that ``off`` is known from: for what changes what the step gets wrong."""
        if self.off is None:
            return self
        plant = replace(self.plant, max_timestep=self.plant.max_timestep / floor.FINER)
        off = Signals(*(getattr(self.off, f) / floor.FINER for f in Signals.__dataclass_fields__))
        return Predictor(plant, self.on, self.data, self.threads, self.seed, off)

    def _physics(
        self, keys: list[tuple[int, Effects, int]], keep: bool
    ) -> dict[tuple[int, Effects, int], tuple[Array, ...]]:
        done = {key: self._kept[_plain(key)] for key in keys if _plain(key) in self._kept}
        for draw in sorted({key[2] for key in keys}):
            todo = [key for key in keys if key not in done and key[2] == draw]
            if not todo:
                continue
            self.runs += len(todo)
            seed = self.seed + 7919 * draw
            signals = replay.simulate(
                self.plant, self.on, [(t, e) for t, e, _ in todo], threads=self.threads, seed=seed
            )
            if self.off is not None:
                index = [t for t, _, _ in todo]
                signals = Signals(
                    *(getattr(signals, f) - getattr(self.off, f)[index] for f in Signals.__dataclass_fields__)
                )
            for row, key in enumerate(todo):
                done[key] = tuple(getattr(signals, f)[row] for f in Signals.__dataclass_fields__)
                if keep:
                    self._kept[_plain(key)] = done[key]
        return done


def predictor(
    plant: Plant, trials: Sequence[Trial], usable: frozenset[str] | None = None, *, threads: int = 0, seed: int = 0
) -> tuple[Predictor, Signals]:
    """Everything that trials are compared with, and the nominal replay of each, one row a trial.

    Args:
        plant: of the trials.
        trials: recorded.
        usable: channels that are trusted; None for all.
        threads, seed: of the simulations.

    Raises:
        RecordingError: the recordings hold nothing that can be compared; one line.
    """
    on = replay.grid(plant, trials)
    data = floor.collect(plant, trials, usable)
    if not data.channels:
        raise RecordingError(
            f"{trials[0].source}: no measured column is of this robot ({', '.join(plant.joints)}): give a map file"
        )
    everything: list[tuple[int, Effects]] = [(k, ()) for k in range(len(trials))]
    nominal = replay.simulate(plant, on, everything, threads=threads, seed=seed)
    fine = replace(plant, max_timestep=plant.max_timestep / floor.FINER)
    finer = replay.simulate(fine, on, everything, threads=threads, seed=seed)
    as_simulated, off = floor.predicted(data, nominal), floor.off_by_step(nominal, finer)
    data = floor.with_numerics(data, as_simulated, floor.predicted(data, finer))
    # What was recorded in this very simulator is off by the same steps.
    same = score.distance(data, as_simulated) < score.distance(data, as_simulated - floor.predicted(data, off))
    return Predictor(plant, on, data, threads, seed, None if same else off), nominal


def _plain(key: tuple[int, Effects, int]) -> tuple[int, Effects]:
    return key[0], (*key[1], Entry("draw", (str(key[2]),))) if key[2] else key[1]
