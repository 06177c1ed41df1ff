"""Where that is of which an effect is the amount: a payload's place, sought once a payload is the best explanation.

A short Gauss-Newton fit of amount and place beside the nominal model's own numbers. The place is told only where the
recordings speak for one beside the body's centre, and of its coordinates those that the motion shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.fields import Detail
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.inference import likelihood, noise_model
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point
from tiago_mj.gap.inference.hypotheses import Candidate, terms
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.whitening import Normal, Whitening
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation.plant import Plant

Array = NDArray[np.float64]

#: Evidence that a place is worth at least [nats].
WORTH: Final = 3.0
#: Trials that are fitted at most, and steps.
TRIALS: Final = 4
STEPS: Final = 8
SHARES: Final = (1.0, 0.4, 0.15)
#: A drop of the cost below this is no progress [nats].
SETTLED: Final = 0.05
#: Drops of the cost after which the nominal numbers' responses are looked at anew [nats].
ANEW: Final = 3.0
#: How far a coordinate is moved to see what it does, as a share of how far it is sought; an amount, of itself.
NUDGE: Final = 0.02
#: A coordinate is told where its deviation is below this share of what it was before anything was measured.
MAX_DEVIATION_SHARE: Final = 0.5


@dataclass(frozen=True)
class Bottom:
    """Where a descent ended.

    Attributes:
        at: amount, place, nuisances.
        met: half the sum of squares of the residual [nats].
        prior: of place and nuisances: how far they had to go, and how much of what they might have been is left [nats].
        deviations: of amount and place.
        predicted: there.
    """

    at: Array
    met: float
    prior: float
    deviations: Array
    predicted: Array


def refined(plant: Plant, ranked: Ranked, data: Data, trials: Sequence[int]) -> Ranked:
    """Explanations, the best one with the place of what it names, if it names what has one and recordings tell it.

    Args:
        plant: the nominal simulator.
        ranked: explanations, best first.
        data: measured, of the trials that were fitted.
        trials: indices of those.
    """
    own = terms(plant)
    if _which(ranked.fits[0]) is None or not ranked.complete or any(term.per_trial for term in own):
        return ranked
    rows = [row for row, trial in enumerate(trials) if trial not in ranked.excluded][:TRIALS]
    here = noise_model.select_trials(data, rows)
    flat = np.zeros((len(own), *here.value.shape))
    fitter = Fitter(ranked.predict, tuple(trials[row] for row in rows), here, ranked.weight, own, flat)
    # A second effect may stand for the place: the amount alone is given one, too.
    alone = (k for k, fit in enumerate(ranked.fits) if len(fit.parts) == ranked.known + 1 and _which(fit) is not None)
    chosen = {0, next(alone, 0)}
    fits = [_placed(fitter, fit) if k in chosen else fit for k, fit in enumerate(ranked.fits)]
    return replace(ranked, fits=tuple(sorted(fits, key=lambda fit: -fit.evidence)))


def _which(fit: Fitted) -> int | None:
    """Index of the part that has a place."""
    return next((k for k, part in enumerate(fit.parts) if _details(part.effect)), None)


def _details(effect: str) -> tuple[Detail, ...]:
    """Of an effect those that are sought."""
    return tuple(d for d in EFFECTS[effect].details.values() if d.sought)


def _placed(fitter: Fitter, fit: Fitted) -> Fitted:
    which = _which(fit)
    assert which is not None
    sought = _Sought(fitter, fit, which, _details(fit.parts[which].effect))
    centre, beside = sought.descend(place=False), sought.descend(place=True)
    met, prior = centre.met - beside.met, beside.prior - centre.prior
    if met / verdict.calibration().temperature + prior < WORTH:
        return fit
    return sought.fitted(beside, met, prior)


class _Sought:
    """One effect of an explanation whose place is sought; the others stay as they were fitted."""

    def __init__(self, fitter: Fitter, best: Fitted, which: int, details: tuple[Detail, ...]) -> None:
        self._best, self._which, self._details = best, which, details
        self._wide = np.array([(d.bounds[1] - d.bounds[0]) / np.sqrt(12) for d in details])
        self._begin = np.concatenate([[best.values[which]], np.zeros(len(details)), best.nuisance])
        at = self._point(self._begin)
        self._fitter = fitter
        base, without = self._fitter.predictions([at, at.without_effect(which)])
        form = EFFECTS[best.parts[which].effect].form_known_to
        self._on = Whitening(fitter.data, fitter.weight).with_form_tolerance(np.abs(form * (base - without)))
        self._columns = self._of_nuisances(self._begin)

    def _of_nuisances(self, at: Array) -> Array:
        """Whitened response to the nominal numbers around a point, (n, size)."""
        near = self._fitter.linearized_at(self._point(at))
        return self._on.columns(near.responses, near.per_trial)

    def _point(self, at: Array) -> Point:
        count = 1 + len(self._details)
        parts, values = list(self._best.parts), self._best.values.copy()
        parts[self._which] = self._part(at)
        values[self._which] = at[0]
        return Point(tuple(parts), values, at[count:])

    def _part(self, at: Array) -> Candidate:
        part = self._best.parts[self._which]
        place = tuple((d.name, float(value)) for d, value in zip(self._details, at[1:], strict=False))
        return replace(part, fixed=(*part.fixed, *place))

    def descend(self, *, place: bool) -> Bottom:
        """Fit amount and nuisances, and the place."""
        count = 1 + len(self._details)
        free = np.ones(len(self._begin), dtype=bool)
        free[1:count] = place
        scale = np.concatenate([[max(abs(self._begin[0]), 1e-6)], self._wide, np.ones(len(self._begin) - count)])
        prior = np.concatenate([[0.0], np.ones(len(self._begin) - 1)])
        at, predicted = self._begin, self._predicted([self._begin])[0]
        begun, nuisances = self._cost(at, predicted), self._columns
        for step in range(STEPS + 1):
            now = self._cost(at, predicted)
            if place and now < begun - ANEW:  # what the nominal numbers do depends on where the mass is
                begun, nuisances = now, self._of_nuisances(at)
            columns = np.concatenate([self._responses(at, predicted), nuisances], axis=1) * scale
            residual, weighted = self._on.weighted(predicted, columns[:, free])
            curvature = weighted.T @ weighted + np.diag(prior[free] + 1e-9)
            if step == STEPS:
                break
            gradient = weighted.T @ residual - (prior * at / scale)[free]
            move = np.zeros(len(at))
            move[free] = Normal(curvature, gradient, scale[free]).step()
            tried = [self._inside(at + share * move) for share in SHARES]
            seen = self._predicted(tried)
            costs = [self._cost(one, p) for one, p in zip(tried, seen, strict=True)]
            best = int(np.argmin(costs))
            if costs[best] > now - SETTLED:
                break
            at, predicted = tried[best], seen[best]
        deviations = np.zeros(count)
        deviations[free[:count]] = (scale[free] * np.sqrt(np.diag(np.linalg.inv(curvature))))[: free[:count].sum()]
        away = (at / scale)[1:]
        spread = -0.5 * float(np.linalg.slogdet(curvature)[1])
        met = self._on.cost(predicted, np.zeros(0))
        return Bottom(at, met, spread - 0.5 * float(away @ away), deviations, predicted)

    def fitted(self, there: Bottom, met: float, prior: float) -> Fitted:
        """The explanation with the place, of which what the motion does not show stays at the centre."""
        best, which, count = self._best, self._which, 1 + len(self._details)
        told = there.deviations[1:] < MAX_DEVIATION_SHARE * self._wide
        at = there.at.copy()
        at[1:count] = np.where(told, at[1:count], 0.0)
        part = self._part(at)
        shown = {d.name for d, seen in zip(self._details, told, strict=True) if seen}
        kept = tuple((name, value) for name, value in part.fixed if name in shown or name not in self._names())
        values, deviations = best.values.copy(), best.deviations.copy()
        values[which], deviations[which] = at[0], there.deviations[0]
        residual = self._on.data.value - there.predicted
        return replace(
            best,
            parts=(*best.parts[:which], replace(part, fixed=kept), *best.parts[which + 1 :]),
            values=values,
            deviations=deviations,
            nuisance=at[count:],
            evidence=best.evidence + met + prior,
            prior=best.prior + prior,
            misfit=min(best.misfit, float(self._on.misfit(there.predicted).max(initial=0.0))),
            lasting=min(
                best.lasting, float(np.nan_to_num(likelihood.lasting(self._on.data, residual)).max(initial=0.0))
            ),
            spreads={d.name: float(sd) for d, sd in zip(self._details, there.deviations[1:], strict=True)},
        )

    def _names(self) -> set[str]:
        return {d.name for d in self._details}

    def _predicted(self, places: Sequence[Array]) -> Array:
        return self._fitter.predictions([self._point(at) for at in places])

    def _responses(self, at: Array, predicted: Array) -> Array:
        """Whitened response to amount and place, per unit, (n, 1 + ndetails)."""
        steps = np.concatenate([[NUDGE * max(abs(at[0]), 1e-3)], NUDGE * self._wide])
        moved = []
        for k, step in enumerate(steps):
            there = at.copy()
            there[k] += step
            moved.append(there)
        return np.asarray(self._on.white((self._predicted(moved) - predicted) / steps[:, None, None, None]).T)

    def _inside(self, at: Array) -> Array:
        part, out = self._best.parts[self._which], at.copy()
        out[0] = np.clip(out[0], part.low, part.high)
        for k, detail in enumerate(self._details, start=1):
            out[k] = np.clip(out[k], *detail.bounds)
        count = 1 + len(self._details)
        out[count:] = np.clip(out[count:], -likelihood.NUISANCE_BOUND, likelihood.NUISANCE_BOUND)
        return out

    def _cost(self, at: Array, predicted: Array) -> float:
        count = 1 + len(self._details)
        place = at[1:count] / self._wide
        return self._on.cost(predicted, at[count:]) + 0.5 * float(place @ place)
