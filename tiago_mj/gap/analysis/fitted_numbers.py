"""Numbers of the nominal model as they were fitted, those that the validation trials confirm: part of the repair.

Every explanation may adjust the nominal model's own numbers within their priors. A simulator that has the effects
alone leaves what these numbers explain, and where they interact with the effects may even predict worse than before.

A number is confirmed by trials that did not fit it: the numbers are fitted to the training trials alone, beside the
effects as they are, and go one by one, or two that make up for each other at once, as long as the log likelihood of the
validation trials does not need them (backward elimination). What is left is fitted once more, to all of these trials.

They are numbers of the simulator that is repaired, at its physics step: what that step gets wrong is in the predictions
that they are fitted by, and they take up a part of it. What the recordings say of one number depends on what they leave
open of the others, those that went included: its interval is that of the fit of all of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.effects.targets import overlap
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.inference import likelihood, noise_model
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Term, terms
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.whitening import Whitening
from tiago_mj.gap.parts import FittedNumber, Joint, OpenNumber, target_of
from tiago_mj.gap.search.all_trials import MAX_STEPS
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.session import Session
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.io.quantities import NINETY

Array = NDArray[np.float64]

#: Drop of the validation trials' log likelihood, at the temperature of the verdict, that a number is needed for [nats]:
#: a number that means nothing gains so much where its estimate is two standard deviations off and the validation
#: trials err alike, z² / 2.
LEAST_NATS: Final = 2.0
#: Digits of a number, as files have them.
DIGITS: Final = 6


@dataclass(frozen=True)
class Sized:
    """A nuisance parameter with its estimate and one standard deviation of it, in deviations of its prior, and its
    correlation with those beside which it was fitted."""

    term: Term
    size: float
    deviation: float = 1.0
    correlation: tuple[float, ...] = ()

    @property
    def left(self) -> float:
        """Share of the prior's deviation that the recordings leave."""
        return min(self.deviation * verdict.calibration().widens, 1.0)

    @property
    def entry(self) -> Entry:
        """The effect that changes the model's number."""
        return self.term.entry(self.size)

    @property
    def possible(self) -> bool:
        """Whether the number is another than the model's, and one that its effect can have: a command may come
        early, or readings be stamped so, which a fit allows for, but no effect says it."""
        value = self.entry.parameters[self.term.parameter]
        least = min(low for low, _ in EFFECTS[self.term.effect].parameters[self.term.parameter].bounds)
        return value != self.term.nominal and not value < 0 <= least


@dataclass(frozen=True)
class Fold:
    """Numbers as some trials say, and trials that did not fit them."""

    numbers: Sequence[Sized]
    trials: Sequence[int]


@dataclass(frozen=True)
class _Seen:
    """What the trials of a fold say of its numbers, of n values.

    Attributes:
        white: whitened residual beside all numbers, (n,).
        change: what each number changes of it, (k, n).
        plain, moved: the same in units of the noise floor.
    """

    white: Array
    change: Array
    plain: Array
    moved: Array


