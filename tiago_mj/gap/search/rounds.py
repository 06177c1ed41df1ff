"""Rounds of fits with equal effort for all explanations: to the screening trials, the best to all trials, then with
nuisance responses linearized around the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.search import ranking, starts
from tiago_mj.gap.search.ranking import by_evidence, labels_of

Array = NDArray[np.float64]

#: Explanations of some trials that are fitted to all. Halved and doubled, none of 16 answers about hinges changes
#: (varied.json).
MAX_ON_ALL_TRIALS: Final = 4
#: Further ones within this of the best are, too [nats]. Halved and doubled, none of 15 answers about hinges changes
#: (varied.json).
TIE_NATS: Final = 2.0
#: Fits of one explanation begun at different places end this far apart where contacts are (five contact cases of the
#: blind check, three starts each: 50 to 200): what is farther behind than that is not fitted to more trials [nats].
HOPELESS_DEFICIT_NATS: Final = 200.0
#: Where the nominal model is adequate, an effect is fitted to all trials only where its extrapolated evidence exceeds
#: the nominal model's by this [nats]: a Bayes factor below 2.7 is "not worth more than a bare mention" (Kass &
#: Raftery 1995).
MIN_EXPECTED_GAIN_NATS: Final = 1.0
#: Explanations, the best first, that are fitted with the responses around the best of them, and rivals with those
#: around themselves. Halved and doubled, none of 32 answers about hinges changes (varied.json).
MAX_NEAR: Final = 3
MAX_RIVALS: Final = 2
#: Rounds of responses around the best at most, and the evidence that one must gain for another [nats]: where
#: contacts slip each goes a short way. Halved and doubled, none of 31 answers about hinges changes (varied.json).
MAX_ROUNDS: Final = 5
MIN_ROUND_GAIN_NATS: Final = 3.0
#: An explanation that leaves more than this is not fitted around itself. Halved and doubled, none of 16 answers
#: about hinges changes (varied.json).
HOPELESS_DISCREPANCY: Final = 8 * ranking.INADEQUATE_DISCREPANCY
#: Explanations that are refitted when the sample weights change; the others are only evaluated anew. Halved and
#: doubled, none of 16 answers about hinges changes (varied.json).
MAX_REFITTED: Final = 2


def worth_all_trials(on_screening: Sequence[Fitted], nominal: Fitted, times: float) -> list[Fitted]:
    """Of explanations fitted to the screening trials, those to be fitted to all trials, by decreasing evidence.

    These are the first few and all that are nearly as good as the best; without those hopelessly behind it or, where
    the nominal model explains the recordings, behind the nominal model.

    Args:
        on_screening: explanations by effects.
        nominal: the nominal model on the same trials.
        times: how many times as many trials there are.
    """
    ahead = by_evidence(on_screening)
    near = [f for k, f in enumerate(ahead) if k < MAX_ON_ALL_TRIALS or f.evidence > ahead[0].evidence - TIE_NATS]
    expected = [ranking.extrapolated_evidence(f, times) for f in near]
    near = [f for f, e in zip(near, expected, strict=True) if e > max(expected) - HOPELESS_DEFICIT_NATS]
    if ranking.is_adequate(nominal):
        least = ranking.extrapolated_evidence(nominal, times) + MIN_EXPECTED_GAIN_NATS
        near = [f for f in near if ranking.extrapolated_evidence(f, times) > least] or near[:1]
    return near


def expected_to_add(on_screening: Sequence[Fitted], seed: Fitted, screening: Fitter, full: Fitter) -> bool:
    """Whether the best explanation with one more effect, extrapolated from the screening trials to all trials, is
    expected to gain enough evidence to be reported."""
    if not on_screening or not full.trials.holds(screening.trials):
        return bool(on_screening)
    rows = full.trials.rows_of(screening.trials)
    best = by_evidence(on_screening)[0]
    prediction = screening.predictions([Point.of(best)])[0]
    screening = replace(
        screening, weight=np.maximum(screening.weight, ranking.sample_weight(screening.data, prediction))
    )
    alone = Start(seed.parts, seed.values, full.of(rows, seed.nuisance))
    more, fewer = screening.fit_all([starts.restart(best), alone])
    times = len(full.trials) / len(screening.trials)
    return (
        ranking.extrapolated_evidence(more, times)
        > ranking.extrapolated_evidence(fewer, times) + ranking.MIN_EVIDENCE_GAIN_NATS
    )


def around_the_best(full: Fitter, fits: Sequence[Fitted]) -> tuple[Fitter, list[Fitted]]:
    """Explanations with further fits, and the fitter with nuisance responses linearized around the best explanation.

    Explanations near the best, the nominal model and the best with fewer effects are fitted with the same responses, so
    that all get the same effort. Rounds end where the best explains the recordings or a round gains little. Rivals of
    other classes are then linearized around themselves.
    """
    fits, size = list(fits), full.size
    for k in range(MAX_ROUNDS):
        best, nominal = by_evidence(fits)[0], ranking.best_nominal(fits)
        none = best.evidence - nominal.evidence < ranking.MIN_EVIDENCE_GAIN_NATS
        if full.out_of_time() or (ranking.is_adequate(nominal) if none else _is_done(fits, k)):
            break
        full = full.linearized_at(Point.of(best))
        begin = [starts.restart(f) for f in _near(fits)]
        begin.append(replace(starts.restart(nominal), alternatives=((nominal.values, best.nuisance),)))
        fewer = [f for f in by_evidence(fits) if 0 < len(f.parts) < len(best.parts)][:1]
        begin += [replace(starts.restart(f), alternatives=((f.values, best.nuisance),)) for f in fewer]
        if not k and best.parts and np.abs(best.nuisance).max(initial=0.0) > starts.FAR_NUISANCE_DEVIATIONS:
            begin.append(Start(best.parts, best.values, np.zeros(size)))  # they may have absorbed the effect
        fits += full.fit_all(begin)
        if by_evidence(fits)[0].evidence - best.evidence < MIN_ROUND_GAIN_NATS:
            break
    return full, [*fits, *_around_rivals(full, fits)]


def _is_done(fits: Sequence[Fitted], rounds: int) -> bool:
    """Whether no further round is needed: the best explanation is adequate and has no close rival, of another class or
    with fewer effects, or its reduced chi-square is hopeless."""
    best = by_evidence(fits)[0]
    alone = len(best.parts) < 2 and len(ranking.unique_by_classes(_near(fits))) < 2
    return (ranking.is_adequate(best) and (rounds > 0 or alone)) or ranking.discrepancy(best) > HOPELESS_DISCREPANCY


def _near(fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations by effects within a few nats of the best, by decreasing evidence."""
    best = by_evidence(fits)[0]
    gap = ranking.discrepancy(best) > ranking.ADEQUATE_DISCREPANCY
    least = best.evidence - (ranking.LOCAL_OPTIMUM_NATS if gap else ranking.NEAR_BEST_NATS)
    return ranking.unique_by_labels([f for f in fits if f.parts and f.evidence > least])[:MAX_NEAR]


