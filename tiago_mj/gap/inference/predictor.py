"""Predictions of many explanations for many trials, each physics run made once.

What the simulator's step gets wrong is the same for all of them but for little: it is taken from the nominal model, run
once more with shorter steps, and put right in every prediction that is compared with a finer reality. What is reported
is what the simulator itself does, its step's error included (:meth:`Predictor.as_simulated`).

A robot's filters and delays act while a row lasts. Where rows are long, sensors' effects with a memory are applied to
signals in parts of rows (:func:`tiago_mj.gap.simulation.replay.parts_of`), which only they need.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import is_random
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import likelihood, noise_model, step_tolerance
from tiago_mj.gap.simulation import replay, stability
from tiago_mj.gap.simulation.made import Made, Run
from tiago_mj.gap.simulation.plant import Plant, substeps
from tiago_mj.gap.simulation.replay import Grid, Signals, sensor_only
from tiago_mj.io import mujoco_log
from tiago_mj.io.deadline import Deadline
from tiago_mj.io.journal import Journal, digest
from tiago_mj.recordings.recording import RecordingError, Trial

Array = NDArray[np.float64]
Effects = tuple[Entry, ...]
#: Trial, effects on the physics, number of the draw.
Key = tuple[int, Effects, int]

#: Effects that draw at random are predicted by the mean over this many draws.
DRAWS = 6
#: In a tally: what was asked for and is remembered. Budgets count it, so that an answer does not depend on memory.
REPEATED: Final = {"simulations": "repeated", "physics_steps": "repeated_steps"}


@dataclass
class Predictor:
    """Runs and remembers simulations of one plant and its trials.

    Attributes:
        plant, on, data: what is simulated and compared; the plant's given effects are part of every prediction.
        threads: of the batches.
        seed: of random effects.
        off: what the step makes wrong in the nominal signals of every trial
            (:func:`tiago_mj.gap.inference.step_tolerance.step_errors`), in parts of rows
            (:func:`tiago_mj.gap.simulation.replay.parts_of`) where sensors' effects with a memory are asked for; None:
            not known.
        corrected: share of that which is put right where it is known: 1 for a robot, 0 for predictions as they are
            simulated; a half for what was recorded in a simulator with half the step, as MuJoCo's integrators err in
            proportion to it.
        between: whether sensors' effects with a memory act between rows, as a robot's do; else at rows alone, as the
            environments' do.
        rounded: whether readings are rounded where an effect rounds them; else they are what is rounded: a likelihood
            knows the grid (:mod:`tiago_mj.gap.inference.between`).
        runs: number of physics simulations made.
        tally: numbers of ``simulations`` and of ``physics_steps`` that were asked for, how many of either were made
            before (:data:`REPEATED`), and how many simulations ``diverged``, of this one and all that were made of it.
        simulated: told the physics steps of every batch, once it is done.
        deadline: asked while simulations run, which it ends (:class:`tiago_mj.io.deadline.OutOfTimeError`).
        journal: of finished work (:mod:`tiago_mj.gap.inference.remembered`).
        made: simulations, by the digest of trial, effects on the physics, draw and parts of each row's period.
    """

    plant: Plant
    on: Grid
    data: noise_model.Data
    threads: int = 0
    seed: int = 0
    off: Signals | None = None
    corrected: float = 1.0
    rounded: bool = False
    between: bool = True
    runs: int = 0
    tally: Counter[str] = field(default_factory=Counter)
    simulated: Callable[[int], None] = lambda steps: None
    deadline: Deadline = field(default_factory=Deadline)
    journal: Journal = field(default_factory=Journal)
    made: Made = field(default_factory=Made)
    _kept: dict[tuple[int, Effects], Run] = field(default_factory=dict)
    #: Step's errors by trial and effects on the physics.
    _beside: dict[tuple[int, Effects], Run] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.made.are_by(self.plant, self.on, self.seed):
            self.made = Made(self.plant, self.on, self.seed)

    def __call__(self, wanted: Sequence[tuple[int, Effects]], *, keep: bool = False) -> Array:
        """Predicted channels, (nwanted, T, C), of (trial, effects) pairs.

        Args:
            wanted: pairs; effects that draw at random are averaged over draws.
            keep: remember the physics for later calls (of the nominal model, say).
        """
        given = tuple(e for e in self.plant.given if not sensor_only(e) or self._measures(e))
        draws = [DRAWS if self._is_drawn(effects) else 1 for _, effects in wanted]
        finest = replay.parts_of(self.plant) if self.between else 1
        of, sims, owner, cut = [], [], [], []
        for k, ((trial, effects), count) in enumerate(zip(wanted, draws, strict=True)):
            physics = tuple(e for e in effects if not sensor_only(e))
            sensing = tuple(e for e in effects if self._measures(e))
            parts = finest if any(replay.remembers(e) for e in (*given, *sensing)) else 1
            for draw in range(count):
                of.append((trial, physics, draw))
                sims.append((trial, sensing))
                owner.append(k)
                cut.append(parts)
        keys = dict.fromkeys(of, 1)
        for key, parts in zip(of, cut, strict=True):
            keys[key] = max(keys[key], parts)
        true = self._physics(keys, keep)
        if self.off is not None and self.corrected:
            true = {key: self._step_corrected(key[0], run) for key, run in true.items()}
        signals = self._stacked([true[key] for key in of], 1)
        measuring = np.array([bool(effects) or any(sensor_only(e) for e in self.plant.given) for _, effects in sims])
        for parts in sorted(set(cut)):
            index = np.flatnonzero(measuring & (np.array(cut) == parts))
            if not len(index):
                continue
            some, plant = self._stacked([true[of[i]] for i in index], parts), replace(self.plant, given=given)
            measured = replay.measure(plant, self.on, some, [sims[i] for i in index], seed=self.seed, parts=parts)
            for name in ("position", "velocity", "reading"):
                getattr(signals, name)[index] = getattr(measured, name)
        channels = noise_model.predicted(self.data, signals)
        if len(owner) == len(wanted):
            return channels
        total = np.zeros((len(wanted), *channels.shape[1:]))
        np.add.at(total, owner, channels)
        return total / np.array(draws)[:, None, None]

    @property
    def replays(self) -> bool:
        """Whether commands are replayed; else efforts are compared along a motion."""
        return True

    @property
    def physics_steps(self) -> int:
        """Physics steps that were simulated, of this one and all that were made of it."""
        return self.tally["physics_steps"] - self.tally[REPEATED["physics_steps"]]

    @property
    def samples_kept(self) -> int:
        """Samples of the physics that is remembered: it grows whenever more is."""
        return sum(len(run[0]) for run in self._kept.values())

    def all_trials(self, explanations: Sequence[Effects], trials: Sequence[int], *, keep: bool = False) -> Array:
        """(nexplanations, ntrials, T, C): every explanation on every trial."""
        wanted = [(t, effects) for effects in explanations for t in trials]
        out = self(wanted, keep=keep)
        return out.reshape(len(explanations), len(trials), *out.shape[1:])

    def with_delivered(self, delivered: Array) -> Predictor:
        """The same with the commands that were lost, (ntrials, T - 1, nactuators), instead of drawn ones."""
        given = any(is_random(EFFECTS[entry.name]) for entry in self.plant.given)
        kept = {
            key: run
            for key, run in self._kept.items()
            if not given and all(not is_random(EFFECTS[e.name]) for e in key[1])
        }
        return replace(self, on=replace(self.on, delivered=delivered), runs=0, _kept=kept, _beside={})

    def as_simulated(self) -> Predictor:
        """The same with the error of the physics step in it, its readings rounded, and its sensors at work at the rows
        alone: what the environment, or the repaired model, does."""
        return replace(self, corrected=0.0, rounded=True, between=False)

    def beside_each(self, explanations: Sequence[Effects], trials: Sequence[int]) -> Array:
        """(nexplanations, ntrials, T, C), as :meth:`all_trials`: each with its own step's error put right, readings
        rounded where an effect rounds them."""
        by = [replace(self, rounded=True).corrected_beside([(t, one) for t in trials]) for one in explanations]
        return np.stack([one.all_trials([effects], trials)[0] for one, effects in zip(by, explanations, strict=True)])

    def corrected_beside(self, wanted: Sequence[tuple[int, Effects]]) -> Predictor:
        """The same with the step's error in some trials found beside an explanation, not beside the nominal model;
        itself where that is not put right.

        Args:
            wanted: trial and effects on the physics, of each; where these draw at random, nothing is found.
        """
        drawn = self.on.delivered is None
        sims = [(trial, tuple(e for e in effects if not sensor_only(e))) for trial, effects in wanted]
        some = any(is_random(EFFECTS[e.name]) for _, effects in sims for e in (*self.plant.given, *effects))
        if self.off is None or not self.corrected or not sims or (drawn and some):
            return self
        missing = [key for key in dict.fromkeys(sims) if key not in self._beside]
        if missing and not self._find_step_errors(missing):
            return self
        off = {f: getattr(self.off, f).copy() for f in Signals.__dataclass_fields__}
        for key in sims:
            for one, found in zip(off.values(), self._beside[key], strict=True):
                one[key[0]] = found
        return replace(self, off=Signals(**off))

    def _find_step_errors(self, sims: Sequence[tuple[int, Effects]]) -> bool:
        """Remember the step's error of some simulations; False where one of them diverges, with none remembered."""
        bare, parts = replay.unmeasured(self.plant), replay.parts_of(self.plant)
        runs = self._simulated([(*key, 0) for key in sims], parts)
        coarse = self._stacked([runs[(*key, 0)] for key in sims], parts)
        plant = _refined(bare, parts)
        finer = replay.simulate(plant, self.on, sims, replay.Run(self.threads, self.seed, self.deadline, parts))
        self._count(len(sims), replay.physics_steps(plant, self.on), diverged=int(finer.diverged.sum()))
        if coarse.diverged.any() or finer.diverged.any():
            return False
        found = step_tolerance.step_errors(coarse, finer)
        for k, key in enumerate(sims):
            self._beside[key] = tuple(getattr(found, f)[k].copy() for f in Signals.__dataclass_fields__)
        return True

    def with_step_correction(self, share: float) -> Predictor | None:
        """The same with a share of the step's error put right; None: it is not known."""
        return None if self.off is None else replace(self, corrected=share)

    def by_shares(self, wanted: Sequence[tuple[int, Effects]], shares: Sequence[float]) -> Array:
        """(nshares, nwanted, T, C): predicted channels of (trial, effects) pairs with each of several shares of the
        step's error put right, from the same physics."""
        remembering = replace(self, _kept=dict(self._kept))
        return np.stack([replace(remembering, corrected=share)(wanted, keep=True) for share in shares])

    def _measures(self, entry: Entry) -> bool:
        """Whether an effect is applied to signals: of those that draw at random none is, as a reading that was missed
        is no other reading."""
        return sensor_only(entry) and not is_random(EFFECTS[entry.name]) and (self.rounded or not rounds(entry))

    def _step_corrected(self, trial: int, run: Run) -> Run:
        assert self.off is not None
        off = tuple(getattr(self.off, f)[trial] for f in Signals.__dataclass_fields__)
        parts = min(self._parts(run), self._parts(off))
        pairs = zip(self._cut(run, parts), self._cut(off, parts), strict=True)
        return tuple(one - self.corrected * wrong for one, wrong in pairs)

    def _parts(self, run: Run) -> int:
        """Of each row's period."""
        return (len(run[0]) - 1) // self.on.commands.shape[1]

    def _cut(self, run: Run, parts: int) -> Run:
        """In so many parts of each row's period, of which it has a multiple."""
        return tuple(one[:: self._parts(run) // parts] for one in run)

    def _stacked(self, runs: Sequence[Run], parts: int) -> Signals:
        return Signals(*(np.stack(columns) for columns in zip(*(self._cut(run, parts) for run in runs), strict=True)))

    def _is_drawn(self, effects: Effects) -> bool:
        """Whether effects, or those given, draw at random what happens to the physics."""
        return self.on.delivered is None and any(
            is_random(EFFECTS[e.name]) and not sensor_only(e) for e in (*self.plant.given, *effects)
        )

    def _count(self, simulations: int, steps: int, again: int = 0, diverged: int = 0) -> None:
        """Simulations of so many physics steps each that were asked for, some of which were made before."""
        self.tally.update(simulations=simulations, physics_steps=simulations * steps, diverged=diverged)
        self.tally.update({REPEATED["simulations"]: again, REPEATED["physics_steps"]: again * steps})
        self.simulated((simulations - again) * steps)

    def _physics(self, keys: Mapping[Key, int], keep: bool) -> dict[Key, Run]:
        """Signals of keys, in at least as many parts of each row's period as their values say."""
        done = {}
        for key, parts in keys.items():
            run = self._kept.get(_plain(key))
            if run is not None and self._parts(run) >= parts:
                done[key] = run
        for draw in sorted({key[2] for key in keys}):
            todo = [key for key in keys if key not in done and key[2] == draw]
            if not todo:
                continue
            for key, run in self._simulated(todo, max(keys[key] for key in todo)).items():
                done[key] = run
                if keep or _plain(key) in self._kept:  # it is kept already, but in fewer parts
                    # Copies: a view would keep its whole batch.
                    self._kept[_plain(key)] = tuple(one.copy() for one in self._cut(run, keys[key]))
        return done

    def _simulated(self, keys: Sequence[Key], parts: int) -> dict[Key, Run]:
        """Signals of different keys of one draw, in parts of each row's period: simulated, or remembered."""
        names = {key: _name(key, parts) for key in keys if not self._is_drawn(key[1])}
        again = [key for key, name in names.items() if name in self.made]
        runs = {key: run for key in again if (run := self.made.get(names[key])) is not None}
        with mujoco_log.counted():  # an earlier run has made these, and told what MuJoCo warned of
            runs |= self._simulate([key for key in again if key not in runs], parts)[0]
        fresh = [key for key in keys if key not in runs]
        made, diverged = self._simulate(fresh, parts)
        runs |= made
        for key, name in names.items():
            self.made.keep(name, runs[key])
        self._count(len(keys), replay.physics_steps(self.plant, self.on), len(again), diverged)
        return runs

    def _simulate(self, keys: Sequence[Key], parts: int) -> tuple[dict[Key, Run], int]:
        """Signals of keys of one draw, in parts of each row's period, and how many of them diverged."""
        if not keys:
            return {}, 0
        self.runs += len(keys)
        how = replay.Run(self.threads, self.seed + 7919 * keys[0][2], self.deadline, parts)
        sims = [(trial, effects) for trial, effects, _ in keys]
        signals = replay.simulate(replay.unmeasured(self.plant), self.on, sims, how)
        each = [tuple(getattr(signals, f)[row] for f in Signals.__dataclass_fields__) for row in range(len(keys))]
        return dict(zip(keys, each, strict=True)), int(signals.diverged.sum())


def predictor(
    plant: Plant,
    trials: Sequence[Trial],
    usable: noise_model.Usable | None = None,
    *,
    threads: int = 0,
    seed: int = 0,
    deadline: Deadline | None = None,
) -> tuple[Predictor, Signals]:
    """Everything that trials are compared with, and the nominal replay of each, one row a trial.

    Args:
        plant: of the trials.
        trials: recorded.
        usable: channels that are trusted, of all trials or by their sources; None for all.
        threads, seed: of the simulations.
        deadline: of the simulations, and of the predictor's; None: there is none.

    Raises:
        RecordingError: the recordings hold nothing that can be compared; one line.
        OutOfTimeError: the deadline is over.
    """
    by = deadline or Deadline()
    on = replay.grid(plant, trials)
    data = noise_model.collect(plant, trials, usable)
    if not data.channels:
        raise RecordingError(
            f"{trials[0].source}: no measured column is of this robot ({', '.join(plant.joints)}): give a map file"
        )
    everything: list[tuple[int, Effects]] = [(k, ()) for k in range(len(trials))]
    bare, parts = replay.unmeasured(plant), replay.parts_of(plant)
    how = replay.Run(threads, seed, by, parts)
    true = replay.simulate(bare, on, everything, how)
    stability.check_nominal(plant, on, true.thinned(parts))
    finer = true
    # Where a model makes one step for each row, its servo acts as often as the robot is commanded, as a digital control
    # does: shorter steps are another control, and nothing is put right.
    if not _steps_with_rows(plant):
        finer = replay.simulate(_refined(bare, parts), on, everything, how)
    known = finer is not true and not finer.diverged.any()
    if not known:  # a step that is not fine enough tells nothing of another
        finer = true
    off = step_tolerance.step_errors(true, finer)
    if bare.given != plant.given:
        sensed = replace(
            plant,
            given=tuple(e for e in plant.given if not sensor_only(e) or not (is_random(EFFECTS[e.name]) or rounds(e))),
        )
        nominal, finer = (replay.measure(sensed, on, one, everything, seed=seed, parts=parts) for one in (true, finer))
    else:
        nominal, finer = true.thinned(parts), finer.thinned(parts)
    as_simulated = noise_model.predicted(data, nominal)
    data = step_tolerance.with_step_tolerance(data, as_simulated, noise_model.predicted(data, finer))
    # What was recorded in this very simulator is off by the same steps: decided anew beside explanations (select).
    same = likelihood.distance(data, as_simulated) < likelihood.distance(
        data, as_simulated - noise_model.predicted(data, off.thinned(parts))
    )
    wrong = off if known else None
    return Predictor(plant, on, data, threads, seed, wrong, corrected=float(known and not same), deadline=by), nominal


def _steps_with_rows(plant: Plant) -> bool:
    """Whether a user's own model makes one physics step for each row of the recordings.

    EMPS's control compares and holds once a millisecond, as its model does: with its published numbers it meets the
    motion to 2.4 µm, with a quarter of the step to 44 µm, and without all its friction to 27 µm.
    """
    return plant.environment is None and substeps(plant.period, plant.max_timestep) == 1


def _refined(plant: Plant, parts: int) -> Plant:
    """With physics steps that are :data:`~tiago_mj.gap.inference.step_tolerance.STEP_REFINEMENT` times shorter, or a
    little more, so that each part of a row has whole ones."""
    steps = substeps(plant.period, plant.max_timestep / step_tolerance.STEP_REFINEMENT)
    return replace(plant, max_timestep=plant.period / (math.ceil(steps / parts) * parts))


def rounds(entry: Entry) -> bool:
    """Whether an effect rounds readings, and does nothing else."""
    return EFFECTS[entry.name].rounds is not None


def _name(key: Key, parts: int) -> str:
    """Of a simulation, the same in every process."""
    trial, effects, draw = key
    each = [(e.name, e.target, [(name, float(v)) for name, v in sorted(e.parameters.items())]) for e in effects]
    return digest((trial, each, draw, parts))[:16]


def _plain(key: Key) -> tuple[int, Effects]:
    return key[0], (*key[1], Entry("draw", (str(key[2]),))) if key[2] else key[1]
