"""Search explanations: screen all effects, fit the promising ones, add a second and a third, rank by evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap import floor, score
from tiago_mj.gap.effects import EFFECTS
from tiago_mj.gap.fit import NUDGE, Fitted, Fitter, Point, Start
from tiago_mj.gap.floor import Data
from tiago_mj.gap.hypotheses import Candidate, Term
from tiago_mj.gap.predict import Predictor
from tiago_mj.gap.screen import Screened, screen
from tiago_mj.gap.traces import MEASURES, Known

Array = NDArray[np.float64]

#: Physics steps of all trials that are fitted, and of those of the first pass; no fewer than so many trials: ten
#: grasps of a second and a quarter are all fitted, of ten-second ones those in which the nominal model fails most.
FIT_STEPS: Final = 16_000
FIRST_STEPS: Final = 6_000
FIT_TRIALS: Final = 3
FIRST_TRIALS: Final = 2
#: Trials of the first pass at most, singles that are fitted to them (where the time is over), and to all trials.
SCREEN_TRIALS: Final = 3
SINGLES: Final = 10
FEWEST: Final = 3
SECONDS: Final = 4
#: Where the first pass gains this much [nats], effects that gain less than this share of the most are not fitted. Of 46
#: cases the right one was the best in 30, never behind 0.9 of it but where little was gained, and once 0.6.
DECIDED: Final = 100.0
BEHIND: Final = 0.4
#: Singles beyond those are fitted to all trials, too, where some trials hardly tell them from the best [nats].
TIED: Final = 10.0
#: Explanations that are extended by another effect, their extensions that are fitted to some trials, and those that are
#: fitted to all.
SEEDS: Final = 3
EXTENSIONS: Final = 4
EXTENSIONS_AGAIN: Final = 3
#: Pairs that are found by superposition and fitted to some trials, and magnitudes of each effect that are tried.
SUPERPOSED: Final = 6
MAGNITUDES: Final = 7
#: An extension is fitted if the sum of the effects' changes says that it adds this much evidence [nats]: less, divided
#: by the verdict's temperature, would not pay for another effect.
PROMISES: Final = 50.0
#: Explanations this near to the best are fitted with the nuisances' responses around them [nats].
NEAR: Final = 150.0
#: Further fits of the nominal model, each with the nuisances' responses around the one before.
NOMINAL_ROUNDS: Final = 3
#: Effects of one explanation, apart from what the readings betray: a third is only sought where two leave a gap.
MOST: Final = 3
#: Mean squared residual of the worst channel, in units of floor and tolerance, that calls for another effect.
GAP: Final = 2.0
#: And that is worth a look at every other effect beside the best, each simulated.
BESIDE: Final = 1.5
#: What is left by an explanation that leaves nothing to explain, by samples and over blocks (1 is expected; the right
#: ones leave 0.7 to 3, where nominal numbers are 3 to 5 % off).
DONE: Final = 1.2
#: Evidence that another effect must add to be worth showing [nats]: a Bayes factor of 150, "very strong" (Kass &
#: Raftery 1995).
ADDS: Final = 5.0
#: A number of the nominal model that moves the likelihood by less than this, one deviation off, is left alone [nats].
SILENT: Final = 0.05
#: What acts on one joint or cell alone is not tried where nothing but noise is left there: mean square of its channels,
#: sample by sample and over blocks.
QUIET: Final = (1.3, 2.0)
#: A change below this share of floor and tolerance (rms, largest magnitude tried) cannot be seen in the recording.
INVISIBLE: Final = 0.05

Tick = Callable[[str, int], None]


@dataclass(frozen=True)
class Ranked:
    """Explanations with the evidence for them, best first.

    Attributes:
        fits: explanations; ``known`` effects are the last parts of each, and nuisances of all trials the first of its
            nuisances, those too that tell nothing.
        screened: the first pass.
        not_excited: effects that no magnitude makes visible in these recordings.
        known: number of effects that the readings betray: they are part of every explanation.
        pool: number of different effects that were considered.
        complete: False when time ran out.
        weight: square root of the share of independent samples of each channel, (C,).
    """

    fits: tuple[Fitted, ...]
    screened: tuple[Screened, ...]
    not_excited: tuple[str, ...]
    known: int
    pool: int
    complete: bool
    weight: Array


def select(
    predict: Predictor,
    data: Data,
    trials: Sequence[int],
    pool: Sequence[Candidate],
    terms: Sequence[Term],
    base: Array,
    known: Sequence[Known] = (),
    *,
    steps: int = 0,
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
        known: what the readings betray by themselves: it is part of every explanation.
        steps: physics steps of one trial.
        out_of_time: asked between stages.
        tick: told what begins.
    """
    pool = _with_something_to_explain([c for c in pool if c.effect not in MEASURES], data, base)
    tick("screening", len(pool))
    weight = score.independence(data, base)
    chosen = _spread(base, data, max(FIT_STEPS // max(steps, 1), FIT_TRIALS))
    data, base, trials = floor.part(data, chosen), base[chosen], [trials[k] for k in chosen]
    first = _spread(base, data, min(max(FIRST_STEPS // max(steps, 1), FIRST_TRIALS), SCREEN_TRIALS))
    few_trials, some = tuple(trials[k] for k in first), floor.part(data, first)
    terms = tuple(sorted(terms, key=lambda term: term.per_trial))
    responses = (predict.all_trials([(term.entry(NUDGE),) for term in terms], trials) - base) / NUDGE
    per_trial = np.array([term.per_trial for term in terms], dtype=bool)
    telling = (score.whiten(data, responses, weight) ** 2).sum(axis=(1, 2, 3)) > 2 * SILENT
    shared = telling[~per_trial]
    terms = tuple(term for term, tells in zip(terms, telling, strict=True) if tells)
    responses, per_trial = responses[telling], per_trial[telling]
    frame = score.frame(some, weight, responses[:, first], per_trial)
    screened = screen(predict, frame, few_trials, pool, base[first], out_of_time=out_of_time)
    visible = {s.candidate.effect for s in screened if s.visible > INVISIBLE}
    names = dict.fromkeys(c.effect for c in pool)
    unseen = tuple(name for name in names if name not in visible)
    promising = [s for s in screened if s.candidate.effect not in unseen]

    tick("fitting", SINGLES)
    given = tuple(k.candidate.entry(k.value) for k in known)
    few = Fitter(predict, few_trials, some, weight, terms, responses[:, first], given, out_of_time=out_of_time)
    count = FEWEST if out_of_time() else SINGLES
    starts = [Start((), np.zeros(0)), *(Start((s.candidate,), np.array([s.value])) for s in _best(promising, count))]
    ranked = _order(few.fit_all(starts))
    if out_of_time():
        fits = [_with(f, known, shared) for f in ranked]
        return Ranked(tuple(fits), tuple(screened), unseen, len(known), len(names), False, weight)
    # Once something explains the bulk, what is left shows how correlated the residuals really are.
    reference = few.predictions([Point(ranked[0].parts, ranked[0].values, ranked[0].nuisance)])[0]
    weight = np.maximum(score.independence(some, reference), weight)
    few = Fitter(predict, few_trials, some, weight, terms, responses[:, first], given, out_of_time=out_of_time)
    frame = score.frame(some, weight, responses[:, first], per_trial)
    everywhere = Fitter(predict, tuple(trials), data, weight, terms, responses, given, out_of_time=out_of_time)
    tick("refitting", SECONDS)
    seeds = _rivals([f for f in ranked if f.parts])
    fits = everywhere.fit_all([Start((), np.zeros(0)), *(_carried(f, few, everywhere) for f in seeds)], renew=True)
    if not out_of_time():
        fits = _renewed(everywhere, fits, fits)
        fits += everywhere.fit_all(_absorbed(fits, everywhere))
    complete = not out_of_time()
    for size in range(2, MOST + 1):
        best = _order(fits)[0]
        if not complete or best.evidence - fits[0].evidence < PROMISES:
            break  # where one effect hardly explains more than none, two would not be believed
        if best.parts and best.misfit < DONE and best.lasting < DONE:
            break
        if size > 2 and (best.misfit < GAP or len(best.parts) < size - 1):
            break
        tick("pairs" if size == 2 else "triples", EXTENSIONS)
        seeds = _distinct([f for f in _order(fits) if len(f.parts) == size - 1])[:SEEDS]
        starts = _extensions(few, frame, seeds, promising)
        if size == 2:
            starts = _once_each([*_superposed(frame, base[first], promising), *starts])
        extended = [_carried(f, few, everywhere) for f in _order(few.fit_all(starts))[:EXTENSIONS_AGAIN]]
        if seeds and seeds[0].misfit > BESIDE:
            beside = _beside(everywhere, seeds[0], [s.candidate for s in promising], per_trial)
            extended = _once_each([*beside, *extended])
        if not extended:
            break
        found = everywhere.fit_all(extended)
        found += everywhere.fit_all(_fewer(found))
        fits += found if out_of_time() else _renewed(everywhere, found, fits)
        fits += everywhere.fit_all([] if out_of_time() else _absorbed(fits, everywhere))
        complete = not out_of_time()
    fits = [_with(fit, known, shared) for fit in _worth(_once(_order(fits)))]
    return Ranked(tuple(fits), tuple(screened), unseen, len(known), len(names), complete, weight)


def _with_something_to_explain(pool: Sequence[Candidate], data: Data, base: Array) -> list[Candidate]:
    """Without candidates of one joint or cell where the nominal model predicts all of its channels."""
    known = np.isfinite(data.value).sum(axis=(0, 1))
    square = (score.scaled(data, data.value - base) ** 2).sum(axis=(0, 1)) / np.maximum(known, 1)
    quiet = (square < QUIET[0]) & (score.lasting(data, data.value - base) < QUIET[1])
    of: dict[str, list[bool]] = {}
    for channel, still in zip(data.channels, quiet, strict=True):
        of.setdefault(channel.partition(".")[2], []).append(bool(still))
    return [c for c in pool if c.target is None or not all(all(of.get(name, [False])) for name in c.target)]


def _extensions(fitter: Fitter, on: score.Frame, seeds: Sequence[Fitted], promising: Sequence[Screened]) -> list[Start]:
    """The best explanations with another effect, found by adding its change to the prediction of the first."""
    starts: dict[object, Start] = {}
    for seed in seeds:
        # Without its nuisances: they may have absorbed what the other effect is to explain.
        whole = fitter.predictions([Point(seed.parts, seed.values, np.zeros(fitter.size))])[0]
        there = {part.label for part in seed.parts}
        alone = float(score.log_likelihood(on, whole[None])[0])
        found: list[tuple[float, Screened, float]] = []
        for s in promising:
            if s.candidate.label not in there:
                gains = score.log_likelihood(on, whole + s.changes) - alone
                best = int(np.argmax(gains))
                found.append((float(gains[best]), s, s.values[best]))
        kinds: set[object] = set()
        for gain, s, value in sorted(found, key=lambda item: -item[0]):
            if gain < PROMISES or len(kinds) == EXTENSIONS:
                break
            if _kind(s.candidate) not in kinds:
                kinds.add(_kind(s.candidate))
                start = Start((*seed.parts, s.candidate), np.array([*seed.values, value]))
                starts.setdefault(frozenset(part.label for part in start.parts), start)
    return list(starts.values())


def _beside(fitter: Fitter, seed: Fitted, pool: Sequence[Candidate], per_trial: NDArray[np.bool_]) -> list[Start]:
    """An explanation with another effect, found by trying all of them beside it where it fails most.

    Without its nuisances: they may have absorbed what the other effect is to explain.
    """
    nuisance = np.zeros(fitter.size)
    base = fitter.predictions([Point(seed.parts, seed.values, nuisance)])[0]
    (worst,) = _spread(base, fitter.data, 1)
    there = floor.part(fitter.data, [worst])
    frame = score.frame(there, fitter.weight, fitter.responses[:, [worst]], per_trial)
    given = fitter.effects(seed.parts, seed.values, nuisance, worst)
    labels = {part.label for part in seed.parts}
    found: dict[object, Start] = {}
    for s in screen(
        fitter.predict, frame, [fitter.trials[worst]], [c for c in pool if c.label not in labels], base[[worst]], given
    ):
        if s.gain < PROMISES or len(found) == EXTENSIONS:
            break
        start = Start((*seed.parts, s.candidate), np.array([*seed.values, s.value]))
        found.setdefault(_kind(s.candidate), start)
    return list(found.values())


def _kind(candidate: Candidate) -> object:
    """Candidates of one kind lead to the same place: of one class, all on one target, or all on every one."""
    return EFFECTS[candidate.effect].gap_class, candidate.target is None


def _superposed(on: score.Frame, base: Array, promising: Sequence[Screened]) -> list[Start]:
    """The best pairs by the sum of both changes, at all magnitudes: the best pair need not hold the best single.

    Args:
        on: frame of some trials.
        base: nominal predictions of these, (ntrials, T, C).
        promising: after the first pass.
    """
    leaders: dict[str, Screened] = {}
    for s in promising:
        if s.candidate.target is None:
            leaders.setdefault(s.candidate.effect, s)
    thin = {
        name: np.unique(np.linspace(0, len(s.values) - 1, MAGNITUDES).round().astype(int))
        for name, s in leaders.items()
    }
    alone = max((s.gain for s in promising), default=0.0) + float(score.log_likelihood(on, base))
    found: list[tuple[float, Start]] = []
    names = list(leaders)
    for k, a in enumerate(names):
        one = leaders[a].changes[thin[a]]
        for b in names[k + 1 :]:
            both = base + one[:, None] + leaders[b].changes[thin[b]][None]
            likelihood = score.log_likelihood(on, both)
            i, j = np.unravel_index(int(np.argmax(likelihood)), likelihood.shape)
            values = np.array([leaders[a].values[thin[a][i]], leaders[b].values[thin[b][j]]])
            if likelihood[i, j] < alone + PROMISES:
                continue
            found.append((float(likelihood[i, j]), Start((leaders[a].candidate, leaders[b].candidate), values)))
    out: dict[frozenset[str], Start] = {}
    for _, start in sorted(found, key=lambda item: -item[0]):
        out.setdefault(frozenset(EFFECTS[part.effect].gap_class for part in start.parts), start)
    return list(out.values())[:SUPERPOSED]


def _once_each(starts: Sequence[Start]) -> list[Start]:
    """Each set of effects and targets once, the first of them."""
    out: dict[object, Start] = {}
    for start in starts:
        out.setdefault(frozenset(part.label for part in start.parts), start)
    return list(out.values())


def _distinct(fits: Sequence[Fitted]) -> list[Fitted]:
    """The best of every set of classes: what resembles it would lead to the same place."""
    best: dict[frozenset[str], Fitted] = {}
    for fit in fits:
        best.setdefault(frozenset(EFFECTS[part.effect].gap_class for part in fit.parts), fit)
    return list(best.values())


def _fewer(fits: Sequence[Fitted]) -> list[Start]:
    """Starts without effects that only led the others to a better place."""
    out = []
    for fit in fits:
        needed = [k for k in range(len(fit.parts)) if _away(fit, k)]
        if 0 < len(needed) < len(fit.parts):
            out.append(Start(tuple(fit.parts[k] for k in needed), fit.values[needed], fit.nuisance))
    return out


def _absorbed(fits: Sequence[Fitted], fitter: Fitter) -> list[Start]:
    """Starts without effects that are no more than a nominal number a little off, which takes that value instead.

    Fits end in the nearest valley: where an effect found a better one than its explanation without it, that goes on
    from there. Only of the best, and where nothing but the number itself is beyond what it is known to.
    """
    best = max(fit.evidence for fit in fits)
    known = {frozenset(p.label for p in fit.parts): fit.evidence for fit in fits}
    out: dict[object, Start] = {}
    for fit in _order(fits):
        if fit.evidence < best - NEAR:
            break
        nuisance, left = fit.nuisance.copy(), []
        for k, part in enumerate(fit.parts):
            mine = [
                (i, fitter.terms[term])
                for i, term in enumerate(fitter.shared)
                if fitter.terms[term].effect == part.effect
                and fitter.terms[term].parameter == part.parameter
                and (part.target is None or fitter.terms[term].target == part.target)
            ]
            moved = [nuisance[i] + (fit.values[k] - term.nominal) / term.deviation for i, term in mine]
            if mine and max(abs(m) for m in moved) < score.NUISANCE_BOUND:
                for (i, _), m in zip(mine, moved, strict=True):
                    nuisance[i] = m
            else:
                left.append(k)
        labels = frozenset(fit.parts[k].label for k in left)
        if len(left) < len(fit.parts) and known.get(labels, -np.inf) < fit.evidence:
            out.setdefault(labels, Start(tuple(fit.parts[k] for k in left), fit.values[left], nuisance))
    return list(out.values())


def _renewed(everywhere: Fitter, fits: Sequence[Fitted], others: Sequence[Fitted]) -> list[Fitted]:
    """The same, with the nuisances' responses computed anew where that may decide: near the best of all."""
    best = max(f.evidence for f in (*fits, *others)) if fits else 0.0
    near = [k for k, f in enumerate(fits) if f.evidence > best - NEAR or not f.parts]  # the nominal model always
    again = everywhere.fit_all([Start(fits[k].parts, fits[k].values, fits[k].nuisance) for k in near], renew=True)
    out = list(fits)
    for k, fit in zip(near, again, strict=True):
        out[k] = max(fit, fits[k], key=lambda f: f.evidence)
    # The nominal model must not look worse than it is: its fit goes on as long as it gets better.
    for _ in range(NOMINAL_ROUNDS):
        moved = [k for k in near if not fits[k].parts and out[k].evidence > fits[k].evidence + PROMISES]
        if not moved:
            break
        fits = list(out)
        more = everywhere.fit_all([Start((), np.zeros(0), out[k].nuisance) for k in moved], renew=True)
        for k, fit in zip(moved, more, strict=True):
            out[k] = max(fit, out[k], key=lambda f: f.evidence)
    return out


def _carried(fit: Fitted, few: Fitter, everywhere: Fitter) -> Start:
    """Start for all trials of what was fitted to some: with its nuisances, as far as trials share them."""
    nuisance = np.zeros(everywhere.size)
    nuisance[: len(few.shared)] = fit.nuisance[: len(few.shared)]
    return Start(fit.parts, fit.values, nuisance)


def _away(fit: Fitted, part: int) -> bool:
    """Whether a magnitude is farther from its identity than its uncertainty (90 %)."""
    identity = fit.parts[part].identity
    if not np.isfinite(identity):
        return bool(fit.values[part] < fit.parts[part].high - 1e-6 * abs(fit.parts[part].high))
    return bool(abs(fit.values[part] - identity) > 1.645 * fit.deviations[part])


def _order(fits: Sequence[Fitted]) -> list[Fitted]:
    return sorted(fits, key=lambda f: -f.evidence)


def _worth(fits: Sequence[Fitted]) -> list[Fitted]:
    """Without those that say no more than some of their parts alone."""
    evidence = {frozenset(p.label for p in f.parts): f.evidence for f in fits}
    out = []
    for f in fits:
        labels = frozenset(p.label for p in f.parts)
        fewer = [e for other, e in evidence.items() if other and other < labels]
        if len(f.parts) < 2 or (
            all(f.evidence - e > ADDS for e in fewer) and all(_away(f, k) for k in range(len(f.parts)))
        ):
            out.append(f)
    return out


def _with(fit: Fitted, known: Sequence[Known], telling: NDArray[np.bool_]) -> Fitted:
    """What the readings betray, as parts of an explanation, and the numbers that were left alone, as nuisances."""
    shared, count = np.zeros(len(telling)), int(telling.sum())
    shared[telling] = fit.nuisance[:count]
    return replace(
        fit,
        nuisance=np.concatenate([shared, fit.nuisance[count:]]),
        parts=(*fit.parts, *(k.candidate for k in known)),
        values=np.concatenate([fit.values, [k.value for k in known]]),
        deviations=np.concatenate([fit.deviations, [k.deviation for k in known]]),
    )


def _rivals(fits: Sequence[Fitted]) -> list[Fitted]:
    """Of single effects, best first: the first few, and whatever cannot be told from the best."""
    return [f for k, f in enumerate(fits) if k < SECONDS or f.evidence > fits[0].evidence - TIED]


def _once(fits: Sequence[Fitted]) -> list[Fitted]:
    """The best of fits of the same effects on the same targets: found twice, an explanation is no likelier."""
    best: dict[frozenset[object], Fitted] = {}
    for fit in fits:
        best.setdefault(frozenset(part.label for part in fit.parts), fit)
    return list(best.values())


def _best(promising: Sequence[Screened], count: int) -> list[Screened]:
    """The best of every effect, then of every effect and target; no more than half of them of one class, so that rivals
    get their chance."""
    out: list[Screened] = []
    seen: set[object] = set()
    classes: dict[str, int] = {}
    first = dict.fromkeys(s.candidate.effect for s in promising)
    leaders = {effect: next(s for s in promising if s.candidate.effect == effect) for effect in first}
    most = max((s.gain for s in promising), default=0.0)
    for s in (*leaders.values(), *promising):
        gap_class = EFFECTS[s.candidate.effect].gap_class
        hopeless = s.gain <= 0 or (most > DECIDED and s.gain < BEHIND * most)
        if hopeless and len(out) >= 2:
            continue
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
    white = score.scaled(data, data.value - base)
    size = (score.soften(white) ** 2).sum(axis=(1, 2))
    return sorted(int(k) for k in np.argsort(-size)[:count])
