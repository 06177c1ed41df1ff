"""Predictive checks of explanations on held-out trials: the validation trials, which choose, and the test trials.

Predictions are simulated with the nominal numbers as they were fitted beside each explanation, so that an explanation
that needs them is judged with them. The pose of an object in one trial says nothing about another trial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.analysis import promises, shrink
from tiago_mj.gap.analysis.recorded import Recorded
from tiago_mj.gap.analysis.remainder import own_numbers
from tiago_mj.gap.inference import likelihood, noise_model
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import Term, terms
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.recordings import travel

Array = NDArray[np.float64]

#: Fitted numbers of the nominal model that are listed.
MAX_LISTED_NUMBERS: Final = 3


@dataclass(frozen=True)
class Validated:
    """Explanations on the validation trials.

    Attributes:
        gains: drop of the mean squared residual in units of the floor, (n,).
        energy, samples: sums of squared residuals, (n, B), and their numbers, (B,), over blocks of rows.
        misfit: mean square of the worst channel, in units of floor and tolerance, (n,).
    """

    gains: Array
    energy: Array
    samples: Array
    misfit: Array

    def far_worse(self, fails: float, seed: int) -> NDArray[np.bool_]:
        """Explanations that predict the trials far worse than the best, (n,).

        Args:
            fails: ``misfit`` above which an explanation fails.
            seed: of the bootstrap.
        """
        return promises.beaten(self.energy, self.samples, self.misfit, fails, seed)


def validated(
    recorded: Recorded, predict: Predictor, base: Array, fits: Sequence[Fitted], nominal: int, trials: Sequence[int]
) -> Validated:
    """Drop of the mean squared residual on the validation trials under each explanation, and what it leaves there.

    The drop is relative to the nominal model with its own fitted numbers, so that it measures the effects alone.

    Args:
        recorded: recordings.
        predict: simulates.
        base: nominal prediction, (ntrials, T, C).
        fits: explanations.
        nominal: index of the explanation without effects, apart from those measured on the readings.
        trials: validation trials, not those that were fitted.
    """
    plant = recorded.plant
    known = [(*fit.effects(), *own_numbers(plant, fit)) for fit in fits]
    nothing = own_numbers(plant, fits[nominal])
    simulated = known if nothing in known else [*known, nothing]
    every = predict.beside_each(simulated, trials)
    predicted = every[: len(fits)]
    selected = noise_model.select_trials(recorded.data, trials)
    length = shrink.block_rows(selected, base[list(trials)], predicted[0])
    energy, samples = _blocks(selected, predicted, length)
    before, _ = _blocks(selected, every[[simulated.index(nothing)]], length)
    gains: Array = (before.sum() - energy.sum(axis=1)) / samples.sum()
    misfit = [_misfit(selected, one) for one in predicted]
    return Validated(gains, energy, samples, np.array(misfit))


def spoiled(recorded: Recorded, predict: Predictor, fit: Fitted) -> tuple[str, ...]:
    """A sentence where the nominal numbers fitted beside an explanation make the prediction of the test trials worse.

    Args:
        recorded: recordings.
        predict: simulates.
        fit: the explanation.
    """
    plant, session, trials = recorded.plant, recorded.session, recorded.test
    own = own_numbers(plant, fit)
    if not own or not trials:
        return ()
    shared = [term for term in terms(plant) if not term.per_trial]
    far = sorted(zip(shared, fit.nuisance, strict=False), key=lambda one: -abs(float(one[1])))[:MAX_LISTED_NUMBERS]
    fitted, stated = predict.beside_each([(*fit.effects(), *own), tuple(fit.effects())], trials)
    selected = noise_model.select_trials(recorded.data, trials)
    energy, samples = _blocks(selected, np.stack([fitted, stated]), shrink.block_rows(selected, stated, fitted))
    slides = [name for name, slides in zip(plant.joints, plant.wiring.targets.slides, strict=True) if slides]
    told = [_number(plant, term, float(size)) for term, size in far if size]
    farther = travel.farther(session.trials, session.splits, slides)
    return promises.spoiled(energy[0], energy[1], samples, told, farther, recorded.seed)


def can_close(fit: Fitted) -> bool:
    """Whether an explanation, if right, reduces the residual of other trials; random effects do not."""
    return not any(EFFECTS[part.effect].by_chance for part in fit.parts)


def _blocks(data: Data, predicted: Array, length: int) -> tuple[Array, Array]:
    """Sums of squared residuals in units of the noise floor, (n, B), and sample counts, (B,), over blocks of ``length``
    rows of each trial; all channels of a block are summed, as their errors are correlated."""
    known = np.isfinite(data.value)
    ntrials, rows = data.value.shape[:2]
    per_trial = -(-rows // length)
    block = (np.arange(ntrials)[:, None] * per_trial + np.arange(rows) // length).ravel()
    count = ntrials * per_trial
    samples = np.bincount(block, known.sum(axis=2).ravel(), minlength=count)
    square = np.where(known, np.nan_to_num((data.value - predicted) / data.floor) ** 2, 0.0).sum(axis=3)
    energy: Array = np.stack([np.bincount(block, one.ravel(), minlength=count) for one in square]).astype(float)
    there = samples > 0
    return energy[:, there], samples[there].astype(float)


def _misfit(data: Data, predicted: Array) -> float:
    """Reduced chi-square of the worst channel, in units of noise floor and tolerance."""
    square = (likelihood.scaled(data, data.value - predicted) ** 2).sum(axis=(0, 1))
    measured = np.isfinite(data.value).sum(axis=(0, 1))
    return float((square / np.maximum(measured, 1)).max(initial=0.0))


def _number(plant: Plant, term: Term, deviations: float) -> str:
    """A nominal number and its fitted value in words, such as ``encoder_scale of hinge 0.947``."""
    declared = EFFECTS[term.effect]
    value = term.entry(deviations).parameters[term.parameter]
    targets = plant.wiring.targets
    side = targets.side(declared.targets, targets.first(declared.targets, term.target))
    unit = declared.parameters[term.parameter].unit[side]
    target = f" of {' and '.join(term.target)}" if term.target else ""
    return f"{term.effect}{target} {value:.3g}{'' if unit == '-' else f' {unit}'}"
