"""Whether predictions are corrected for the integration error of the physics step, decided beside an explanation.

A recording made in the very simulator that replays it has the same integration error, a real robot has not. Beside the
nominal model this cannot be decided: the change by a missing effect is larger than the integration error.
"""

from __future__ import annotations

from collections.abc import Sequence
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
#: Physics steps of these decisions in a predictor's tally: no part of a search's budget, as nothing is found by them.
DECIDING: Final = "deciding"
#: Explanations beside which both ways are tried, the likeliest of other classes: one that is wrong may go with a wrong
#: step (a spring and a lag with the error of a step of 2 ms for a late clock and a weak motor, hinges_5002.json, 83).
MAX_BESIDE: Final = 3


def leaders(fits: Sequence[Fitted]) -> list[Fitted]:
    """The best explanation, and those of other classes that are not far behind it."""
    ahead = ranking.by_evidence(fits)
    near = [f for f in ahead if f.evidence > ahead[0].evidence - rounds.HOPELESS_DEFICIT_NATS]
    return ranking.unique_by_classes(near)[:MAX_BESIDE]


def better_step_correction(fitter: Fitter, fits: Sequence[Fitted] | Sequence[Start]) -> Predictor | None:
    """The predictor with the correction for integration error switched; None where the present choice is the more
    likely one.

    Args:
        fitter: of the trials.
        fits: explanations of them: each way may have its own best.
    """
    switched = fitter.predict.with_other_step_correction()
    if switched is None or not fits:
        return None
    # By the noise alone: what the step gets wrong is part of the tolerance, which would hide it.
    noise = np.broadcast_to(fitter.data.noise, fitter.data.value.shape)
    on = Whitening(replace(fitter.data, sigma=noise, common=np.zeros_like(noise)), fitter.weight)
    tally = fitter.predict.tally
    before = tally["physics_steps"]
    # What is put right is the same beside all that a fit tries, so that both ways respond alike to the numbers.
    begin = [starts.start_at(Point.of(fit)) for fit in fits]
    around = [corrected_beside(fitter, start).linearized_at(Point.of(start)) for start in begin]

    def cost(predict: Predictor) -> float:
        # Each way has its own best explanation and magnitudes: a late command and a late step look alike.
        costs = []
        for start, near in zip(begin, around, strict=True):
            by = corrected_beside(replace(near, predict=predict), start)
            (refitted,) = by.fit_all([start])
            point = Point.of(refitted)
            costs.append(on.cost(by.predictions([point])[0], point.nuisance))
        return min(costs)

    drop = cost(fitter.predict) - cost(switched)
    tally[DECIDING] += tally["physics_steps"] - before
    return switched if drop > (-KEPT_NATS if switched.corrected else KEPT_NATS) else None


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
    that is another one than before. Where no effect leads, what was decided beside the nominal model stands.

    Screening trials beside single effects tell too little: of 12 hinges whose readings are filtered, late or limited in
    speed four were left with the error of a step of 2 ms, and time constants and delays came out 1 ms short
    (hinges_5002.json).
    """
    other = better_step_correction(state.full, leaders(state.fits)) if state.best.parts else None
    if other is None:
        return state
    full, screening = replace(state.full, predict=other), replace(state.screening, predict=other)
    near = [f for f in ranking.by_evidence(state.fits) if f.parts][: rounds.MAX_ON_ALL_TRIALS]
    fits = full.fit_all([starts.restart(f) for f in (state.nominal, *near)])
    return replace(state, full=full, screening=screening, fits=tuple(fits))
