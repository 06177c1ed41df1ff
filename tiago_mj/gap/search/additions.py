"""Proposals for the next fits: single effects, or one more effect beside an explanation that was fitted before."""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import resembling
from tiago_mj.effects.targets import Targets
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Label
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.search import starts
from tiago_mj.gap.search.ranking import MIN_EVIDENCE_GAIN_NATS
from tiago_mj.gap.search.screen import Screened, misfit_by_trial, scored_beside, screen

Array = NDArray[np.float64]

#: Single effects that are fitted to the screening trials, and fewest of them. Halved and doubled, none of 32 answers
#: about hinges changes (varied.json).
MAX_SINGLES: Final = 8
MIN_SINGLES: Final = 3
#: Where screening gains this much [nats], effects that gain less than this share of the most are not fitted. Of 46
#: cases the right one was the best in 30, never behind 0.9 of it but where little was gained, and once 0.6.
DECISIVE_GAIN_NATS: Final = 10.0
MIN_SHARE_OF_BEST_GAIN: Final = 0.4
#: Where no gain is decisive, effects whose gain is this much below the largest are not fitted, apart from the first few
#: [nats]: a Bayes factor of 150 against them, "very strong" (Kass & Raftery 1995).
MAX_GAIN_DEFICIT_NATS: Final = 5.0
#: Extensions of an explanation that are fitted. With 4 an encoder's scale of 0.992 is not tried beside a rotor inertia
#: (seed 9917, case 9; of five hinges with pairs this one becomes right and none wrong, by 1.0 to 1.2 times the physics
#: steps), and one of eight other hinges becomes right with 8 (seed 3737).
MAX_EXTENSIONS: Final = 8
#: Others of its class for which an effect of an explanation is exchanged. Halved and doubled, none of 16 answers
#: about hinges changes (varied.json).
MAX_EXCHANGED: Final = 3
#: Pairs found by superposition that are fitted to the screening trials, and magnitudes tried of each effect. Halved
#: and doubled, none of 32 answers about hinges changes (varied.json).
MAX_SUPERPOSED_PAIRS: Final = 6
MAGNITUDES_PER_EFFECT: Final = 7
#: Classes considered per joint or cell for pairs that act on different ones. Halved and doubled, none of 16 answers
#: about hinges changes (varied.json).
CLASSES_PER_PART: Final = 6
#: Smallest predicted gain of log-likelihood for which another effect is fitted [nats]: less would not outweigh its
#: prior. Where what is there explains the recordings, an effect's form may leave this much. Halved and doubled, none
#: of 32 answers about hinges changes (varied.json).
MIN_PREDICTED_GAIN_NATS: Final = MIN_EVIDENCE_GAIN_NATS
MIN_GAIN_BESIDE_ADEQUATE_NATS: Final = 15.0


def singles(screened: Sequence[Screened], moved: Sequence[Label], count: int = MAX_SINGLES) -> list[Screened]:
    """The screened effects to be fitted alone, at most ``count`` of them, by decreasing gain.

    The best of every effect on all its targets and on one target come first, then every effect and target; at most half
    are of one class, so that other classes are fitted, too. Effects that change a nominal number which the fit of the
    nominal model moved far (``moved``, by label) are added: beside the moved number they show no gain.
    """
    out: list[Screened] = []
    seen: set[Label] = set()
    classes: dict[str, int] = {}
    leaders: dict[tuple[str, bool], Screened] = {}
    for s in screened:
        leaders.setdefault((s.candidate.effect, s.candidate.target is None), s)
    most = max((s.gain for s in screened), default=0.0)
    least = max(MIN_SHARE_OF_BEST_GAIN * most if most > DECISIVE_GAIN_NATS else most - MAX_GAIN_DEFICIT_NATS, 0.0)
    for s in (*leaders.values(), *screened):
        gap_class = EFFECTS[s.candidate.effect].gap_class
        if s.gain < least and len(out) >= MIN_SINGLES:
            continue
        if s.candidate.label in seen or classes.get(gap_class, 0) >= count // 2:
            continue
        seen.add(s.candidate.label)
        classes[gap_class] = classes.get(gap_class, 0) + 1
        out.append(s)
        if len(out) == count:
            break
    further = (next((s for s in screened if s.candidate.label == label), None) for label in moved if label not in seen)
    return [*out, *(s for s in further if s is not None)]