def confirmed(
    session: Session, ranked: Ranked, data: Data, best: Fitted
) -> tuple[tuple[FittedNumber, ...], Joint | None]:
    """Nominal numbers fitted beside an explanation that improve the prediction of trials that did not fit them.

    Args:
        session: the trials and their splits.
        ranked: the search, with its predictor, sample weights and excluded trials.
        data: measured, of all trials.
        best: the explanation.

    Returns:
        The numbers, in the order of the nuisance parameters, and their joint posterior. Where no trial is for
        validation, each training trial confirms what the others say; none of a single one.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    plant, effects = session.plant, best.effects()
    shared = [term for term in terms(plant) if not term.per_trial]
    given = [one for t, size in zip(shared, best.nuisance, strict=False) if (one := Sized(t, float(size))).possible]
    train, validation = (_simulated(session, ranked, name) for name in ("train", "validation"))
    apart = [(train, validation)] if validation else _each_apart(train)
    if not given or not train or not apart:
        return (), None
    folds = [Fold(_refitted(plant, ranked, data, some, effects, given), other) for some, other in apart]
    kept = [k for k in _supported(ranked, data, folds, effects) if all(fold.numbers[k].possible for fold in folds)]
    if not kept:
        return (), None
    beside, both = [folds[0].numbers[k] for k in kept], Subset.of([*train, *validation])
    found = _refitted(plant, ranked, data, both, effects, beside)
    if not all(one.possible for one in found):
        kept = [k for k, one in zip(kept, found, strict=True) if one.possible]
        found = _refitted(plant, ranked, data, both, effects, [folds[0].numbers[k] for k in kept])
    if not kept or not all(one.possible for one in found):
        return (), None
    deviations = [max(fold.numbers[k].deviation for fold in folds) for k in kept]
    wide = [replace(one, deviation=max(one.deviation, other)) for one, other in zip(found, deviations, strict=True)]
    return tuple(_told(plant, one) for one in wide), _joint(wide)


def open_numbers(plant: Plant, best: Fitted, numbers: Sequence[FittedNumber]) -> tuple[OpenNumber, ...]:
    """Nominal numbers that are known to a prior and are no part of the repair, with what is left of their priors.

    Args:
        plant: the nominal simulator.
        best: the explanation; what its magnitudes change is left out.
        numbers: that are part of the repair.
    """
    out, fitted = [], {(one.name, one.target, one.parameter) for one in numbers}
    for k, term in enumerate(term for term in terms(plant) if not term.per_trial):
        changed = any(
            (part.effect, part.parameter) == (term.effect, term.parameter) and overlap(part.target, term.target)
            for part in best.parts
        )
        if changed or (term.effect, target_of(term.target), term.parameter) in fitted:
            continue
        free = Sized(term, 0.0, 1.0 if best.nuisance_deviations is None else float(best.nuisance_deviations[k]))
        one = _told(plant, free)
        said = (one.nominal, one.low, one.high, one.unit, free.left, *_bounds(term))
        out.append(OpenNumber(one.name, one.target, one.parameter, *said))
    return tuple(out)


def _each_apart(trials: Subset) -> list[tuple[Subset, Subset]]:
    """Each trial beside the others, which are fitted without it; of one trial nothing."""
    return [(trials.without({one}), Subset((one,))) for one in trials] if len(trials) > 1 else []


def eliminated(worth: Callable[[Sequence[int]], tuple[float, float]], count: int, least: float) -> list[int]:
    """Backward elimination: indices of the numbers that are needed.

    Args:
        worth: log likelihood [nats] and squared residual that all but some of the numbers lose against all, given the
            indices of those that are left out.
        count: of the numbers.
        least: log likelihood that one number is needed for.

    Returns:
        Indices of which neither one nor two can be left out for less.
    """
    out: list[int] = []
    while len(out) < count:
        needless = _needless(worth, [k for k in range(count) if k not in out], out, least)
        if needless is None:
            break
        out += needless
    return [k for k in range(count) if k not in out]


def _needless(
    worth: Callable[[Sequence[int]], tuple[float, float]], kept: Sequence[int], out: Sequence[int], least: float
) -> tuple[int, ...] | None:
    """The number, or else the two, that are worth least, if that is less than what they are needed for."""
    before, square = worth(out)
    for several in (1, 2):
        losses = {}
        for group in itertools.combinations(kept, several):
            nats, more = worth([*out, *group])
            if nats - before <= several * least or more <= square:
                losses[group] = nats - before
        if losses:
            return min(losses, key=lambda group: losses[group])
    return None


def _simulated(session: Session, ranked: Ranked, split: str) -> Subset:
    """A split's trials that were not excluded; of long ones no more than fits are made to."""
    trials = session.subset(split).without(ranked.excluded)
    if not ranked.predict.replays:
        return trials
    return trials[: max(MAX_STEPS // max(replay.physics_steps(session.plant, ranked.predict.on), 1), 1)]


def _refitted(
    plant: Plant, ranked: Ranked, data: Data, trials: Subset, effects: tuple[Entry, ...], given: Sequence[Sized]
) -> list[Sized]:
    """Numbers fitted to some trials beside effects that are held, each object where it stood."""
    own = tuple(term for term in terms(plant) if term.per_trial)
    all_terms = (*(one.term for one in given), *own)
    some = noise_model.select_trials(data, trials)
    flat = np.zeros((len(all_terms), *some.value.shape))
    simulator = replace(ranked.predict, corrected=0.0)
    fitter = Fitter(simulator, trials, some, ranked.weight, all_terms, flat, effects)
    begin = np.zeros(fitter.size)
    begin[: len(given)] = [one.size for one in given]
    fitter = fitter.linearized_at(Point((), np.zeros(0), begin))
    (fit,) = fitter.settled(fitter.fit_all([Start((), np.zeros(0), begin)]))
    assert fit.nuisance_deviations is not None
    assert fit.correlation is not None
    among = fit.correlation[1][: len(given), : len(given)]
    return [
        replace(one, size=float(size), deviation=float(deviation), correlation=tuple(map(float, row)))
        for one, size, deviation, row in zip(given, fit.nuisance, fit.nuisance_deviations, among, strict=False)
    ]


def _supported(ranked: Ranked, data: Data, folds: Sequence[Fold], effects: tuple[Entry, ...]) -> list[int]:
    """Indices of the numbers without which the repaired simulator predicts trials worse that did not fit them."""
    simulator, temperature = ranked.predict.as_simulated(), verdict.calibration().temperature
    seen = [_seen(ranked, data, fold, effects) for fold in folds]
    white, plain = (np.concatenate([getattr(one, name) for one in seen]) for name in ("white", "plain"))
    change, moved = (np.concatenate([getattr(one, name) for one in seen], axis=1) for name in ("change", "moved"))

    def worth(out: Sequence[int]) -> tuple[float, float]:
        simulator.deadline.check()
        nats = 0.5 * float(np.square(likelihood.soften(white + change[list(out)].sum(axis=0))).sum())
        return nats / temperature, float(np.square(plain + moved[list(out)].sum(axis=0)).sum())

    kept = eliminated(worth, len(folds[0].numbers), LEAST_NATS)
    if not kept:
        return []
    gained, left = 0.0, [0.0, 0.0]
    for fold in folds:
        selected = noise_model.select_trials(data, fold.trials)
        with_them = (*effects, *(fold.numbers[k].entry for k in kept))
        both = simulator.all_trials([with_them, effects], fold.trials)
        on = Whitening(selected, ranked.weight)
        alone, none = (on.cost(one, np.zeros(0)) for one in both)
        gained += (none - alone) / temperature
        for k, one in enumerate(both):
            left[k] += float(np.square(_in_noise(selected, selected.value - one)).sum())
    return kept if gained > LEAST_NATS and left[0] < left[1] else []


def _seen(ranked: Ranked, data: Data, fold: Fold, effects: tuple[Entry, ...]) -> _Seen:
    """What a fold's trials say of its numbers: those of all, and of all but each."""
    selected, numbers = noise_model.select_trials(data, fold.trials), [one.entry for one in fold.numbers]
    left_out = [(*effects, *numbers[:k], *numbers[k + 1 :]) for k in range(len(numbers))]
    predicted = ranked.predict.as_simulated().all_trials([(*effects, *numbers), *left_out], fold.trials)
    whole, without = predicted[0], predicted[1:]
    on = Whitening(selected, ranked.weight)
    return _Seen(
        on.white(likelihood.residual(selected, whole)),
        on.white(whole - without),
        _in_noise(selected, selected.value - whole),
        _in_noise(selected, whole - without),
    )


def _in_noise(data: Data, difference: Array) -> Array:
    """Differences (..., ntrials, T, C) in units of the noise floor, (..., n); 0 where nothing was measured."""
    scaled = np.where(np.isfinite(data.value), np.nan_to_num(difference / data.floor), 0.0)
    return scaled.reshape(*scaled.shape[:-3], data.value.size)


def _joint(numbers: Sequence[Sized]) -> Joint:
    """Posterior of numbers that were fitted together, as wide as their intervals."""
    wide = [one.left * one.term.deviation for one in numbers]
    covariance = np.array([one.correlation for one in numbers]) * np.outer(wide, wide)
    return Joint(
        tuple(one.term.factor for one in numbers),
        tuple(tuple(map(float, row)) for row in covariance),
        *zip(*(_bounds(one.term) for one in numbers), strict=True),
    )


def _bounds(term: Term) -> tuple[float | None, float | None]:
    """Of the value, None where it has none."""
    low, high = (float(end) if np.isfinite(end) else None for end in (term.low, term.high))
    return low, high


def _told(plant: Plant, one: Sized) -> FittedNumber:
    """A number with its 90 % interval, no wider than its prior's."""
    term, declared = one.term, EFFECTS[one.term.effect]
    reach = NINETY * one.left
    value, *ends = (
        float(term.entry(size).parameters[term.parameter]) for size in (one.size, one.size - reach, one.size + reach)
    )
    targets = plant.wiring.targets
    side = targets.side(declared.targets, targets.first(declared.targets, term.target))
    unit = declared.parameters[term.parameter].unit[side]
    value, low, high, nominal = (float(f"{x:.{DIGITS}g}") for x in (value, min(ends), max(ends), term.nominal))
    return FittedNumber(term.effect, target_of(term.target), term.parameter, value, low, high, unit, nominal)
