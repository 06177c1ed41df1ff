"""Predictions of explanations for one set of trials, and how they respond to the nominal model's own numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.hypotheses import Candidate, OwnNumber, Term
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.points import NUISANCE_STEP, Point
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation.subset import Subset

Array = NDArray[np.float64]


@dataclass
class Linearized:
    """One set of trials, what predicts them, and linear responses to nuisances around a point.

    Attributes:
        predict: simulations.
        trials: indices of the trials.
        data: measured, of these trials.
        weight: square root of what a sample of each channel counts for, (C,).
        terms: nuisance parameters.
        responses: change of the predictions per deviation of each term, (nterms, ntrials, T, C): of the nominal
            model's, or around another point (:meth:`linearized_at`); those that every trial has of its own come last.
        given: effects that are part of whatever is predicted.
    """

    predict: Predictor
    trials: Subset
    data: Data
    weight: Array
    terms: tuple[Term, ...]
    responses: Array
    given: tuple[Entry, ...] = ()

    def __post_init__(self) -> None:
        self.shared = [k for k, term in enumerate(self.terms) if not term.per_trial]
        self._own = [k for k, term in enumerate(self.terms) if term.per_trial]
        own = [(k, self.terms[term]) for k, term in enumerate(self.shared)]
        self._of_effects = [(k, term) for k, term in own if isinstance(term, OwnNumber)]
        self.per_trial = np.array([term.per_trial for term in self.terms], dtype=bool)

    @property
    def size(self) -> int:
        """Number of nuisance parameters."""
        return len(self.shared) + len(self._own) * len(self.trials)

    @property
    def acting(self) -> NDArray[np.bool_]:
        """Mask of the trials in which candidates act, (ntrials,): here all."""
        return np.ones(len(self.trials), dtype=bool)

    @property
    def acting_trials(self) -> tuple[int, ...]:
        """Indices of the trials in which candidates act."""
        return tuple(trial for trial, acts in zip(self.trials, self.acting, strict=True) if acts)

    @property
    def motion_counts(self) -> float:
        """What a sample of the joints' motion counts for."""
        of_joints = [kind != "force" for kind in self.data.kinds]
        return float(np.mean(self.weight[of_joints] ** 2)) if any(of_joints) else 0.0

    def selection_penalty(self, part: Candidate) -> float:
        """What it costs to have chosen what an effect drew at random [nats]: told by the joints' motion, by samples
        that count for what they do here."""
        return (
            self.motion_counts * sum(part.selection_penalty[trial] for trial in self.acting_trials)
            if part.selection_penalty
            else 0.0
        )

    def nuisance_indices(self, term: int) -> list[int]:
        """Where a nuisance parameter stands among the nuisances: once, or once a trial."""
        if term in self.shared:
            return [self.shared.index(term)]
        return list(range(len(self.shared) + self._own.index(term), self.size, len(self._own)))

    def effects(self, parts: Sequence[Candidate], values: Array, nuisance: Array, trial: int) -> tuple[Entry, ...]:
        """What is simulated for a trial (by its position among the trials)."""
        chosen = [part.entry(float(v)) for part, v in zip(parts, values, strict=True)]
        for k, own in self._of_effects:
            chosen = [
                replace(one, parameters={**one.parameters, own.parameter: own.of(one.target, float(nuisance[k]))})
                if one.name == own.effect
                else one
                for one in chosen
            ]
        chosen = [*self.given, *chosen]
        for k, term in enumerate(self.shared):
            if nuisance[k] and not isinstance(self.terms[term], OwnNumber):
                chosen.append(self.terms[term].entry(float(nuisance[k])))
        base = len(self.shared) + trial * len(self._own)
        for k, term in enumerate(self._own):
            if nuisance[base + k]:
                chosen.append(self.terms[term].entry(float(nuisance[base + k])))
        return tuple(chosen)

    def predictions(self, points: Sequence[Point], *, keep: bool = False) -> Array:
        """(npoints, ntrials, T, C); ``keep``: remember the physics, for what only measures differently."""
        out = self.predict(self.wanted(points), keep=keep)
        return out.reshape(len(points), len(self.trials), *out.shape[1:])

    def wanted(self, points: Sequence[Point]) -> list[tuple[int, tuple[Entry, ...]]]:
        """What is simulated for points: trial and effects, of each point on every trial."""
        return [(t, self.effects(p.parts, p.values, p.nuisance, k)) for p in points for k, t in enumerate(self.trials)]

    def part(self, rows: Sequence[int]) -> Self:
        """Of some of the trials, by their positions among them."""
        return replace(
            self,
            trials=self.trials.at(rows),
            data=noise_model.select_trials(self.data, rows),
            responses=self.responses[:, list(rows)],
        )

    def of(self, rows: Sequence[int], nuisance: Array) -> Array:
        """Nuisances of some of the trials, of those of all."""
        shared = len(self.shared)
        own = nuisance[shared:].reshape(len(self.trials), len(self._own))
        return np.concatenate([nuisance[:shared], own[list(rows)].ravel()])

    def linearized_at(self, at: Point) -> Self:
        """The same with nuisance responses linearized at a point: contacts make responses depend on the point."""
        return self.linearized_at_each([at])[0]

    def linearized_at_each(self, points: Sequence[Point]) -> list[Self]:
        """The same linearized at each of several points, simulated in one batch."""
        asked = [[at, *self.nudged(at)] for at in points]
        predicted = self.predictions([one for some in asked for one in some]) if asked else np.empty(0)
        each = predicted.reshape(len(points), -1, *predicted.shape[1:])
        return [replace(self, responses=(some[1:] - some[0]) / NUISANCE_STEP) for some in each]

    def change_by(self, nuisance: Array) -> Array:
        """Change of the predictions by a change of the nuisances, (ntrials, T, C), as far as responses are linear."""
        shared = len(self.shared)
        own = nuisance[shared:].reshape(len(self.trials), len(self._own))
        of_all: Array = np.tensordot(nuisance[:shared], self.responses[:shared], axes=1)
        return of_all + np.einsum("tk,ktrc->trc", own, self.responses[shared:])

    def nudged(self, at: Point) -> list[Point]:
        """A little further in each nuisance; those that every trial has of its own all at once, and last."""
        return [at.nudged(which) for which in self.each_nuisance()]

    def each_nuisance(self) -> list[slice]:
        """Where each term stands among the nuisances, in the order of :meth:`in_order`."""
        own = [slice(len(self.shared) + k, None, len(self._own)) for k in range(len(self._own))]
        return [*(slice(k, k + 1) for k in range(len(self.shared))), *own]

    def in_order(self) -> list[int]:
        """Terms, those that every trial has of its own last."""
        return [*self.shared, *self._own]

    def duplicating_nuisances(self, part: Candidate) -> list[int]:
        """Places of nuisances that are the same number as a magnitude: of the same effect on some of its targets."""
        terms = [
            k for k, term in enumerate(self.terms) if (term.effect, term.parameter) == (part.effect, part.parameter)
        ]
        mine = [k for k in terms if part.target is None or set(self.terms[k].target or ()) <= set(part.target)]
        return [place for k in mine if not self.terms[k].per_trial for place in self.nuisance_indices(k)]

    def without_duplicates(self, point: Point) -> Point:
        """The point with each nuisance that is the same physical number as a magnitude added to that and set to 0."""
        values, nuisance = point.values.copy(), point.nuisance.copy()
        for k, part in enumerate(point.parts):
            twins = self.duplicating_nuisances(part)
            if not twins or not nuisance[twins].any():
                continue
            move = float(np.mean([nuisance[place] * self.terms[self.shared[place]].deviation for place in twins]))
            moved = values[k] * np.exp(move) if self.terms[self.shared[twins[0]]].factor else values[k] + move
            values[k], nuisance[twins] = float(np.clip(moved, part.low, part.high)), 0.0
        return Point(point.parts, values, nuisance)
