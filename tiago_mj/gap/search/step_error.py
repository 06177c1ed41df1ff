"""How far predictions are corrected for the integration error of the physics step, decided beside an explanation.

A recording made in the very simulator that replays it has the same integration error, a real robot has not, and one
made in a simulator with a shorter step has a part of it. Beside a nominal model that lacks an effect this cannot be
decided: the change by that is larger than the integration error.
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
#: Shares of it that may be put right: of a simulator whose step is half as long a half is, of one whose step is a third
#: two thirds.
SHARES: Final = tuple(k / 20 for k in range(21))
#: Physics steps in a predictor's tally that are no part of a search's budget: of these decisions, as nothing is found
#: by them, and of sets of effects that come from elsewhere.
APART: Final = "apart"
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
    whole = fitter.predict.with_step_correction(1.0)
    if whole is None or not fits:
        return None
    # By the noise alone: what the step gets wrong is part of the tolerance, which would hide it.
    noise = np.broadcast_to(fitter.data.reading_noise, fitter.data.value.shape)
    on = Whitening(replace(fitter.data, sigma=noise, common=np.zeros_like(noise)), fitter.weight)
    tally = fitter.predict.tally
    before = tally["physics_steps"]
    present = fitter.predict.corrected
    shares = tuple(dict.fromkeys((present, *SHARES)))
    # Each share has its own best explanation and magnitudes: a late command and a late step look alike.
    putting_right = replace(fitter, predict=whole)
    begin = [starts.start_at(Point.of(fit)) for fit in fits]
    each = [corrected_beside(putting_right, one).costs_by_shares(shares, one, on) for one in begin]
    told = np.min(each, axis=0) + np.where(np.array(shares) < 1, KEPT_NATS, 0.0)
    best = shares[int(np.argmin(told))]
    tally[APART] += tally["physics_steps"] - before
    return None if best == present else fitter.predict.with_step_correction(best)


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
