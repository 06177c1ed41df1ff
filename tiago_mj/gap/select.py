"""Search explanations: screen all effects, fit the promising ones, add a second, rank by evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap import score, traces
from tiago_mj.gap.effects import EFFECTS
from tiago_mj.gap.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.floor import Data
from tiago_mj.gap.hypotheses import Candidate, Term
from tiago_mj.gap.predict import Predictor
from tiago_mj.gap.screen import Screened, screen

Array = NDArray[np.float64]

#: Trials of the first pass, singles and pairs that are fitted, seeds of the pairs.
SCREEN_TRIALS: Final = 4
SINGLES: Final = 10
SECONDS: Final = 4
PAIRS: Final = 5
PAIRS_AGAIN: Final = 2
SEEDS: Final = 3
#: Evidence that a second effect must add [nats]: a Bayes factor of 150, "very strong" (Kass & Raftery 1995).
SECOND_GAIN: Final = 5.0
#: A change below this share of floor and tolerance (rms, largest magnitude tried) cannot be seen in the recording.
INVISIBLE: Final = 0.05

Tick = Callable[[str, int], None]


@dataclass(frozen=True)
class Ranked:
    """Explanations with the evidence for them, best first.

    Attributes:
        fits: explanations.
        evidence: log evidence, traces included, (n,).
        screened: the first pass.
        not_excited: effects that no magnitude makes visible in these recordings.
        weight: (C,) that the evidence was computed with.
        complete: False when time ran out.
    """

    fits: tuple[Fitted, ...]
    evidence: Array
    screened: tuple[Screened, ...]
    not_excited: tuple[str, ...]
    weight: Array
    complete: bool


def select(
    predict: Predictor,
    data: Data,
    trials: Sequence[int],
    pool: Sequence[Candidate],
    terms: Sequence[Term],
    base: Array,
    marks: Sequence[traces.Trace],
    *,
    out_of_time: Callable[[], bool] = lambda: False,
    tick: Tick = lambda stage, total: None,
) -> Ranked:
    """Rank explanations of the trials.

    Args:
        predict: simulations.
        data: measured, of these trials.
        trials: their indices.
        pool: candidates.
        terms: nuisance parameters.
        base: nominal predictions, (ntrials, T, C).
        marks: what the readings betray.
        out_of_time: asked between stages.
        tick: told what begins.
    """
    tick("screening", len(pool))
    weight = score.independence(data, base)
    first = _spread(base, data, min(SCREEN_TRIALS, len(trials)))
    some = _part(data, first)
    responses = predict.all_trials([(term.entry(1.0),) for term in terms], [trials[k] for k in first]) - base[first]
    on = score.frame(some, weight, responses, np.array([term.per_trial for term in terms], dtype=bool))
    screened = screen(predict, on, [trials[k] for k in first], pool, base[first], marks)
    visible = {s.candidate.effect for s in screened if s.visible > INVISIBLE}
    names = dict.fromkeys(c.effect for c in pool)
    marked = {"force_noise", "force_dropout", "force_quantization", "encoder_quantization"}
    unseen = tuple(name for name in names if name not in visible and name not in marked)
    promising = [s for s in screened if s.candidate.effect not in unseen]

    tick("fitting", SINGLES)
    few = Fitter(predict, tuple(trials[k] for k in first), some, weight, tuple(terms))
    starts = [Start((), np.zeros(0)), *(Start((s.candidate,), np.array([s.value])) for s in _best(promising, SINGLES))]
    ranked = _order(few.fit_all(starts, thorough=False), marks)
    # Once something explains the bulk, what is left shows how correlated the residuals really are.
    reference = few.predictions([Point(ranked[0].parts, ranked[0].values, ranked[0].nuisance)])[0]
    weight = np.maximum(score.independence(some, reference), weight)
    everywhere = Fitter(predict, tuple(trials), data, weight, tuple(terms))
    tick("refitting", SECONDS)
    again = [f for f in ranked if f.parts][:SECONDS]
    fits = everywhere.fit_all([Start((), np.zeros(0)), *(Start(f.parts, f.values) for f in again)])
    complete = not out_of_time()
    if complete and again:
        tick("pairs", PAIRS)
        few = Fitter(predict, few.trials, some, weight, tuple(terms))
        pairs = _order(_pairs(predict, few, again, promising, first, trials, responses, terms, base, marks), marks)
        both = everywhere.fit_all([Start(p.parts, p.values, _shared(p, few, everywhere)) for p in pairs[:PAIRS_AGAIN]])
        fits += both
        alone = []
        for fit in both:
            needed = [k for k in range(len(fit.parts)) if _away(fit, k)]
            if len(needed) == 1:  # the second effect only led the first to a better place
                alone.append(Start((fit.parts[needed[0]],), fit.values[needed], fit.nuisance))
        fits += everywhere.fit_all(alone)
    fits = _worth(_order(fits, marks), marks)
    evidence = np.array([f.evidence + traces.log_likelihood(marks, f.effects()) for f in fits])
    return Ranked(tuple(fits), evidence, tuple(screened), unseen, weight, not out_of_time() and complete)


def _pairs(
    predict: Predictor,
    fitter: Fitter,
    fits: Sequence[Fitted],
    promising: Sequence[Screened],
    first: Sequence[int],
    trials: Sequence[int],
    responses: Array,
    terms: Sequence[Term],
    base: Array,
    marks: Sequence[traces.Trace],
) -> list[Fitted]:
    """The best explanations with a second effect, found by adding its change to the prediction of the first."""
    seeds = [f for f in _order(fits, marks) if f.parts][:SEEDS]
    if not seeds:
        return []
    on = score.frame(fitter.data, fitter.weight, responses, np.array([t.per_trial for t in terms], dtype=bool))
    found: list[tuple[float, Fitted, Screened]] = []
    for seed in seeds:
        # Without its nuisances: they may have absorbed what the second effect is to explain.
        whole = fitter.predictions([Point(seed.parts, seed.values, np.zeros(fitter.size))])[0]
        others = [s for s in promising if s.candidate.label != seed.parts[0].label]
        stack = np.stack([whole + s.change for s in others])
        alone = float(score.log_likelihood(on, whole[None])[0]) + traces.log_likelihood(marks, seed.effects())
        gains = score.log_likelihood(on, stack)
        for s, gain in zip(others, gains, strict=True):
            extra = traces.log_likelihood(marks, (*seed.effects(), s.candidate.entry(s.value)))
            found.append((float(gain) + extra - alone + seed.evidence, seed, s))
    found.sort(key=lambda item: -item[0])
    starts: dict[object, Start] = {}
    for _, seed, s in found:
        start = Start((*seed.parts, s.candidate), np.array([seed.values[0], s.value]))
        starts.setdefault(frozenset((seed.parts[0].label, s.candidate.label)), start)
        if len(starts) == PAIRS:
            break
    return fitter.fit_all(list(starts.values()), thorough=False)


def _shared(pair: Fitted, few: Fitter, everywhere: Fitter) -> Array:
    """Nuisances of a fit to some trials, for all: the shared ones."""
    nuisance = np.zeros(everywhere.size)
    nuisance[: len(few.shared)] = pair.nuisance[: len(few.shared)]
    return nuisance


def _away(fit: Fitted, part: int) -> bool:
    """Whether a magnitude is farther from its identity than its uncertainty (90 %)."""
    identity = fit.parts[part].identity
    if not np.isfinite(identity):
        return bool(fit.values[part] < fit.parts[part].high - 1e-6 * abs(fit.parts[part].high))
    return bool(abs(fit.values[part] - identity) > 1.645 * fit.deviations[part])


def _order(fits: Sequence[Fitted], marks: Sequence[traces.Trace]) -> list[Fitted]:
    return sorted(fits, key=lambda f: -(f.evidence + traces.log_likelihood(marks, f.effects())))


def _worth(fits: Sequence[Fitted], marks: Sequence[traces.Trace]) -> list[Fitted]:
    """Without pairs that say no more than one of their parts alone."""
    alone = {
        f.parts[0].label: f.evidence + traces.log_likelihood(marks, f.effects()) for f in fits if len(f.parts) == 1
    }
    out = []
    for f in fits:
        evidence = f.evidence + traces.log_likelihood(marks, f.effects())
        better = [evidence - alone[part.label] for part in f.parts if part.label in alone]
        if len(f.parts) < 2 or (all(gain > SECOND_GAIN for gain in better) and all(_away(f, k) for k in range(2))):
            out.append(f)
    return out


def _best(promising: Sequence[Screened], count: int) -> list[Screened]:
    """The best of every effect and target; no more than half of them of one class, so that rivals get their chance."""
    out: list[Screened] = []
    seen: set[object] = set()
    classes: dict[str, int] = {}
    for s in promising:
        gap_class = EFFECTS[s.candidate.effect].gap_class
        if s.gain <= 0 and len(out) >= 2:
            break
        if s.candidate.label in seen or classes.get(gap_class, 0) >= count // 2:
            continue
        seen.add(s.candidate.label)
        classes[gap_class] = classes.get(gap_class, 0) + 1
        out.append(s)
        if len(out) == count:
            break
    return out


def _spread(base: Array, data: Data, count: int) -> list[int]:
    """Trials in which the nominal model fails most: what there is to explain shows there."""
    white = np.where(np.isfinite(data.value), np.nan_to_num((data.value - base) / data.sigma), 0.0)
    size = (score.soften(white) ** 2).sum(axis=(1, 2))
    return sorted(int(k) for k in np.argsort(-size)[:count])


def _part(data: Data, trials: Sequence[int]) -> Data:
    index = list(trials)
    return Data(data.channels, data.part, data.value[index], data.noise, data.sigma[index])
