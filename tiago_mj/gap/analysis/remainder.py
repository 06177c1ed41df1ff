"""What the best explanation leaves on the test trials when everything that nobody claims to know is given its due.

The repaired simulator has the effects that were named. The nominal model's own numbers, which are known to a few per
cent, where each object stood, and the error of the physics step are no effects, and yet they leave a residual: whether
something *remains* is judged beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import likelihood, noise_model
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import terms
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.search import starts
from tiago_mj.gap.simulation.plant import Plant

Array = NDArray[np.float64]

#: A mean square of the residual above this is no noise, in units of the noise floor: twice its standard deviation.
LEFT: Final = 4.0


@dataclass(frozen=True)
class Remainder:
    """What is left on the test trials.

    Attributes:
        gap: mean squared residual in units of the noise floor, all channels together.
        misfit: mean square of the worst channel in units of floor and tolerance, by samples or over blocks.
    """

    gap: float
    misfit: float


def remainder(
    plant: Plant, predict: Predictor, data: Data, fit: Fitted, weight: Array, test: Sequence[int]
) -> Remainder:
    """What an explanation leaves on the trials that were kept aside.

    Args:
        plant: the nominal simulator.
        predict: simulations, the step's error put right where that was decided.
        data: of all trials.
        fit: the explanation, with the nominal numbers that were fitted beside it.
        weight: square root of what a sample of each channel counts for, (C,).
        test: indices of those trials; at least one.
    """
    here = noise_model.select_trials(data, test)
    known = (*fit.effects(), *own_numbers(plant, fit))
    own = tuple(term for term in terms(plant) if term.per_trial)
    predicted = predict.all_trials([known], test)[0]
    if own:  # where each object stood: nobody measured it, so that the test trials tell it themselves
        flat = np.zeros((len(own), *predicted.shape))
        fitter = Fitter(predict, tuple(test), here, weight, own, flat, known)
        fitter = fitter.linearized_at(Point((), np.zeros(0), np.zeros(fitter.size)))
        (placed,) = fitter.fit_all([Start((), np.zeros(0))])
        predicted = fitter.predictions([starts.point_of(placed)])[0]
    residual = here.value - predicted
    square = (likelihood.scaled(here, likelihood.residual(here, predicted)) ** 2).sum(axis=(0, 1))
    measured = np.isfinite(here.value).sum(axis=(0, 1))
    samples = float((square / np.maximum(measured, 1)).max(initial=0.0))
    lasting = float(np.nan_to_num(likelihood.lasting(here, residual)).max(initial=0.0))
    return Remainder(float(np.nanmean((residual / data.noise) ** 2)), max(samples, lasting))


def own_numbers(plant: Plant, fit: Fitted) -> tuple[Entry, ...]:
    """The nominal model's numbers as they were fitted beside an explanation, of all trials alike."""
    shared = [term for term in terms(plant) if not term.per_trial]
    return tuple(t.entry(float(size)) for t, size in zip(shared, fit.nuisance, strict=False) if size)
