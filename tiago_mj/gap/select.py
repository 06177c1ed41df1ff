"""Search explanations: screen all effects, fit the promising ones, add a second and a third, rank by evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap import extend, floor, lost, score, secondary, shortlist, starts
from tiago_mj.gap.fit import NUDGE, Fitted, Fitter, Point, Start
from tiago_mj.gap.floor import Data
from tiago_mj.gap.hypotheses import Candidate, Term
from tiago_mj.gap.predict import Predictor
from tiago_mj.gap.screen import Screened, screen
from tiago_mj.gap.set_points import Told
from tiago_mj.gap.traces import ONLY_READ_OFF, Known
from tiago_mj.gap.yardstick import Yardstick

Array = NDArray[np.float64]

#: Two simulators never agree as closely as their noise, and what one gets wrong it gets wrong in every trial: so many
#: samples, apart from their correlation in time, tell as much as one.
REPEATED: Final = 2.0
#: Physics steps of all trials that are fitted, and of those of the first pass; no fewer than so many trials: ten
#: grasps of a second and a quarter are all fitted, of ten-second ones those in which the nominal model fails most.
FIT_STEPS: Final = 12_000
FIRST_STEPS: Final = 6_000
FIT_TRIALS: Final = 3
FIRST_TRIALS: Final = 1
#: Trials of the first pass at most.
SCREEN_TRIALS: Final = 3
#: Of the singles that are fitted to all trials so many begin once more at the nominal numbers, too.
ANEW: Final = 2
#: Further fits of the nominal model, each with the nuisances' responses around the one before, as long as one brings
#: this much [nats].
NOMINAL_ROUNDS: Final = 5
BETTER: Final = 1.0
#: Moves of the nuisances that change nothing [deviations], and how many of them show what a simulator cannot tell.
TOUCH: Final = 1e-5
TOUCHES: Final = 6
#: Mean squared residual of the worst channel that no numbers a little off leave, but an effect: without it they are
#: then not sought.
FAR: Final = 20.0
#: Explanations that are extended by another effect, and their extensions that are fitted to all trials.
SEEDS: Final = 3
EXTENSIONS_AGAIN: Final = 3
#: Effects of one explanation, apart from what the readings betray: a third is only sought where two leave a gap.
MOST: Final = 3
#: Mean squared residual of the worst channel, sample by sample or over blocks, in units of what it should scatter by,
#: that calls for another effect.
GAP: Final = 4.0
#: Where even the best single effect leaves a gap, what is correlated in time is another effect and no error of the
#: simulator: samples count for so much at least (square root), half of what those of an explanation that stands do.
UNEXPLAINED: Final = 0.5 / REPEATED**0.5
#: Where an explanation leaves nothing to explain, another effect beside it must promise so much more [nats].
PLENTY: Final = 15.0
#: Explanations that get responses around themselves, the best first.
RENEWED: Final = 3
#: What is left by an explanation that leaves nothing to explain, by samples and over blocks (1 is expected; the right
#: ones leave 0.7 to 3, where nominal numbers are 3 to 5 % off).
DONE: Final = 1.2
#: What a single effect may leave for another one beside it to have to promise plenty: its form is not quite that of any
#: real one.
ENOUGH: Final = 1.5
#: Where the nominal model's numbers had to go farther than this for it [nats], they may stand for another effect: what
#: leaves nothing to explain has -3 to -14 without one.
STRAINED: Final = -18.0
#: A number of the nominal model that moves the likelihood by less than this, one deviation off, is left alone [nats].
SILENT: Final = 0.005
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
        weight: square root of what a sample of each channel counts for, (C,).
        predict: simulations, in which those commands are lost that were.
        astray: trials that were set aside, by index: a motion goes another way in them.
    """

    fits: tuple[Fitted, ...]
    screened: tuple[Screened, ...]
    not_excited: tuple[str, ...]
    known: int
    pool: int
    complete: bool
    weight: Array
    predict: Predictor
    astray: tuple[int, ...] = ()


