"""Fit of the place of an effect, such as a payload's centre of mass or where a spring is slack, with its amount and
the nominal numbers: a short Gauss-Newton fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.fields import Detail
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.whitening import Normal

Array = NDArray[np.float64]

#: Steps of a fit, and the shares of one that are tried.
STEPS: Final = 8
SHARES: Final = (1.0, 0.4, 0.15)
#: A fit ends where a step lowers the cost by less than this [nats].
SETTLED: Final = 0.05
#: Drop of the cost after which the Jacobian of the nominal numbers is computed again [nats].
ANEW: Final = 3.0
#: Finite-difference step of a coordinate, as a share of its prior deviation; of the mass, of itself.
NUDGE: Final = 0.02
#: A coordinate is reported where its deviation is below this share of its prior deviation.
MAX_DEVIATION_SHARE: Final = 0.5


@dataclass(frozen=True)
class Optimum:
    """Local optimum of a fit.

    Attributes:
        parameters: mass, coordinates of the centre of mass, nuisances.
        cost: negative log likelihood, half the sum of squares of the whitened residual [nats].
        prior: log prior of coordinates and nuisances with the Occam factor (log of posterior over prior volume) [nats].
        deviations: standard deviations of mass and coordinates.
        predicted: prediction at the optimum.
    """

    parameters: Array
    cost: float
    prior: float
    deviations: Array
    predicted: Array


def details(effect: str) -> tuple[Detail, ...]:
    """Coordinates of an effect that are fitted."""
    return tuple(d for d in EFFECTS[effect].details.values() if d.moment)


def without_place(part: Candidate) -> Candidate:
    """A candidate at the body's own centre of mass."""
    names = {d.name for d in details(part.effect)}
    return replace(part, fixed=tuple((name, value) for name, value in part.fixed if name not in names))


def price(part: Candidate, value: float) -> float:
    """By how much less likely a candidate is for its place, one among others, before anything is seen [nats]; 0 at the
    body's own centre of mass."""
    return without_place(part).log_prior(value) - part.log_prior(value)


def _deviation(detail: Detail, side: int) -> float:
    """Prior deviation of a coordinate, on a sliding joint (0) or on a hinge (1): of even odds between its bounds where
    nothing says more."""
    if detail.usual is not None:
        return detail.usual.deviation_on(side)
    return (detail.bounds[1] - detail.bounds[0]) / math.sqrt(12)


def _with(parts: tuple[Candidate, ...], which: int, part: Candidate) -> tuple[Candidate, ...]:
    return (*parts[:which], part, *parts[which + 1 :])


