"""What is known better once something explains the recordings: the sensors' noise, in what that leaves, and what the
physics step gets wrong, beside it and not beside the nominal model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.search import ranking, rounds, starts
from tiago_mj.gap.search.state import State

#: Explanations that are fitted anew, the best first: twins are to be told apart by the same effort. Chosen
#: by hand; no ablation.
MAX_REFITTED: Final = 4


def sharpened(state: State) -> State:
    """The search with noise and step error as they are beside its best explanation, by which all are weighed anew."""
    everywhere = beside(state.everywhere, state.best)
    few, shared = state.few, [t for t in state.few.trials if t in everywhere.trials]
    if len(shared) == len(few.trials):
        rows = [everywhere.trials.index(t) for t in few.trials]
        data = noise_model.select_trials(everywhere.data, rows)
        few = replace(few, data=data, predict=everywhere.predict, weight=everywhere.weight)
    state = replace(state, few=few, everywhere=everywhere)
    return replace(state, fits=tuple(rounds.reweighted(everywhere, state.fits, MAX_REFITTED)))


def beside(everywhere: Fitter, best: Fitted) -> Fitter:
    """The fitter with noise and step error as they are beside an explanation."""
    point, predict = starts.point_of(best), everywhere.predict
    if predict.corrected:
        effects = [
            (trial, everywhere.effects(point.parts, point.values, point.nuisance, k))
            for k, trial in enumerate(everywhere.trials)
        ]
        predict = predict.corrected_beside(effects)
    there = replace(everywhere, predict=predict)
    prediction = there.predictions([point])[0]
    error = np.zeros_like(prediction)
    if predict.corrected and predict.off is not None:
        error = replace(there, predict=replace(predict, corrected=False)).predictions([point])[0] - prediction
    there = replace(there, data=noise_model.beside(everywhere.data, prediction, error))
    sigma, common = predict.data.sigma.copy(), predict.data.common.copy()
    sigma[list(there.trials)], common[list(there.trials)] = there.data.sigma, there.data.common
    measured = replace(predict.data, noise=there.data.noise, sigma=sigma, common=common)
    there = replace(there, predict=replace(predict, data=measured))
    return replace(there, weight=ranking.sample_weight(there.data, prediction))


def misfits_by(before: Fitter, everywhere: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations with what they leave in units of noise and tolerance as these were assumed at first: another
    simulator, or a robot, is not expected to agree with this one to within the noise of its sensors. What they leave in
    the units of the search is kept as ``sharp``."""
    rows = [before.trials.index(trial) for trial in everywhere.trials]
    data = noise_model.select_trials(before.data, rows)
    there = replace(everywhere, data=data, iterations=0).fit_all([starts.restart(f) for f in fits])
    return [
        replace(f, misfit=g.misfit, lasting=g.lasting, sharp=ranking.discrepancy(f))
        for f, g in zip(fits, there, strict=True)
    ]
