"""Where to look for a second and a third effect: beside an explanation, or two that explain together what neither does
alone."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.search.screen import Screened, screen
from tiago_mj.gap.search.starts import with_zero_nuisances
from tiago_mj.gap.simulation.replay import sensor_only

Array = NDArray[np.float64]

#: Extensions of an explanation that are fitted to the trials of the first pass. Chosen by hand; no ablation.
MAX_EXTENSIONS: Final = 4
#: Pairs found by superposition that are fitted to the trials of the first pass, and magnitudes tried of each effect.
#: Chosen by hand; no ablation.
MAX_SUPERPOSED_PAIRS: Final = 6
MAGNITUDES_PER_EFFECT: Final = 7
#: Classes considered per joint or cell for pairs that act on different ones. Chosen by hand; no ablation.
CLASSES_PER_PART: Final = 6
#: Smallest predicted gain of log-likelihood for which another effect is fitted [nats]: less would not outweigh its
#: prior. Chosen by hand; no ablation.
MIN_PREDICTED_GAIN_NATS: Final = 5.0


def extensions(
    fitter: Fitter,
    on: likelihood.Frame,
    seeds: Sequence[Fitted],
    promising: Sequence[Screened],
    least: float = MIN_PREDICTED_GAIN_NATS,
) -> list[Start]:
    """The best explanations with another effect, found by adding its change to the prediction of the first; it must
    add so much evidence at least [nats]."""
    starts: dict[object, Start] = {}
    for seed in seeds:
        # Without its own nuisances: they may have absorbed what the other effect is to explain.
        whole = fitter.predictions([Point(seed.parts, seed.values, on.at)])[0]
        there = {part.label for part in seed.parts}
        alone = float(likelihood.log_likelihood(on, whole[None])[0])
        found: list[tuple[float, Screened, float]] = []
        for s in promising:
            if s.candidate.label not in there:
                gains = likelihood.log_likelihood(on, whole + s.changes) - alone - s.selection_penalty
                best = int(np.argmax(gains))
                found.append((float(gains[best]), s, s.values[best]))
        kinds: set[object] = set()
        for gain, s, value in sorted(found, key=lambda item: -item[0]):
            if gain < least or len(kinds) == MAX_EXTENSIONS:
                break
            if _kind(s.candidate) not in kinds:
                kinds.add(_kind(s.candidate))
                values = np.array([*seed.values, value])
                start = Start((*seed.parts, s.candidate), values, on.at, with_zero_nuisances(values, on.at))
                starts.setdefault(frozenset(part.label for part in start.parts), start)
    return list(starts.values())


def with_sensor_effect(few: Fitter, everywhere: Fitter, seed: Fitted, pool: Sequence[Candidate]) -> list[Fitted]:
    """An explanation with an effect of the sensors, each tried beside it, with its own nominal numbers and their
    responses: what a sensor does to another motion is not what it does to the nominal one, and costs no simulation.

    Args:
        few: of the trials that the first pass looked at.
        everywhere: of all, in which those were not found to go another way: else nothing is sought.
        seed: the explanation, fitted to all.
        pool: candidates.
    """
    labels = {part.label for part in seed.parts}
    sensing = [c for c in pool if c.label not in labels and sensor_only(c.entry(c.high))]
    if not sensing or not set(few.trials) <= set(everywhere.trials):
        return []
    rows = [everywhere.trials.index(trial) for trial in few.trials]
    at = Point(seed.parts, seed.values, everywhere.of(rows, seed.nuisance))
    there = few.linearized_at(at)
    return there.fit_all(_screened_starts(there, at, sensing))


def with_effect_on_worst_trials(
    fitter: Fitter, seed: Fitted, count: int, pool: Sequence[Candidate], nuisance: Array
) -> list[Start]:
    """An explanation with another effect, found by trying all of them beside it where it fails most.

    Args:
        fitter: of trials.
        seed: the explanation.
        count: of trials that are looked at.
        pool: what is tried.
        nuisance: nominal numbers, not the explanation's own: they may have absorbed what is to be explained.
    """
    at = Point(seed.parts, seed.values, nuisance)
    worst = _worst_trials(fitter.predictions([at])[0], fitter.data, count)
    there, at = fitter.part(worst), Point(seed.parts, seed.values, fitter.of(worst, nuisance))
    labels = {part.label for part in seed.parts}
    found = _screened_starts(there, at, [c for c in pool if c.label not in labels])
    return [
        replace(start, nuisance=nuisance, alternatives=with_zero_nuisances(start.values, nuisance)) for start in found
    ]


def _screened_starts(there: Fitter, at: Point, tried: Sequence[Candidate]) -> list[Start]:
    """A point with one more effect each, of those that promise most there, each simulated."""
    frame = likelihood.frame(there.data, there.weight, there.responses, there.per_trial, at.nuisance)
    found: dict[object, Start] = {}
    for s in screen(there, frame, tried, at, there.predictions([at], keep=True)[0]):
        if s.gain < MIN_PREDICTED_GAIN_NATS or len(found) == MAX_EXTENSIONS:
            break
        start = Start((*at.parts, s.candidate), np.array([*at.values, s.value]), at.nuisance)
        found.setdefault(_kind(s.candidate), start)
    return list(found.values())


def _worst_trials(predicted: Array, data: Data, count: int) -> list[int]:
    """Trials that fail most, sample by sample and by errors that last, in turn."""
    single = _by_misfit(predicted, data)
    lasting = np.argsort(-likelihood.lasting_per_trial(data, data.value - predicted))
    in_turn = [int(k) for both in zip(single, lasting, strict=True) for k in both]
    return sorted(list(dict.fromkeys(in_turn))[:count])


def _kind(candidate: Candidate) -> object:
    """Candidates of one kind lead to the same place: of one class, all on one target, or all on every one."""
    return EFFECTS[candidate.effect].gap_class, candidate.target is None


def superposed_pairs(on: likelihood.Frame, base: Array, promising: Sequence[Screened]) -> list[Start]:
    """The best pairs by the sum of both changes, at all magnitudes: the best pair need not hold the best single.

    Args:
        on: frame of some trials.
        base: nominal predictions of these, (ntrials, T, C).
        promising: after the first pass, best first.
    """
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
            start = Start((a.candidate, b.candidate), values, on.at, with_zero_nuisances(values, on.at))
            found.append((float(gains[best]), start))
    out: dict[frozenset[object], Start] = {}
    for _, start in sorted(found, key=lambda item: -item[0]):
        out.setdefault(frozenset(_kind(part) for part in start.parts), start)
    return list(out.values())[:MAX_SUPERPOSED_PAIRS]


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


def unique_by_labels(starts: Sequence[Start]) -> list[Start]:
    """The first start of every set of effects and targets."""
    out: dict[object, Start] = {}
    for start in starts:
        out.setdefault(frozenset(part.label for part in start.parts), start)
    return list(out.values())


def worst_predicted(base: Array, data: Data, count: int) -> list[int]:
    """The ``count`` trials in which a prediction has the largest misfit, in order of their index."""
    return sorted(_by_misfit(base, data)[:count])


def _by_misfit(predicted: Array, data: Data) -> list[int]:
    """Trials, those first in which a prediction fails most, sample by sample."""
    white = likelihood.scaled(data, likelihood.residual(data, predicted))
    size = (likelihood.soften(white) ** 2).sum(axis=(1, 2))
    return [int(k) for k in np.argsort(-size)]