def beside(
    screening: Fitter, seed: Fitted, nominal_nuisance: Array, promising: Sequence[Screened], least: float
) -> list[Start]:
    """Starts that add one effect to an explanation, found by superposition: the screened change of each effect is added
    to the prediction of the explanation, whose own magnitudes may move, and the log likelihood is compared.

    Args:
        screening: of the screening trials.
        seed: the explanation.
        nominal_nuisance: nuisances of the nominal model on these trials. The explanation's own may have absorbed the
            effect that is to be added.
        promising: screened effects.
        least: smallest predicted gain [nats].
    """
    point = Point(seed.parts, seed.values, nominal_nuisance)
    whole = screening.predictions([point])[0]
    on = scored_beside(screening, point, whole)
    alone = float(likelihood.log_likelihood(on, whole[None])[0])
    targets, found = screening.predict.plant.wiring.targets, []
    for s in promising:
        if not _is_there(s.candidate, seed, targets):
            gains = likelihood.log_likelihood(on, whole + s.changes) - alone - s.selection_penalty
            best = int(np.argmax(gains))
            found.append((float(gains[best]), s.candidate, s.values[best]))
    out = []
    for candidate, value in _best_of_each_kind(found, least):
        values = np.array([*seed.values, value])
        out.append(
            Start(
                (*seed.parts, candidate), values, nominal_nuisance, starts.with_zero_nuisances(values, nominal_nuisance)
            )
        )
    return out


def where_it_fails(full: Fitter, seed: Fitted, nuisance: Array, count: int, pool: Sequence[Candidate]) -> list[Start]:
    """Starts that add one effect to an explanation, found by simulating every candidate beside it in the trials that it
    predicts worst.

    Args:
        full: of all trials.
        seed: the explanation.
        nuisance: of the nominal model; the explanation's own may have absorbed the effect that is to be added.
        count: of trials that are simulated.
        pool: what is tried.
    """
    point = Point(seed.parts, seed.values, nuisance)
    worst = worst_trials(full.predictions([point])[0], full.data, count)
    targets = full.predict.plant.wiring.targets
    pool = [c for c in pool if not _is_there(c, seed, targets)]
    found = screen(full.part(worst), pool, replace(point, nuisance=full.of(worst, nuisance)))
    out = []
    gains = [(s.gain, s.candidate, s.value) for s in found.on_all]
    for candidate, value in _best_of_each_kind(gains, MIN_PREDICTED_GAIN_NATS):
        values = np.array([*seed.values, value])
        out.append(Start((*seed.parts, candidate), values, nuisance, starts.with_zero_nuisances(values, nuisance)))
    return out


def superposed_pairs(screening: Fitter, linearization_point: Point, promising: Sequence[Screened]) -> list[Start]:
    """Starts with two effects, from the largest log likelihood of their superposed changes over all pairs of
    magnitudes; the best pair need not contain the best single effect.

    Args:
        screening: of the screening trials.
        linearization_point: the nominal model on these trials.
        promising: screened effects, by decreasing gain.
    """
    base = screening.predictions([linearization_point], keep=True)[0]
    on = likelihood.frame(
        screening.data, screening.weight, screening.responses, screening.per_trial, linearization_point.nuisance
    )
    leaders: dict[str, Screened] = {}
    for s in promising:
        if s.candidate.target is None:
            leaders.setdefault(s.candidate.effect, s)
    pairs = [*itertools.combinations(leaders.values(), 2), *_pairs_on_different_parts(promising)]
    alone = max((s.gain for s in promising), default=0.0) + float(likelihood.log_likelihood(on, base))
    found: list[tuple[float, Start]] = []
    for a, b in pairs:
        (i, one), (j, other) = _thinned_magnitudes(a), _thinned_magnitudes(b)
        gains = (
            likelihood.log_likelihood(on, base + one[:, None] + other[None]) - a.selection_penalty - b.selection_penalty
        )
        best = np.unravel_index(int(np.argmax(gains)), gains.shape)
        values = np.array([a.values[i[best[0]]], b.values[j[best[1]]]])
        if gains[best] >= alone + MIN_PREDICTED_GAIN_NATS:
            also = starts.with_zero_nuisances(values, linearization_point.nuisance)
            found.append(
                (float(gains[best]), Start((a.candidate, b.candidate), values, linearization_point.nuisance, also))
            )
    out: dict[frozenset[object], Start] = {}
    for _, start in sorted(found, key=lambda item: -item[0]):
        out.setdefault(frozenset(_kind(part) for part in start.parts), start)
    return list(out.values())[:MAX_SUPERPOSED_PAIRS]


