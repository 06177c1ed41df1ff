"""Residual of the best explanation on the test trials, with nominal numbers, object poses and integration error fitted.

The repaired simulator contains the effects that were named. The nominal model's own numbers, known to a few per cent,
the pose of each object, and the error of the physics step are not effects, but leave a residual. Whether a gap
*remains* is judged with them accounted for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.analysis import shrink
from tiago_mj.gap.analysis.recorded import Recorded
from tiago_mj.gap.inference import likelihood, noise_model, step_tolerance
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import terms
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.result import PHASES, Closing, Shrink
from tiago_mj.gap.simulation.plant import Plant

Array = NDArray[np.float64]

#: A mean square of the residual above this is no noise, in units of the noise floor: twice its standard deviation.
LEFT: Final = 4.0


@dataclass(frozen=True)
class Remainder:
    """Residual on the test trials.

    Attributes:
        gap: mean squared residual in units of the noise floor, all channels together.
        misfit: mean square of the worst channel in units of floor and tolerance, by samples or over blocks.
        channels, phases: ``gap`` of each channel and of each phase of the motion.
        loud: phases that leave more than noise (:data:`LEFT`) and more than the tolerance allows: a short phase counts
            for little in the mean over a whole trial.
        predicted: what was predicted of them, (ntrials, T, C).
    """

    gap: float
    misfit: float
    channels: Mapping[str, float] = field(default_factory=dict)
    phases: Mapping[str, float] = field(default_factory=dict)
    loud: tuple[str, ...] = ()
    predicted: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))


def remainder(recorded: Recorded, predict: Predictor, fit: Fitted, weight: Array, allowed: float) -> Remainder:
    """Residual of an explanation on the test trials, poses of objects fitted in each of them.

    Args:
        recorded: recordings; at least one trial is kept aside.
        predict: simulations, corrected for integration error where that was decided.
        fit: the explanation, with the nominal numbers that were fitted beside it.
        weight: square root of what a sample of each channel counts for, (C,).
        allowed: mean square in units of floor and tolerance above which a phase is loud.
    """
    plant, data, phase, test = recorded.plant, recorded.data, recorded.phase, recorded.test
    selected = noise_model.select_trials(data, test)
    known = (*fit.effects(), *own_numbers(plant, fit))
    own = tuple(term for term in terms(plant) if term.per_trial)
    predict = predict.corrected_beside([(trial, known) for trial in test])
    predicted = predict.all_trials([known], test)[0]
    if own:  # where each object stood: nobody measured it, so that the test trials tell it themselves
        flat = np.zeros((len(own), *predicted.shape))
        fitter = Fitter(predict, test, selected, weight, own, flat, known)
        fitter = fitter.linearized_at(Point((), np.zeros(0), np.zeros(fitter.size)))
        (placed,) = fitter.fit_all([Start((), np.zeros(0))])
        predicted = fitter.predictions([Point.of(placed)])[0]
    residual = selected.value - predicted
    scaled = likelihood.scaled(selected, likelihood.residual(selected, predicted)) ** 2
    there = np.isfinite(selected.value)
    samples = float((scaled.sum(axis=(0, 1)) / np.maximum(there.sum(axis=(0, 1)), 1)).max(initial=0.0))
    lasting = float(np.nan_to_num(likelihood.lasting(selected, residual)).max(initial=0.0))
    square = np.where(there, (residual / data.floor) ** 2, 0.0)
    channels = _means(square.sum(axis=(0, 1)), there.sum(axis=(0, 1)), data.channels)
    inside = [there & (phase[list(test)][:, : there.shape[1], None] == p) for p in range(len(PHASES))]
    counts = np.array([rows.sum() for rows in inside])
    phases = _means(np.array([square[rows].sum() for rows in inside]), counts, PHASES)
    misfits = _means(np.array([scaled[rows].sum() for rows in inside]), counts, PHASES)
    loud = tuple(name for name, left in phases.items() if left > LEFT and misfits[name] > allowed)
    gap = float(np.nanmean((residual / data.floor) ** 2))
    return Remainder(gap, max(samples, lasting), channels, phases, loud, predicted)


def weighed_share(recorded: Recorded, predict: Predictor, fit: Fitted, rest: Remainder, nothing: Remainder) -> float:
    """Share by which an explanation lowers the squared residual on the test trials, beside the nominal model, each with
    its own numbers as fitted; in the units in which explanations are compared at the end of a search, noise and
    tolerance found beside the explanation, an onset that is early or late compressed.

    In units of the noise floor alone one onset of a contact that is a row late outweighs all else: a load cell's true
    hysteresis, which brought the rest of its readings from 1.3 to 0.9 of the noise, closed nothing.

    Args:
        recorded, predict: as of :func:`remainder`.
        fit: the explanation.
        rest, nothing: what the explanation leaves, and what the nominal model leaves.
    """
    data, test = noise_model.select_trials(predict.data, recorded.test), recorded.test
    if predict.replays:
        error = np.zeros_like(rest.predicted)
        if predict.corrected:
            known = (*fit.effects(), *own_numbers(recorded.plant, fit))
            by = predict.corrected_beside([(trial, known) for trial in test])
            right, raw = (one.all_trials([known], test)[0] for one in (by, replace(by, corrected=0.0)))
            error = raw - right
        data = step_tolerance.beside(noise_model.select_trials(recorded.data, test), rest.predicted, error)
    return shrink.gone(*(likelihood.distance(data, one.predicted) for one in (nothing, rest)))


def with_accounted(
    closing: Shrink, rest: Remainder, nothing: Remainder | None = None, weighed: float | None = None
) -> Shrink:
    """Gap before and after, with the residual that is left once nominal numbers and object poses are fitted.

    Args:
        closing: before and after.
        rest: what the explanation leaves.
        nothing: what the nominal model leaves; None where that was not asked.
        weighed: of :func:`weighed_share`; None where that was not asked.
    """

    def known(parts: Mapping[str, Closing], left: Mapping[str, float]) -> dict[str, Closing]:
        return {name: replace(one, accounted=left.get(name)) for name, one in parts.items()}

    return replace(
        closing,
        per_channel=known(closing.per_channel, rest.channels),
        per_phase=known(closing.per_phase, rest.phases),
        accounted=rest.gap,
        accounted_before=None if nothing is None else nothing.gap,
        weighed=weighed,
    )


def _means(sums: Array, counts: NDArray[np.int_], names: Sequence[str]) -> dict[str, float]:
    """Mean of each group that has a sample."""
    return {name: float(total / n) for name, total, n in zip(names, sums, counts, strict=True) if n}


def own_numbers(plant: Plant, fit: Fitted) -> tuple[Entry, ...]:
    """Nominal numbers shared by all trials, as they were fitted beside an explanation, as effects."""
    shared = [term for term in terms(plant) if not term.per_trial]
    return tuple(t.entry(float(size)) for t, size in zip(shared, fit.nuisance, strict=False) if size)
