"""Which explanations are tried next: a single effect, or another one beside what explains the recordings so far."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Label
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.search import starts
from tiago_mj.gap.search.ranking import MIN_EVIDENCE_GAIN_NATS
from tiago_mj.gap.search.screen import Screened, misfit_by_trial, screen

Array = NDArray[np.float64]

#: Single effects that are fitted to the trials of the first pass, and fewest of them. Chosen by hand; no ablation.
MAX_SINGLES: Final = 8
MIN_SINGLES: Final = 3
#: Where the first pass gains this much [nats], effects that gain less than this share of the most are not fitted. Of 46
#: cases the right one was the best in 30, never behind 0.9 of it but where little was gained, and once 0.6.
DECISIVE_GAIN_NATS: Final = 10.0
MIN_SHARE_OF_BEST_GAIN: Final = 0.4
#: Where no gain is decisive, effects whose gain is this much below the largest are not fitted, apart from the first few
#: [nats]. Chosen by hand; no ablation.
MAX_GAIN_DEFICIT_NATS: Final = 5.0
#: Extensions of an explanation that are fitted to the trials of the first pass. Chosen by hand; no ablation.
MAX_EXTENSIONS: Final = 4
#: Others of its class for which an effect of an explanation is exchanged. Chosen by hand; no ablation.
MAX_EXCHANGED: Final = 3
#: Pairs found by superposition that are fitted to the trials of the first pass, and magnitudes tried of each effect.
#: Chosen by hand; no ablation.
MAX_SUPERPOSED_PAIRS: Final = 6
MAGNITUDES_PER_EFFECT: Final = 7
#: Classes considered per joint or cell for pairs that act on different ones. Chosen by hand; no ablation.
CLASSES_PER_PART: Final = 6
#: Smallest predicted gain of log-likelihood for which another effect is fitted [nats]: less would not outweigh its
#: prior. Where what is there explains the recordings, an effect's form may leave this much. Chosen by hand; no
#: ablation.
MIN_PREDICTED_GAIN_NATS: Final = MIN_EVIDENCE_GAIN_NATS
MIN_GAIN_BESIDE_ADEQUATE_NATS: Final = 15.0


def singles(screened: Sequence[Screened], moved: Sequence[Label], count: int = MAX_SINGLES) -> list[Screened]:
    """So many effects to be fitted alone, best first.

    The best of every effect on all its targets and on one of them, then of every effect and target; no more than half
    of them of one class, so that rivals get their chance. Beyond these the effects, by label, that change what the
    nominal model's numbers were moved for: beside those numbers they gain nothing.
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


def beside(few: Fitter, seed: Fitted, at: Array, promising: Sequence[Screened], least: float) -> list[Start]:
    """An explanation with another effect, found by adding its change to what the explanation predicts.

    Args:
        few: of the trials of the first pass.
        seed: the explanation.
        at: nuisances of the nominal model there. The explanation's own may have absorbed what the other effect is to
            explain.
        promising: effects after the first pass.
        least: smallest predicted gain [nats].
    """
    whole = few.predictions([Point(seed.parts, seed.values, at)])[0]
    on = likelihood.frame(few.data, few.weight, few.responses, few.per_trial, at)
    alone = float(likelihood.log_likelihood(on, whole[None])[0])
    there, found = {part.label for part in seed.parts}, []
    for s in promising:
        if s.candidate.label not in there:
            gains = likelihood.log_likelihood(on, whole + s.changes) - alone - s.selection_penalty
            best = int(np.argmax(gains))
            found.append((float(gains[best]), s.candidate, s.values[best]))
    out = []
    for candidate, value in _best_of_each_kind(found, least):
        values = np.array([*seed.values, value])
        out.append(Start((*seed.parts, candidate), values, at, starts.with_zero_nuisances(values, at)))
    return out