def select(
    predict: Predictor,
    data: Data,
    trials: Sequence[int],
    pool: Sequence[Candidate],
    terms: Sequence[Term],
    base: Array,
    known: Sequence[Known] = (),
    seen: Told | None = None,
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
        seen: what the servos' motion says; None: there is nothing to be read from it.
        steps: physics steps of one trial.
        out_of_time: asked between stages.
        tick: told what begins.
    """
    read_off = {*ONLY_READ_OFF, *(k.candidate.effect for k in known)}
    pool = _with_something_to_explain([c for c in pool if c.effect not in read_off], data, base)
    tick("fitting the nominal model", NOMINAL_ROUNDS)
    weight = _weight(data, base)
    chosen = extend.spread(base, data, max(FIT_STEPS // max(steps, 1), FIT_TRIALS))
    data, base, trials = floor.part(data, chosen), base[chosen], [trials[k] for k in chosen]
    terms = tuple(sorted(terms, key=lambda term: term.per_trial))
    responses = (predict.all_trials([(term.entry(NUDGE),) for term in terms], trials) - base) / NUDGE
    telling = (score.whiten(data, responses, weight) ** 2).sum(axis=(1, 2, 3)) > 2 * SILENT
    shared = telling[[not term.per_trial for term in terms]]
    terms = tuple(term for term, tells in zip(terms, telling, strict=True) if tells)
    given = tuple(k.candidate.entry(k.value) for k in known)
    everywhere = Fitter(predict, tuple(trials), data, weight, terms, responses[telling], given, out_of_time=out_of_time)
    everywhere, nominal = _calibrated(everywhere)
    at = nominal.nuisance if nominal.misfit < FAR else np.zeros(everywhere.size)
    everywhere, pool = _losing(everywhere, pool, nominal, seen)
    weight = everywhere.weight

    tick("screening", len(pool))
    base = everywhere.predictions([Point((), np.zeros(0), at)], keep=True)[0]
    first = extend.spread(base, data, min(max(FIRST_STEPS // max(steps, 1), FIRST_TRIALS), SCREEN_TRIALS))
    few, here = everywhere.part(first), Point((), np.zeros(0), everywhere.of(first, at))
    screened = screen(few, _frame(few, here), pool, here, base[first], out_of_time=out_of_time)
    visible = {s.candidate.effect for s in screened if s.visible > INVISIBLE}
    names = dict.fromkeys(c.effect for c in pool)
    unseen = tuple(name for name in names if name not in visible)
    promising = [s for s in screened if s.candidate.effect not in unseen]

    tick("fitting", shortlist.SINGLES)
    count = shortlist.FEWEST if out_of_time() else shortlist.SINGLES
    moved = starts.moved(everywhere, at, {s.candidate.label for s in promising})
    singles = [starts.beginning(s, few, here.nuisance) for s in shortlist.to_fit(promising, count, moved)]
    ranked = shortlist.ordered(few.fit_all([Start((), np.zeros(0), here.nuisance), *singles]))
    if out_of_time():
        fits = [_with(f, known, shared) for f in ranked]
        return Ranked(tuple(fits), tuple(screened), unseen, len(known), len(names), False, weight, few.predict)
    # Once something explains the bulk, what is left shows how correlated the residuals really are.
    reference = few.predictions([Point(ranked[0].parts, ranked[0].values, ranked[0].nuisance)])[0]
    weight = np.maximum(_weight(few.data, reference), weight)
    few, everywhere = replace(few, weight=weight), replace(everywhere, weight=weight)
    fits = everywhere.fit_all([starts.again(nominal)])
    frame = _frame(few, here)

    tick("refitting", shortlist.SECONDS)
    rivals = shortlist.rivals([f for f in ranked if f.parts])
    if _done(fits[0]):
        rivals = shortlist.promising(rivals, shortlist.nominal(ranked), len(trials) / len(first)) or rivals[:1]
    leaders = [starts.carried(f, everywhere, at) for f in rivals]
    if leaders and ranked[0].parts and ranked[0].evidence - shortlist.nominal(ranked).evidence > extend.PROMISES:
        everywhere = everywhere.around(starts.point(leaders[0]))
    if not _done(fits[0]):  # what is left may be what its numbers were moved for: effects begin without that, too
        leaders += [Start(f.parts, f.values, np.zeros(everywhere.size)) for f in rivals[:ANEW]]
    fits += everywhere.fit_all(leaders)
    if not out_of_time():
        fits = _renewed(everywhere, fits, fits)
        fits += _refined(everywhere, fits, fits)
        fits += everywhere.fit_all([*starts.absorbed(fits, everywhere), *starts.without(fits)])
    everywhere, fits, at = _without_astray(everywhere, fits, at)
    if _fails(shortlist.ordered(fits)[0]) and not out_of_time():
        weight = np.maximum(weight, UNEXPLAINED)
        few, everywhere = replace(few, weight=weight), replace(everywhere, weight=weight)
        frame = _frame(few, here)
        fits = everywhere.fit_all([starts.again(f) for f in _again(fits)])
    everywhere, told = _losing(everywhere, pool, shortlist.ordered(fits)[0], seen)
    if told is not pool:
        lose = {c.label: c for c in told if c.effect == lost.EFFECT}
        weight = everywhere.weight
        few = replace(few, predict=everywhere.predict, weight=weight)
        frame = _frame(few, here)
        promising = [s for s in promising if s.candidate.label not in lose]
        promising += screen(few, frame, [*lose.values()], here, base[first])
        promising.sort(key=lambda s: -s.gain)
        fits = everywhere.fit_all([starts.with_others(f, lose) for f in _again(fits)])
    complete = not out_of_time()
    for size in range(2, MOST + 1):
        best = shortlist.ordered(fits)[0]
        gained = best.evidence - shortlist.nominal(fits).evidence
        if not complete or (gained < extend.PROMISES and not _fails(best)):
            break  # where one effect hardly explains more than none, two would not be believed
        done = best.parts and _done(best, ENOUGH)
        if done and size > 2:
            break
        if size > 2 and (not _fails(best) or len(best.parts) < size - 1):
            break
        tick("pairs" if size == 2 else "triples", extend.EXTENSIONS)
        seeds = shortlist.distinct([f for f in shortlist.ordered(fits) if len(f.parts) == size - 1])[:SEEDS]
        tried = extend.extensions(few, frame, seeds, promising, PLENTY if done else extend.PROMISES)
        if size == 2 and not done:
            tried = extend.once_each([*extend.superposed(frame, base[first], promising), *tried])
        on_few = few.fit_all(tried)
        others = [s.candidate for s in promising]
        if seeds:
            on_few += extend.reading_otherwise(few, everywhere, seeds[0], others)
        on_few = shortlist.once_each(shortlist.ordered(on_few))
        extended = [starts.carried(f, everywhere, at) for f in on_few[:EXTENSIONS_AGAIN]]
        if seeds:
            beside = [] if done else extend.beside(everywhere, seeds[0], len(first), others, at)
            extended = extend.once_each([*beside, *extended, *starts.given_back(seeds[0], everywhere, others)])
        if not extended:
            break
        found = everywhere.fit_all(extended)
        found += everywhere.fit_all(starts.fewer(found))
        leader = shortlist.ordered(found)[0]
        found += everywhere.fit_all([*starts.subsets(leader, [*fits, *found]), *starts.merged(leader, everywhere)])
        fits += found if out_of_time() else _renewed(everywhere, found, fits)
        if not out_of_time():
            fits += _refined(everywhere, [f for f in fits if len(f.parts) == size], fits)
        fits += everywhere.fit_all([] if out_of_time() else starts.absorbed(fits, everywhere))
        if len(everywhere.trials) == len(trials):
            everywhere, fits, at = _without_astray(everywhere, fits, at)
        complete = not out_of_time()
    fits = [_with(fit, known, shared) for fit in shortlist.worth_showing(shortlist.once_each(shortlist.ordered(fits)))]
    astray = tuple(k for k in trials if k not in everywhere.trials)
    counts = len(known), len(names)
    return Ranked(tuple(fits), tuple(screened), unseen, *counts, complete, weight, everywhere.predict, astray)


def _calibrated(fitter: Fitter) -> tuple[Fitter, Fitted]:
    """The nominal model at its best, and the fitter with the nuisances' responses around it.

    The nominal model must not look worse than it is: its fit goes on as long as it gets better. Where it stays far off,
    something else is wrong with it, and its numbers are left where they were.
    """
    (best,) = fitter.fit_all([Start((), np.zeros(0))])
    left = fitter.predictions([starts.point(best)])[0]
    for _ in range(NOMINAL_ROUNDS):
        if best.misfit > FAR or fitter.out_of_time():
            break
        fitter = replace(fitter, weight=np.maximum(_weight(fitter.data, left), fitter.weight))
        fitter = fitter.around(starts.point(best))
        (again,) = fitter.fit_all([starts.again(best)])
        leaves, on = fitter.predictions([starts.point(again)])[0], Yardstick(fitter.data, fitter.weight)
        gained = on.cost(left, best.nuisance) - on.cost(leaves, again.nuisance)
        best, left = again, leaves
        if gained < BETTER:
            break
    return (_with_scatter(fitter, best) if best.misfit < FAR else fitter), best


def _losing(
    everywhere: Fitter, pool: Sequence[Candidate], best: Fitted, seen: Told | None
) -> tuple[Fitter, Sequence[Candidate]]:
    """The same with the commands that were lost beside an explanation, unless it leaves nothing to explain or is
    likelier without. Where samples tell more once they are lost, they count for that.
    """
    candidates = [c for c in pool if c.effect == lost.EFFECT]
    told_before = any(part.effect == lost.EFFECT for part in best.parts)
    if seen is None or not candidates or told_before or _done(best) or everywhere.out_of_time():
        return everywhere, pool
    told = lost.beside(everywhere, starts.point(best), seen, candidates)
    if told is None:
        return everywhere, pool
    losing = replace(everywhere, predict=told.predict)
    left = losing.predictions([starts.point(told.fit)])[0]
    for fitter in (replace(losing, weight=np.maximum(losing.weight, _weight(losing.data, left))), losing):
        priced = lost.priced(fitter, told, seen, candidates)
        if priced is not None:
            without, there = fitter.fit_all([starts.again(best), starts.with_others(told.fit, priced)])
            if there.evidence > without.evidence:
                return fitter, [priced.get(c.label, c) for c in pool]
    return everywhere, pool


def _with_scatter(fitter: Fitter, fit: Fitted) -> Fitter:
    """With a tolerance of how far predictions part that nothing tells apart."""
    rng = np.random.default_rng(fitter.predict.seed)
    moved = fit.nuisance + TOUCH * rng.standard_normal((TOUCHES, fitter.size))
    apart = fitter.predictions([starts.point(fit), *(Point(fit.parts, fit.values, one) for one in moved)])
    return replace(fitter, data=floor.with_scatter(fitter.data, apart))


def _weight(data: Data, predicted: Array) -> Array:
    """Square root of what a sample of each channel counts for, (C,)."""
    return score.independence(data, predicted) / np.sqrt(REPEATED)


def _frame(fitter: Fitter, at: Point) -> score.Frame:
    return score.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial, at.nuisance)


def _with_something_to_explain(pool: Sequence[Candidate], data: Data, base: Array) -> list[Candidate]:
    """Without candidates of one joint or cell where the nominal model predicts all of its channels."""
    known = np.isfinite(data.value).sum(axis=(0, 1))
    square = (score.scaled(data, data.value - base) ** 2).sum(axis=(0, 1)) / np.maximum(known, 1)
    quiet = (square < QUIET[0]) & (score.lasting(data, data.value - base) < QUIET[1])
    of: dict[str, list[bool]] = {}
    for channel, still in zip(data.channels, quiet, strict=True):
        of.setdefault(channel.partition(".")[2], []).append(bool(still))
    return [c for c in pool if c.target is None or not all(all(of.get(name, [False])) for name in c.target)]


def _done(fit: Fitted, most: float = DONE) -> bool:
    """Whether it leaves nothing to explain, and its numbers did not have to go far for that."""
    return fit.misfit < most and fit.lasting < most and fit.prior > STRAINED


def _fails(fit: Fitted) -> bool:
    """Whether it leaves a gap that calls for another effect."""
    return max(fit.misfit, fit.lasting) > GAP


def _without_astray(everywhere: Fitter, fits: list[Fitted], at: Array) -> tuple[Fitter, list[Fitted], Array]:
    """The same without trials in which a motion goes another way than the best explanation has it: no number of the
    model makes it do that, and fits of all others would go astray to lessen what it costs."""
    best = everywhere.predictions([starts.point(shortlist.ordered(fits)[0])])[0]
    astray = score.astray(everywhere.data, everywhere.data.value - best)
    if not astray.any() or everywhere.out_of_time():
        return everywhere, fits, at
    kept = [k for k, one in enumerate(astray) if not one]
    rest = everywhere.part(kept)
    begin = [Start(f.parts, f.values, everywhere.of(kept, f.nuisance)) for f in _again(fits)]
    return rest, rest.fit_all(begin), everywhere.of(kept, at)


def _again(fits: Sequence[Fitted]) -> list[Fitted]:
    """The nominal model and the best explanations, each once."""
    best = shortlist.once_each(shortlist.ordered([f for f in fits if f.parts]))
    return [shortlist.nominal(fits), *best[: shortlist.SECONDS]]


def _renewed(everywhere: Fitter, fits: Sequence[Fitted], others: Sequence[Fitted]) -> list[Fitted]:
    """The same, each with the nuisances' responses around it where that may decide: near the best of all, and where
    that is more than a nominal number a little off."""
    best = max((f.evidence for f in (*fits, *others)), default=0.0)
    nominal = shortlist.nominal(others)
    if best - nominal.evidence < extend.PROMISES and _done(nominal):
        return list(fits)
    near = shortlist.once_each(shortlist.ordered([f for f in fits if f.parts and f.evidence > best - starts.NEAR]))
    near = near[:RENEWED]
    begin = [starts.again(f) for f in near]
    # What the nominal model's numbers were moved for without the effect, they may be stuck at.
    begin += [Start(f.parts, f.values, np.zeros(everywhere.size)) for f in near[:1]]
    return [*fits, *(everywhere.around(starts.point(start)).fit_all([start])[0] for start in begin)]


def _refined(everywhere: Fitter, fits: Sequence[Fitted], others: Sequence[Fitted]) -> list[Fitted]:
    """Of some explanations with better second numbers and forms."""
    best = shortlist.ordered(others)[0]
    return secondary.refined(everywhere, fits, best, fails=_fails(best))


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
