"""Sensor noise and integration error estimated from the residual of the best explanation, in place of the wider
tolerances that are assumed at first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.gap.inference import noise_model, step_tolerance
from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.search import ranking, rounds, step_error
from tiago_mj.gap.search.state import State

#: Explanations that are fitted anew, the best first: twins are to be told apart by the same effort. Halved and
#: doubled, none of 16 answers about hinges changes (varied.json).
MAX_REFITTED: Final = 4


def sharpened(state: State, *, in_contact: bool = True) -> State:
    """The search with noise and step error estimated beside its best explanation, all explanations weighed anew;
    without ``in_contact`` the wider tolerances stay where something is touched."""
    full = beside(state.full, state.best, in_contact=in_contact)
    screening = state.screening
    if full.trials.holds(screening.trials):
        data = noise_model.select_trials(full.data, full.trials.rows_of(screening.trials))
        screening = replace(screening, data=data, predict=full.predict, weight=full.weight)
    state = replace(state, screening=screening, full=full)
    return replace(state, fits=tuple(rounds.reweighted(full, state.fits, MAX_REFITTED)))


def beside(full: Fitter, best: Fitted, *, in_contact: bool = True) -> Fitter:
    """The fitter with noise and step error estimated beside an explanation, as of :func:`sharpened`."""
    point, there = Point.of(best), step_error.corrected_beside(full, best)
    predict = there.predict
    prediction = there.predictions([point])[0]
    error = np.zeros_like(prediction)
    if predict.corrected and predict.off is not None:
        error = replace(there, predict=replace(predict, corrected=0.0)).predictions([point])[0] - prediction
    there = replace(there, data=step_tolerance.beside(full.data, prediction, error, in_contact=in_contact))
    sigma, common = predict.data.sigma.copy(), predict.data.common.copy()
    sigma[list(there.trials)], common[list(there.trials)] = there.data.sigma, there.data.common
    measured = replace(predict.data, noise=there.data.noise, sigma=sigma, common=common)
    there = replace(there, predict=replace(predict, data=measured))
    return replace(there, weight=ranking.sample_weight(there.data, prediction))


def misfits_by(before: Fitter, full: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations with reduced chi-squares in units of the noise and tolerance assumed at first.

    Another simulator, or a robot, need not agree with this simulator to within the noise of its sensors. The larger of
    the two in units of the estimated noise is kept as ``sharp``.
    """
    data = noise_model.select_trials(before.data, before.trials.rows_of(full.trials))
    there = [step_error.own(replace(full, data=data), f, fits).evaluated([f])[0] for f in fits]
    return [
        replace(f, misfit=g.misfit, lasting=g.lasting, sharp=ranking.discrepancy(f))
        for f, g in zip(fits, there, strict=True)
    ]