def exchanged(
    full: Fitter, best: Fitted, count: int, pool: Sequence[Candidate], tried: Container[object] = (), *, gap: bool
) -> list[Start]:
    """Starts in which one effect of an explanation is exchanged for one that it resembles or, where it leaves a gap,
    for another of its class, at the magnitude with the largest gain beside the remaining effects.

    Screening keeps only the most promising effects of a class, and one that resembles it may have been the better
    single, so that the right one may be missing.

    Args:
        full: of all trials.
        best: the explanation.
        count: of trials that are simulated.
        pool: candidates.
        tried: sets of labels of explanations that were fitted.
        gap: whether the explanation leaves one.
    """
    there = {part.label for part in best.parts}
    point = Point.of(best)
    worst = worst_trials(full.predictions([point])[0], full.data, count)
    worst_fitter, out = full.part(worst), []
    for k, part in enumerate(best.parts):
        alike = resembling(part.effect)
        others = [
            c
            for c in pool
            if c.label not in there
            and (gap or (there - {part.label}) | {c.label} not in tried)
            and (c.effect in alike or (gap and EFFECTS[c.effect].gap_class == EFFECTS[part.effect].gap_class))
            and (c.target is None) == (part.target is None)
        ]
        if not others:
            continue
        rest = point.without_effect(k)
        found = screen(worst_fitter, others, replace(rest, nuisance=full.of(worst, rest.nuisance)))
        at_best: dict[Label, Screened] = {}  # of each label at its likeliest second number
        for s in found.on_all:
            at_best.setdefault(s.candidate.label, s)
        for s in list(at_best.values())[:MAX_EXCHANGED]:
            parts, values = list(best.parts), best.values.copy()
            parts[k], values[k] = s.candidate, s.value
            out.append(Start(tuple(parts), values, rest.nuisance, starts.with_zero_nuisances(values, rest.nuisance)))
    return out


def unique(tried: Iterable[Start]) -> list[Start]:
    """The first start of every set of effects and targets."""
    out: dict[object, Start] = {}
    for start in tried:
        out.setdefault(frozenset(part.label for part in start.parts), start)
    return list(out.values())


def worst_trials(predicted: Array, data: Data, count: int) -> list[int]:
    """Indices of the ``count`` trials with the largest residuals, alternately by mean square per sample and by mean
    square over blocks; ascending."""
    single = np.argsort(-misfit_by_trial(data, predicted))
    lasting = np.argsort(-likelihood.lasting_per_trial(data, data.value - predicted))
    in_turn = [int(k) for both in zip(single, lasting, strict=True) for k in both]
    return sorted(list(dict.fromkeys(in_turn))[:count])


def _is_there(candidate: Candidate, seed: Fitted, targets: Targets) -> bool:
    """Whether an explanation has a candidate's effect already, on its targets together or on each: then a further
    number of it makes no other model."""
    names = targets.names(EFFECTS[candidate.effect].targets)
    on = set(candidate.target or names)
    mine = [set(part.target or names) for part in seed.parts if part.effect == candidate.effect]
    return set[str]().union(*(one for one in mine if one <= on)) == on


def _best_of_each_kind(found: Sequence[tuple[float, Candidate, float]], least: float) -> list[tuple[Candidate, float]]:
    """The candidate and magnitude with the largest gain of each kind, by decreasing gain."""
    out: dict[object, tuple[Candidate, float]] = {}
    for gain, candidate, value in sorted(found, key=lambda item: -item[0]):
        if gain < least or len(out) == MAX_EXTENSIONS:
            break
        out.setdefault(_kind(candidate), (candidate, value))
    return list(out.values())


def _kind(candidate: Candidate) -> object:
    """Effect class, and whether the candidate acts on all targets: candidates that share both lead to similar fits."""
    return EFFECTS[candidate.effect].gap_class, candidate.target is None


def _pairs_on_different_parts(promising: Sequence[Screened]) -> list[tuple[Screened, Screened]]:
    """Pairs of effects on two different targets, such as two fingers, from the most promising on each."""
    by_target: dict[tuple[str, ...], dict[str, Screened]] = {}
    for s in promising:
        if s.candidate.target is not None:
            mine = by_target.setdefault(s.candidate.target, {})
            if len(mine) < CLASSES_PER_PART:
                mine.setdefault(EFFECTS[s.candidate.effect].gap_class, s)
    return [
        (a, b)
        for one, other in itertools.combinations(by_target.values(), 2)
        for a, b in itertools.product(one.values(), other.values())
    ]


def _thinned_magnitudes(s: Screened) -> tuple[NDArray[np.int_], Array]:
    """An evenly spaced subset of the screened magnitudes, as indices, and the changes of predictions at those."""
    kept = np.unique(np.linspace(0, len(s.values) - 1, MAGNITUDES_PER_EFFECT).round().astype(int))
    return kept, s.changes[kept]