class Sought:
    """Fit of the centre of mass of one effect; the other effects stay as they were fitted.

    Args:
        fitter: of the trials.
        at: where it begins: from the place that the effect has there, else from the body's own centre of mass.
        which: of its effects is placed.
    """

    def __init__(self, fitter: Fitter, at: Point, which: int) -> None:
        part = at.parts[which]
        self._coordinates, place = details(part.effect), dict(part.fixed)
        targets, kind = fitter.predict.plant.wiring.targets, EFFECTS[part.effect].targets
        side = targets.side(kind, targets.first(kind, part.target))
        self._wide = np.array([_deviation(d, side) for d in self._coordinates])
        self._fitter, self._which = fitter, which
        self._at = Point(_with(at.parts, which, without_place(part)), at.values, at.nuisance)
        begun = [place.get(d.name, 0.0) for d in self._coordinates]
        self._begin = np.concatenate([[at.values[which]], begun, at.nuisance])
        point = self._point(self._begin)
        base, *without = fitter.predictions([point, *fitter.without_each(point)])
        self._on = fitter.with_form_tolerance(point, base, without)
        self._columns = self._of_nuisances(self._begin)

    def _of_nuisances(self, parameters: Array) -> Array:
        """Whitened Jacobian with respect to the nominal numbers, (n, size)."""
        near = self._fitter.linearized_at(self._point(parameters))
        return self._on.columns(near.responses, near.per_trial)

    def _point(self, parameters: Array) -> Point:
        count = 1 + len(self._coordinates)
        values = self._at.values.copy()
        values[self._which] = parameters[0]
        return Point(_with(self._at.parts, self._which, self._part(parameters)), values, parameters[count:])

    def _part(self, parameters: Array) -> Candidate:
        part = self._at.parts[self._which]
        place = tuple((d.name, float(value)) for d, value in zip(self._coordinates, parameters[1:], strict=False))
        return replace(part, fixed=(*part.fixed, *place))

    def descend(self, *, place: bool) -> Optimum:
        """Fit mass and nuisances, and with ``place`` the centre of mass, whose prior then counts."""
        count = 1 + len(self._coordinates)
        free = np.ones(len(self._begin), dtype=bool)
        free[1:count] = place
        scale = np.concatenate([[max(abs(self._begin[0]), 1e-6)], self._wide, np.ones(len(self._begin) - count)])
        prior = np.concatenate([[0.0], np.full(count - 1, float(place)), np.ones(len(self._begin) - count)])
        parameters, predicted = self._begin, self._predicted([self._begin])[0]
        begun, nuisances = self._cost(parameters, predicted, place=place), self._columns
        for step in range(STEPS + 1):
            now = self._cost(parameters, predicted, place=place)
            if place and now < begun - ANEW:  # what the nominal numbers do depends on where the mass is
                begun, nuisances = now, self._of_nuisances(parameters)
            columns = np.concatenate([self._responses(parameters, predicted), nuisances], axis=1) * scale
            residual, weighted = self._on.weighted(predicted, columns[:, free])
            curvature = weighted.T @ weighted + np.diag(prior[free] + 1e-9)
            if step == STEPS:
                break
            gradient = weighted.T @ residual - (prior * parameters / scale)[free]
            move = np.zeros(len(parameters))
            move[free] = Normal(curvature, gradient, scale[free]).step()
            tried = [self._inside(parameters + share * move) for share in SHARES]
            seen = self._predicted(tried)
            costs = [self._cost(one, p, place=place) for one, p in zip(tried, seen, strict=True)]
            best = int(np.argmin(costs))
            if costs[best] > now - SETTLED:
                break
            parameters, predicted = tried[best], seen[best]
        deviations = np.zeros(count)
        known = Normal(curvature, np.zeros(len(curvature)), scale[free]).variances()
        deviations[free[:count]] = np.sqrt(known)[: free[:count].sum()]
        away = (parameters / scale)[1 if place else count :]
        spread = -0.5 * float(np.linalg.slogdet(curvature)[1])
        cost = self._on.cost(predicted, np.zeros(0))
        return Optimum(parameters, cost, spread - 0.5 * float(away @ away), deviations, predicted)

    def fitted(self, best: Fitted, optimum: Optimum, gain: float, prior: float) -> Fitted:
        """The explanation with the centre of mass; coordinates that the motion does not determine are 0."""
        which, count = self._which, 1 + len(self._coordinates)
        told = optimum.deviations[1:] < MAX_DEVIATION_SHARE * self._wide
        parameters = optimum.parameters.copy()
        parameters[1:count] = np.where(told, parameters[1:count], 0.0)
        part = self._part(parameters)
        hidden = {d.name for d, seen in zip(self._coordinates, told, strict=True) if not seen}
        kept = tuple((name, value) for name, value in part.fixed if name not in hidden)
        values, deviations = best.values.copy(), best.deviations.copy()
        values[which], deviations[which] = parameters[0], optimum.deviations[0]
        residual = self._on.data.value - optimum.predicted
        return replace(
            best,
            parts=_with(best.parts, which, replace(part, fixed=kept)),
            values=values,
            deviations=deviations,
            nuisance=parameters[count:],
            evidence=best.evidence + gain + prior,
            prior=best.prior + prior,
            misfit=min(best.misfit, float(self._on.misfit(optimum.predicted).max(initial=0.0))),
            lasting=min(
                best.lasting, float(np.nan_to_num(likelihood.lasting(self._on.data, residual)).max(initial=0.0))
            ),
            spreads={d.name: float(sd) for d, sd in zip(self._coordinates, optimum.deviations[1:], strict=True)},
        )

    def _predicted(self, places: Sequence[Array]) -> Array:
        return self._fitter.predictions([self._point(parameters) for parameters in places])

    def _responses(self, parameters: Array, predicted: Array) -> Array:
        """Whitened Jacobian with respect to mass and centre of mass, (n, 1 + ndetails), by finite differences."""
        steps = np.concatenate([[NUDGE * max(abs(parameters[0]), 1e-3)], NUDGE * self._wide])
        moved = []
        for k, step in enumerate(steps):
            shifted = parameters.copy()
            shifted[k] += step
            moved.append(shifted)
        return np.asarray(self._on.white((self._predicted(moved) - predicted) / steps[:, None, None, None]).T)

    def _inside(self, parameters: Array) -> Array:
        part, out = self._at.parts[self._which], parameters.copy()
        out[0] = np.clip(out[0], part.low, part.high)
        for k, detail in enumerate(self._coordinates, start=1):
            out[k] = np.clip(out[k], *detail.bounds)
        count = 1 + len(self._coordinates)
        out[count:] = np.clip(out[count:], -likelihood.NUISANCE_BOUND, likelihood.NUISANCE_BOUND)
        return out

    def _cost(self, parameters: Array, predicted: Array, *, place: bool) -> float:
        count = 1 + len(self._coordinates)
        away = parameters[1:count] / self._wide * place
        return self._on.cost(predicted, parameters[count:]) + 0.5 * float(away @ away)
