"""How far predictions are corrected for the integration error of the physics step, decided beside an explanation.

A recording made in the very simulator that replays it has the same integration error, a real robot has not, and one
made in a simulator with a shorter step has a part of it. Beside a nominal model that lacks an effect this cannot be
decided: the change by that is larger than the integration error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.inference.whitening import Whitening
from tiago_mj.gap.search import ranking, rounds, starts
from tiago_mj.gap.search.state import State

#: Recordings are taken to be free of integration error, as a robot's are, unless they are met better with it by this
#: much [nats]: a Bayes factor of 3.
KEPT_NATS: Final = 1.1
#: Shares of it that are put right, and to what others are told: of a simulator whose step is half as long a half is, of
#: one whose step is a third two thirds.
SHARES: Final = (0.0, 0.5, 1.0)
SHARE_STEP: Final = 0.05
#: Physics steps of these decisions in a predictor's tally: no part of a search's budget, as nothing is found by them.
DECIDING: Final = "deciding"
#: Explanations beside which all shares are tried, the likeliest of other classes: one that is wrong may go with a wrong
#: step (a spring and a lag with the error of a step of 2 ms for a late clock and a weak motor, hinges_5002.json, 83).
MAX_BESIDE: Final = 3


def leaders(fits: Sequence[Fitted]) -> list[Fitted]:
    """The best explanation, and those of other classes that are not far behind it."""
    ahead = ranking.by_evidence(fits)
    near = [f for f in ahead if f.evidence > ahead[0].evidence - rounds.HOPELESS_DEFICIT_NATS]
    return ranking.unique_by_classes(near)[:MAX_BESIDE]


def better_step_correction(fitter: Fitter, fits: Sequence[Fitted] | Sequence[Start]) -> Predictor | None:
    """The predictor with another share of the integration error put right; None where the present one is the
    likeliest.

    Args:
        fitter: of the trials.
        fits: explanations of them: each share may have its own best.
    """
    if fitter.predict.with_step_correction(1.0) is None or not fits:
        return None
    # By the noise alone: what the step gets wrong is part of the tolerance, which would hide it.
    noise = np.broadcast_to(fitter.data.reading_noise, fitter.data.value.shape)
    on = Whitening(replace(fitter.data, sigma=noise, common=np.zeros_like(noise)), fitter.weight)
    tally = fitter.predict.tally
    before = tally["physics_steps"]
    # What is put right is the same beside all that a fit tries, so that all shares respond alike to the numbers.
    begin = [starts.start_at(Point.of(fit)) for fit in fits]
    around = [corrected_beside(fitter, start).linearized_at(Point.of(start)) for start in begin]

    def cost(share: float) -> float:
        # Each share has its own best explanation and magnitudes: a late command and a late step look alike.
        predict, costs = fitter.predict.with_step_correction(share), []
        assert predict is not None
        for start, near in zip(begin, around, strict=True):
            by = corrected_beside(replace(near, predict=predict), start)
            (refitted,) = by.fit_all([start])
            point = Point.of(refitted)
            costs.append(on.cost(by.predictions([point])[0], point.nuisance))
        return min(costs) + (KEPT_NATS if share < 1 else 0.0)

    present = fitter.predict.corrected
    told = {share: cost(share) for share in dict.fromkeys((present, *SHARES))}
    least = _of_least_cost(told)
    if min(abs(least - share) for share in told) > SHARE_STEP / 2:
        told[least] = cost(least)
    best = min(told, key=lambda share: told[share])
    tally[DECIDING] += tally["physics_steps"] - before
    return None if best == present else fitter.predict.with_step_correction(best)


def _of_least_cost(told: Mapping[float, float]) -> float:
    """Share at the lowest point of the parabola through the costs of :data:`SHARES`, as a cost is of what is linear; of
    a curve that has none the best of them."""
    low, middle, high = (told[share] - (KEPT_NATS if share < 1 else 0.0) for share in SHARES)
    bend = low - 2 * middle + high
    if not bend > 0:
        return min(SHARES, key=lambda share: told[share])
    least = 0.5 + (low - high) / (4 * bend)
    return float(np.clip(round(least / SHARE_STEP) * SHARE_STEP, 0.0, 1.0))


def corrected_beside(fitter: Fitter, fit: Fitted | Start) -> Fitter:
    """The fitter with the step's error found beside an explanation, where it is put right: beside the nominal model,
    which lacks an effect, it is another one."""
    at, trials = Point.of(fit), enumerate(fitter.trials)
    effects = [(trial, fitter.effects(at.parts, at.values, at.nuisance, k)) for k, trial in trials]
    return replace(fitter, predict=fitter.predict.corrected_beside(effects))


def own(fitter: Fitter, fit: Fitted, among: Sequence[Fitted]) -> Fitter:
    """The fitter for one of several explanations: near the best of them with the step's error found beside it, which
    would else be that of the best, in whose favour it is."""
    near = fit.evidence > max(f.evidence for f in among) - rounds.HOPELESS_DEFICIT_NATS
    return corrected_beside(fitter, fit) if near else fitter


def decided(state: State) -> State:
    """The search with the better choice beside its best explanations of all trials, its explanations fitted anew where
    that is another one than before.

    Screening trials beside single effects tell too little: of 12 hinges whose readings are filtered, late or limited in
    speed four were left with the error of a step of 2 ms, and time constants and delays came out 1 ms short
    (hinges_5002.json).
    """
    other = better_step_correction(state.full, leaders(state.fits))
    if other is None:
        return state
    full, screening = replace(state.full, predict=other), replace(state.screening, predict=other)
    near = [f for f in ranking.by_evidence(state.fits) if f.parts][: rounds.MAX_ON_ALL_TRIALS]
    fits = full.fit_all([starts.restart(f) for f in (state.nominal, *near)])
    return replace(state, full=full, screening=screening, fits=tuple(fits))
