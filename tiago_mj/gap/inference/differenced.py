"""Responses of predictions to an explanation's magnitudes and to the nominal model's own numbers, by finite differences
around a point: how far each is moved, by what the changes are whitened, and the Gauss-Newton steps by them."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import likelihood, scatter
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.linearized import Linearized
from tiago_mj.gap.inference.points import NUISANCE_STEP, Point
from tiago_mj.gap.inference.whitening import Normal, Whitening

Array = NDArray[np.float64]

#: Smallest move of a magnitude for a finite-difference response, as a share of its range. Halved and doubled, none
#: of 15 answers about hinges changes (varied.json).
MIN_MOVE_SHARE: Final = 5e-3
#: Curvature that holds a nuisance at its value, in units of the curvature of its prior.
FIXED_CURVATURE: Final = 1e12

T = TypeVar("T")
#: A computation that asks for predictions at points and is sent (npoints, ntrials, T, C).
FitTask = Generator[Sequence[Point], Array, T]


@dataclass
class Differenced(Linearized):
    """One set of trials, what predicts them, finite differences of that around a point, and steps from there.

    Attributes:
        min_move_share: smallest move of a magnitude for its finite-difference response, as a share of its range. Where
            contacts begin and end, a very small move shows the effect of single physics steps only; a fit that begins
            far from the optimum needs about 0.01.
        uneven: whether predictions scatter around the best explanation (:mod:`tiago_mj.gap.inference.scatter`).
    """

    min_move_share: float = MIN_MOVE_SHARE
    uneven: bool = False

    def opened(self, at: Point) -> FitTask[tuple[Whitening, Array, float]]:
        """Whitening with the tolerance for the forms of the effects at a point, the prediction there, and the scatter
        of one prediction; 0 where it is known that there is none."""
        alone = self.without_each(at)
        alike = scatter.alike(at, self.predict.seed)[1:] if self.uneven else []
        base, *rest = yield [at, *alone, *alike]
        on = self.with_form_tolerance(at, base, rest[: len(alone)])
        return on, base, scatter.of(on, np.array([base, *rest[len(alone) :]]))

    def first_moves(self, on: Whitening, at: Point, base: Array, scattered: float) -> FitTask[Array]:
        """Moves for responses by central differences, from forward differences."""
        usual = self.usual_moves(at)
        if not scatter.is_uneven(scattered):
            return usual
        columns = yield from self.value_columns(on, at, base)
        columns = np.concatenate([columns, on.columns(self.responses, self.per_trial)], axis=1)
        return self.moves(at, columns, scatter.added_curvature(self, usual, scattered, sides=1), scattered)

    def moves(self, at: Point, columns: Array, added: Array, scattered: float) -> Array:
        """Moves for responses by central differences, (k + nterms,), from responses at another point."""
        usual = self.usual_moves(at)
        longest = np.full(len(usual), scatter.MAX_NUDGE)
        longest[: len(at.parts)] = scatter.MAX_WIDENING * usual[: len(at.parts)]
        known = scatter.told(self, len(at.parts), columns, added) + scatter.priors(self, at.parts)
        return scatter.moves(usual, longest, known, scattered)

    def usual_moves(self, at: Point) -> Array:
        """Moves for responses where predictions do not scatter, (k + nterms,)."""
        of_values = [self._move(part, v) for part, v in zip(at.parts, at.values, strict=True)]
        return np.array([*of_values, *[NUISANCE_STEP] * len(self.terms)])

    def without_each(self, at: Point) -> list[Point]:
        """The point without each of its effects, for the tolerance of their forms. None along a motion: there the noise
        is what a model with every effect in every form leaves, so that an error of a form is in it already."""
        return [at.without_effect(k) for k in range(len(at.parts))] if self.predict.replays else []

    def with_form_tolerance(self, at: Point, base: Array, without: Sequence[Array] | Array) -> Whitening:
        """Whitening with a tolerance for the form of each effect: a share of the change that it makes.

        Args:
            at: the effects.
            base: predictions with them.
            without: predictions at each of :meth:`without_each`.
        """
        on = Whitening(self.data, self.weight)
        if not len(without):
            return on
        shares = [EFFECTS[part.effect].form_known_to for part in at.parts]
        missed = [np.square(share * (base - one)) for share, one in zip(shares, without, strict=True)]
        return on.with_form_tolerance(np.sqrt(sum(missed)))

    def nuisance_responses(self, at: Point, base: Array) -> FitTask[Array]:
        """Responses of the nuisances around a point, see :attr:`responses`."""
        return ((yield self.nudged(at)) - base) / NUISANCE_STEP

    def value_columns(self, on: Whitening, at: Point, base: Array) -> FitTask[Array]:
        """Whitened response to each magnitude, per unit of it, (n, k)."""
        return np.asarray(on.white((yield from self.value_responses(at, base))).T)

    def value_responses(self, at: Point, base: Array) -> FitTask[Array]:
        """Response to each magnitude, per unit of it, (k, ntrials, T, C)."""
        if not at.parts:
            return np.zeros((0, *base.shape))
        points, steps = [], []
        for k, part in enumerate(at.parts):
            step = self._move(part, at.values[k])
            steps.append(-step if at.values[k] + step > part.high else step)
            points.append(at.with_value(k, at.values[k] + steps[-1]))
        return np.asarray(((yield points) - base) / np.array(steps)[:, None, None, None])

    def _move(self, part: Candidate, value: float) -> float:
        """Move of a magnitude for its finite-difference response."""
        step = 0.02 * abs(value - (part.identity if np.isfinite(part.identity) else 0.0))
        # Of a limit the magnitude itself says how large a move is.
        return max(step, self.min_move_share * (part.high - part.low)) if np.isfinite(part.identity) else step

    def normal(self, on: Whitening, at: Point, base: Array, columns: Array, *, alone: bool = False) -> Normal:
        """The normal equations of a step; ``alone``: of the magnitudes."""
        count = len(at.parts) if alone else None
        known = np.ones(self.size)
        for part in at.parts:
            known[self.duplicating_nuisances(part)] = FIXED_CURVATURE
        prior = np.concatenate([np.zeros(len(at.parts)), known])[:count]
        scale = self.scale(at.parts)[:count]
        r, weighted = on.weighted(base, columns)
        weighted = weighted * scale
        gradient = weighted.T @ r - prior * np.concatenate([at.values * 0, at.nuisance])[:count]
        bound = likelihood.NUISANCE_BOUND
        of_values = [part.room(float(v)) for part, v in zip(at.parts, at.values, strict=True)]
        of_nuisances = np.stack([-bound - at.nuisance, bound - at.nuisance], axis=1)
        room = np.concatenate([np.reshape(of_values, (-1, 2)), of_nuisances])[:count].T
        return Normal(weighted.T @ weighted + np.diag(prior + 1e-6), gradient, scale, room)

    def points(self, normal: Normal, at: Point, steps: Sequence[tuple[float, float, bool]]) -> list[Point]:
        """Points to try: shares of damped Gauss-Newton steps, of magnitudes and nuisances together, or of magnitudes
        alone, with the nuisances where they are: their responses may be those of another point, and what they mimic
        shortens a step that both share."""
        count, bound = len(at.parts), likelihood.NUISANCE_BOUND
        points = []
        for share, damping, alone in steps:
            if alone and count:
                step = normal.first(count).step(damping)
                points.append(Point(at.parts, moved_magnitudes(at, share * step), at.nuisance))
            elif not alone:
                step = normal.step(damping)
                nuisance = np.clip(at.nuisance + share * step[count:], -bound, bound)
                points.append(Point(at.parts, moved_magnitudes(at, share * step[:count]), nuisance))
        return points

    def scale(self, parts: Sequence[Candidate]) -> Array:
        """Magnitudes in units of their bounds: well conditioned."""
        return np.array([*(part.high - part.low for part in parts), *np.ones(self.size)])


def moved_magnitudes(at: Point, step: Array) -> Array:
    """Magnitudes after a step, each within its bounds, (k,)."""
    return np.array([p.moved(float(v), float(s)) for p, v, s in zip(at.parts, at.values, step, strict=True)])