def where_it_fails(
    everywhere: Fitter, seed: Fitted, nuisance: Array, count: int, pool: Sequence[Candidate]
) -> list[Start]:
    """An explanation with another effect, found by trying all of them beside it in the trials in which it fails most.

    Args:
        everywhere: of all trials.
        seed: the explanation.
        nuisance: nominal numbers, not the explanation's own: they may have absorbed what is to be explained.
        count: of trials that are looked at.
        pool: what is tried.
    """
    at = Point(seed.parts, seed.values, nuisance)
    worst = worst_trials(everywhere.predictions([at])[0], everywhere.data, count)
    there, labels = everywhere.part(worst), {part.label for part in seed.parts}
    found = screen(
        there, [c for c in pool if c.label not in labels], replace(at, nuisance=everywhere.of(worst, nuisance))
    )
    out = []
    gains = [(s.gain, s.candidate, s.value) for s in found.on_all]
    for candidate, value in _best_of_each_kind(gains, MIN_PREDICTED_GAIN_NATS):
        values = np.array([*seed.values, value])
        out.append(Start((*seed.parts, candidate), values, nuisance, starts.with_zero_nuisances(values, nuisance)))
    return out


def superposed_pairs(few: Fitter, here: Point, promising: Sequence[Screened]) -> list[Start]:
    """The best pairs by the sum of both changes, at all magnitudes: the best pair need not hold the best single.

    Args:
        few: of the trials of the first pass.
        here: the nominal model there.
        promising: after the first pass, best first.
    """
    base = few.predictions([here], keep=True)[0]
    on = likelihood.frame(few.data, few.weight, few.responses, few.per_trial, here.nuisance)
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
            also = starts.with_zero_nuisances(values, here.nuisance)
            found.append((float(gains[best]), Start((a.candidate, b.candidate), values, here.nuisance, also)))
    out: dict[frozenset[object], Start] = {}
    for _, start in sorted(found, key=lambda item: -item[0]):
        out.setdefault(frozenset(_kind(part) for part in start.parts), start)
    return list(out.values())[:MAX_SUPERPOSED_PAIRS]


def of_the_same_class(everywhere: Fitter, best: Fitted, count: int, pool: Sequence[Candidate]) -> list[Start]:
    """An explanation by several effects with each of them exchanged for others of its class, at the magnitudes that
    explain most beside the rest of it: of every class only the one that promised most was tried.

    Args:
        everywhere: of all trials.
        best: the explanation.
        count: of trials that are looked at.
        pool: what is tried.
    """
    there = {part.label for part in best.parts}
    at = starts.point_of(best)
    worst = worst_trials(everywhere.predictions([at])[0], everywhere.data, count)
    few, out = everywhere.part(worst), []
    for k, part in enumerate(best.parts):
        others = [
            c
            for c in pool
            if c.label not in there
            and EFFECTS[c.effect].gap_class == EFFECTS[part.effect].gap_class
            and (c.target is None) == (part.target is None)
        ]
        if not others:
            continue
        rest = at.without_effect(k)
        found = screen(few, others, replace(rest, nuisance=everywhere.of(worst, rest.nuisance)))
        for s in found.on_all[:MAX_EXCHANGED]:
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
    """Trials that fail most, sample by sample and by errors that last, in turn; in order of their index."""
    single = np.argsort(-misfit_by_trial(data, predicted))
    lasting = np.argsort(-likelihood.lasting_per_trial(data, data.value - predicted))
    in_turn = [int(k) for both in zip(single, lasting, strict=True) for k in both]
    return sorted(list(dict.fromkeys(in_turn))[:count])


def _best_of_each_kind(found: Sequence[tuple[float, Candidate, float]], least: float) -> list[tuple[Candidate, float]]:
    """Of gains, candidates and magnitudes the best of each kind, the best first."""
    out: dict[object, tuple[Candidate, float]] = {}
    for gain, candidate, value in sorted(found, key=lambda item: -item[0]):
        if gain < least or len(out) == MAX_EXTENSIONS:
            break
        out.setdefault(_kind(candidate), (candidate, value))
    return list(out.values())


def _kind(candidate: Candidate) -> object:
    """Candidates of one kind lead to the same place: of one class, all on one target, or all on every one."""
    return EFFECTS[candidate.effect].gap_class, candidate.target is None


def _pairs_on_different_parts(promising: Sequence[Screened]) -> list[tuple[Screened, Screened]]:
    """Pairs of which each acts on a part of its own, such as another finger: of the most promising there."""
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
    """A few of the magnitudes that were looked at, by index, and their changes."""
    kept = np.unique(np.linspace(0, len(s.values) - 1, MAGNITUDES_PER_EFFECT).round().astype(int))
    return kept, s.changes[kept]