def _around_rivals(full: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Fits of close rivals of other classes than the best, with nuisance responses linearized around each of them."""
    near = ranking.unique_by_classes(_near(fits))
    rivals = [f for f in near[1:] if f.evidence > near[0].evidence - ranking.NEAR_BEST_NATS][:MAX_RIVALS]
    if not rivals or full.out_of_time():
        return []
    begin = [starts.restart(f) for f in rivals]
    return full.fit_each(full.linearized_at_each([Point.of(s) for s in begin]), begin)


def variations(fits: Sequence[Fitted], full: Fitter) -> list[Start]:
    """Starts that simplify the best explanations: without effects that are insignificant or absorbed by a nominal
    number, without each of several effects, and with one effect on all targets in place of the same effect on each."""
    ahead = ranking.unique_by_labels(fits)
    best, known = ahead[0], {labels_of(f) for f in fits}
    near = [f for f in ahead if f.evidence > best.evidence - ranking.NEAR_BEST_NATS]
    out = [s for s in (starts.absorbed_by_nuisances(f, full) for f in near) if s is not None]
    dropped = [reduced_to(f, significant(f)) for f in near]
    dropped += [reduced_to(best, [i for i in range(len(best.parts)) if i != k]) for k in range(len(best.parts))]
    out += [s for s in dropped if s is not None and frozenset(p.label for p in s.parts) not in known]
    return out + on_all_targets(best, full)


def significant(fit: Fitted) -> list[int]:
    """Which of an explanation's effects differ from none."""
    return [k for k in range(len(fit.parts)) if ranking.differs_from_identity(fit, k)]


def reduced_to(fit: Fitted, kept: Sequence[int]) -> Start | None:
    """Start with some of the effects of an explanation; None where that is none or all of them."""
    if not 0 < len(kept) < len(fit.parts):
        return None
    index = list(kept)
    return Start(tuple(fit.parts[k] for k in index), fit.values[index], fit.nuisance)


def on_all_targets(fit: Fitted, fitter: Fitter) -> list[Start]:
    """Starts with one effect on all targets, from an explanation that has it on each target separately."""
    out = []
    for effect in dict.fromkeys(part.effect for part in fit.parts):
        mine = [k for k, part in enumerate(fit.parts) if part.effect == effect and part.target is not None]
        names = {name for k in mine for name in fit.parts[k].target or ()}
        if len(mine) < 2 or names != set(fitter.predict.plant.wiring.targets.names(EFFECTS[effect].targets)):
            continue
        rest = [k for k in range(len(fit.parts)) if k not in mine]
        paid = tuple(sum(each) for each in zip(*(fit.parts[k].selection_penalty for k in mine), strict=True))
        parts = (replace(fit.parts[mine[0]], target=None, selection_penalty=paid), *(fit.parts[k] for k in rest))
        one = min(max(float(fit.values[mine].mean()), parts[0].low), parts[0].high)  # a joint's bounds are its own
        out.append(Start(parts, np.array([one, *fit.values[rest]]), fit.nuisance))
    return out


def reweighted(full: Fitter, fits: Sequence[Fitted], refitted: int = MAX_REFITTED) -> list[Fitted]:
    """Explanations under the present sample weights: the nominal model and the best few fitted again, the others
    evaluated at their magnitudes."""
    nominal = ranking.best_nominal(fits)
    ahead = [f for f in ranking.unique_by_labels(fits) if f.parts]
    where_they_are = replace(full, iterations=0)
    again = [starts.restart(f) for f in (nominal, *ahead[:refitted])]
    return full.fit_all(again) + where_they_are.fit_all([starts.restart(f) for f in ahead[refitted:]])


def without_departing_trials(
    full: Fitter, fits: list[Fitted], nominal_nuisance: Array
) -> tuple[Fitter, list[Fitted], Array]:
    """Fitter, explanations and nominal nuisances without the trials whose motion departs from the best explanation.

    No parameter of the model reproduces such a motion, and it would bias the fits of all explanations.
    """
    best = full.predictions([Point.of(by_evidence(fits)[0])])[0]
    departing = likelihood.departing_trials(full.data, full.data.value - best)
    if not departing.any() or full.out_of_time():
        return full, fits, nominal_nuisance
    kept = [k for k, one in enumerate(departing) if not one]
    rest = full.part(kept)
    ahead = [f for f in ranking.unique_by_labels(fits) if f.parts][:MAX_ON_ALL_TRIALS]
    begin = [Start(f.parts, f.values, full.of(kept, f.nuisance)) for f in (ranking.best_nominal(fits), *ahead)]
    return rest, rest.fit_all(begin), full.of(kept, nominal_nuisance)
