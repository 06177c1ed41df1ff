"""Whether like parts have the same magnitudes: each part fitted by itself, their values compared.

Values that are known to within their deviations scatter about their weighted mean by a chi-square of one less degree of
freedom than there are parts. Where they scatter more, the part whose loss brings the rest nearest together goes first,
until those that are left agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, terms
from tiago_mj.gap.parts import Likeness, Value
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.io.quantities import NINETY
from tiago_mj.recordings.like import alike

Array = NDArray[np.float64]

#: Probability at which parts that are alike are said to differ, over all magnitudes that are compared together.
FALSE_ALARM: Final = 0.05
#: Digits of what is told.
DIGITS: Final = 6


def compared(values: Mapping[str, tuple[float, float]], level: float) -> tuple[float, float, tuple[str, ...]]:
    """Chi-square of the parts' differences, its probability where they are alike, and the parts that differ.

    Args:
        values: magnitude and standard deviation by part, two or more.
        level: probability below which they differ.

    Returns:
        With no two that agree, all of the parts.
    """
    chi_square, chance = _scatter(list(values.values()))
    left, gone = dict(values), []
    while len(left) > 1 and _scatter(list(left.values()))[1] < level:
        rest = {part: _scatter([v for name, v in left.items() if name != part])[0] for part in left}
        worst = min(rest, key=lambda part: rest[part]) if len(left) > 2 else None
        if worst is None:
            return chi_square, chance, tuple(values)
        gone.append(worst)
        del left[worst]
    return chi_square, chance, tuple(part for part in values if part in gone)


def mean(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Weighted mean of magnitudes with their deviations, and its own deviation."""
    weight = np.array([1 / deviation**2 for _, deviation in values])
    of = np.array([value for value, _ in values])
    return float((weight * of).sum() / weight.sum()), float(weight.sum() ** -0.5)


def _scatter(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    middle, _ = mean(values)
    chi_square = sum(((value - middle) / deviation) ** 2 for value, deviation in values)
    return float(chi_square), float(stats.chi2.sf(chi_square, max(len(values) - 1, 1)))


def beside(found: Diagnosis, session: Session, ranked: Ranked, said: Sequence[str]) -> Diagnosis:
    """The answer with which of its magnitudes like parts share; with a sentence where there was no time for it."""
    try:
        return replace(found, like=told(session, ranked, ranked.fits[0], said))
    except OutOfTimeError:
        return replace(found, notes=(*found.notes, "There was no time to compare the parts that are alike."))


def told(session: Session, ranked: Ranked, best: Fitted, said: Sequence[str]) -> tuple[Likeness, ...]:
    """The magnitudes of an explanation on every like part, fitted together with the nominal numbers, and compared.

    What only some parts were given is fitted on all of them: where it is not needed its value is near to none.

    Args:
        session: the trials, their splits and the plant.
        ranked: the search, with its predictor, sample weights and excluded trials.
        best: the explanation.
        said: what the names of the parts begin with.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    targets = session.plant.wiring.targets
    names = {kind: alike(targets.names(kind), said) for kind in ("joint", "command") if targets.names(kind)}
    rows: dict[tuple[str, str, tuple[tuple[str, float], ...], str], dict[str, Candidate]] = {}
    begun: dict[Candidate, float] = {}
    others = []
    for part, value in zip(best.parts, best.values, strict=True):
        kind = EFFECTS[part.effect].targets
        mine = [
            (one, place)
            for one, by_place in names.get(kind, {}).items()
            for place, name in by_place.items()
            if part.target is None or name in part.target
        ]
        if not mine or EFFECTS[part.effect].common:
            others.append((part, float(value)))
        for one, place in mine if not EFFECTS[part.effect].common else ():
            each = {leg: replace(part, target=(by_place[place],)) for leg, by_place in names[kind].items()}
            each = rows.setdefault((part.effect, part.parameter, part.fixed, place), each)
            more = float(value) - part.identity if np.isfinite(part.identity) else 0.0
            begun[each[one]] = begun[each[one]] + more if each[one] in begun else float(value)
    if not rows:
        return ()
    parts = [candidate for each in rows.values() for candidate in each.values()]
    at = [min(max(begun.get(one, one.identity), one.low), one.high) for one in parts]
    start = np.array([*at, *(value for _, value in others)])
    fit = _fitted(session, ranked, (*parts, *(part for part, _ in others)), start)
    widens = verdict.calibration(replays=ranked.predict.replays).widens
    found: dict[Candidate, tuple[float, float]] = {
        part: (float(value), float(deviation) * widens)
        for part, value, deviation in zip(fit.parts, fit.values, fit.deviations, strict=True)
    }
    level = FALSE_ALARM / len(rows)
    return tuple(
        _likeness(parameter, place, {one: found[part] for one, part in each.items()}, level, each)
        for (_, parameter, _, place), each in rows.items()
    )


def _fitted(session: Session, ranked: Ranked, parts: tuple[Candidate, ...], start: Array) -> Fitted:
    """Magnitudes fitted to all trials that explanations are fitted to, with the nominal numbers around them."""
    trials = session.subset(*FITTED).without(ranked.excluded)
    some, nuisances = noise_model.select_trials(ranked.predict.data, trials), terms(session.plant)
    nuisances = tuple(sorted(nuisances, key=lambda term: term.per_trial))
    flat = np.zeros((len(nuisances), *some.value.shape))
    fitter = Fitter(ranked.predict, trials, some, ranked.weight, nuisances, flat)
    fitter = fitter.linearized_at(Point(parts, start, np.zeros(fitter.size)))
    return fitter.fit_all([Start(parts, start)])[0]


def _likeness(
    parameter: str,
    place: str,
    values: Mapping[str, tuple[float, float]],
    level: float,
    each: Mapping[str, Candidate],
) -> Likeness:
    chi_square, chance, differs = compared(values, level)
    agreeing = [value for part, value in values.items() if part not in differs]
    one = next(iter(each.values()))
    unit = one.unit
    return Likeness(
        name=one.effect,
        place=place,
        parameter=parameter,
        values={part: _value(*value, unit) for part, value in values.items()},
        common=_value(*mean(agreeing), unit) if agreeing else None,
        chi_square=_rounded(chi_square),
        probability=_rounded(chance),
        differs=differs,
    )


def _value(value: float, deviation: float, unit: str) -> Value:
    reach = NINETY * deviation
    return Value(_rounded(value), _rounded(value - reach), _rounded(value + reach), unit)


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
