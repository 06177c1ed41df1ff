"""Search explanations: screen all effects, fit the promising ones, add a second and a third, rank by evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.data.recording import RecordingError
from tiago_mj.gap.detectors.readings import ONLY_READ_OFF, Known
from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference import likelihood, noise_model
from tiago_mj.gap.inference.fit import NUISANCE_STEP, Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Term
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.inference.whitening import Whitening
from tiago_mj.gap.search import combinations, extend, lost_commands, refinement, shortlist, starts, step_error
from tiago_mj.gap.search.combinations import Search
from tiago_mj.gap.search.screen import Screened, screen

Array = NDArray[np.float64]

#: Physics steps of all trials that are fitted, and of those of the first pass; no fewer than so many trials: ten
#: grasps of a second and a quarter are all fitted, of ten-second ones those in which the nominal model fails most.
FIT_STEPS: Final = 8_000
FIRST_STEPS: Final = 4_000
FIT_TRIALS: Final = 3
FIRST_TRIALS: Final = 1
#: Trials of the first pass at most.
SCREEN_TRIALS: Final = 3
#: Single effects that are fitted to all trials from nuisances of 0, too. Chosen by hand; no ablation.
MAX_ZERO_NUISANCE_STARTS: Final = 2
#: Further fits of the nominal model, each with the nuisances' responses around the one before, as long as one brings
#: this much [nats].
MAX_NOMINAL_ROUNDS: Final = 5
MIN_ROUND_GAIN_NATS: Final = 1.0
#: Size of random nuisance moves that change nothing physical [deviations], and number of draws: their predictions show
#: the simulator's own sensitivity. Chosen by hand; no ablation.
SENSITIVITY_DEVIATION: Final = 1e-5
SENSITIVITY_DRAWS: Final = 6
#: Misfit above which the nominal model lacks an effect whatever its nuisances: they are then left at 0. Chosen by hand;
#: no ablation.
HOPELESS_NOMINAL_MISFIT: Final = 20.0
#: Effects of one explanation at most, apart from those measured on the readings. Chosen by hand; no ablation.
MAX_EFFECTS: Final = 3
#: A nuisance whose move by one deviation changes the log-likelihood by less than this is not fitted [nats]. Chosen by
#: hand; no ablation.
NEAR_ZERO_RESPONSE_NATS: Final = 0.005
#: Effects on one joint or cell are not tried where the mean squares of its channels, by samples and over blocks, are
#: below these. Chosen by hand; no ablation.
NOISE_ONLY_DISCREPANCY: Final = (1.3, 2.0)
#: Effects whose largest tried magnitude changes predictions by less than this (rms, in units of floor and tolerance)
#: are reported as not excited. Chosen by hand; no ablation.
MIN_VISIBILITY: Final = 0.05


class Tick(Protocol):
    """Told how far a diagnosis is."""

    def __call__(self, stage: str, total: int, done: int = 0) -> None:
        """A stage of so many steps (begins, or) has done some of them."""


@dataclass
class PartialResult:
    """What a search has found so far: its result where it ends early.

    Attributes:
        ranked: None before the first explanations were fitted.
    """

    ranked: Ranked | None = None


@dataclass(frozen=True)
class Ranked:
    """Explanations with the evidence for them, best first.

    Attributes:
        fits: explanations; ``known`` effects are the last parts of each, and nuisances of all trials the first of its
            nuisances, those too that tell nothing.
        screened: the first pass.
        not_excited: effects that no magnitude makes visible in these recordings.
        known: number of effects that are measured on the readings alone: they are part of every explanation.
        pool: number of different effects that were considered.
        complete: False when time ran out.
        weight: square root of what a sample of each channel counts for, (C,).
        predict: simulations, in which those commands are lost that were.
        excluded: indices of excluded trials: their motion departs from what the best explanation predicts.
        ended: what ended the search before its end, apart from the time: a fault, or the user.
    """

    fits: tuple[Fitted, ...]
    screened: tuple[Screened, ...]
    not_excited: tuple[str, ...]
    known: int
    pool: int
    complete: bool
    weight: Array
    predict: Predictor
    excluded: tuple[int, ...] = ()
    ended: BaseException | None = None


def select(
    predict: Predictor,
    data: Data,
    trials: Sequence[int],
    pool: Sequence[Candidate],
    terms: Sequence[Term],
    base: Array,
    known: Sequence[Known] = (),
    seen: ServoMotion | None = None,
    *,
    steps: int = 0,
    out_of_time: Callable[[], bool] = lambda: False,
    tick: Tick = lambda stage, total, done=0: None,
) -> Ranked:
    """Rank explanations of the trials; where something ends the search, those that were found until then.

    Args:
        predict: simulations.
        data: measured, of these trials.
        trials: their indices.
        pool: candidates.
        terms: nuisance parameters.
        base: nominal predictions, (ntrials, T, C).
        known: effects that are measured on the readings alone: they are part of every explanation.
        seen: what the servos' motion says; None: there is nothing to be read from it.
        steps: physics steps of one trial.
        out_of_time: asked between stages.
        tick: told what begins.
    """
    so_far = PartialResult()
    try:
        return _search(predict, data, trials, pool, terms, base, known, seen, so_far, steps, out_of_time, tick)
    except (Exception, KeyboardInterrupt) as fault:
        if so_far.ranked is None or isinstance(fault, RecordingError):
            raise
        return replace(so_far.ranked, complete=False, ended=fault)


def _search(
    predict: Predictor,
    data: Data,
    trials: Sequence[int],
    pool: Sequence[Candidate],
    terms: Sequence[Term],
    base: Array,
    known: Sequence[Known],
    motion: ServoMotion | None,
    so_far: PartialResult,
    steps: int,
    out_of_time: Callable[[], bool],
    tick: Tick,
) -> Ranked:
    """See :func:`select`; ``so_far`` is told what was found, from stage to stage."""
    read_off = {*ONLY_READ_OFF, *(k.candidate.effect for k in known)}
    pool = _acting_on_misfit([c for c in pool if c.effect not in read_off], data, base)
    names = dict.fromkeys(c.effect for c in pool)
    losing = [c for c in pool if c.effect == lost_commands.EFFECT] if motion is not None else []
    pool = [c for c in pool if c not in losing]  # which were lost is decoded, not drawn
    tick("fitting the nominal model", MAX_NOMINAL_ROUNDS)
    weight = refinement.sample_weight(data, base)
    chosen = extend.worst_predicted(base, data, max(FIT_STEPS // max(steps, 1), FIT_TRIALS))
    data, base, trials = noise_model.select_trials(data, chosen), base[chosen], [trials[k] for k in chosen]
    terms = tuple(sorted(terms, key=lambda term: term.per_trial))
    responses = (predict.all_trials([(term.entry(NUISANCE_STEP),) for term in terms], trials) - base) / NUISANCE_STEP
    sensitive = (likelihood.whiten(data, likelihood.mean_visible_change(data, responses), weight) ** 2).sum(
        axis=(1, 2, 3)
    ) > 2 * NEAR_ZERO_RESPONSE_NATS
    shared = sensitive[[not term.per_trial for term in terms]]
    terms = tuple(term for term, tells in zip(terms, sensitive, strict=True) if tells)
    given = tuple(k.candidate.entry(k.value) for k in known)
    everywhere = Fitter(
        predict, tuple(trials), data, weight, terms, responses[sensitive], given, out_of_time=out_of_time
    )
    everywhere, nominal = _fit_nominal(everywhere)
    at = nominal.nuisance if nominal.misfit < HOPELESS_NOMINAL_MISFIT else np.zeros(everywhere.size)

    tick("screening", len(pool))
    base = everywhere.predictions([Point((), np.zeros(0), at)], keep=True)[0]
    first = extend.worst_predicted(base, data, min(max(FIRST_STEPS // max(steps, 1), FIRST_TRIALS), SCREEN_TRIALS))
    few, here = everywhere.part(first), Point((), np.zeros(0), everywhere.of(first, at))
    screened = screen(
        few,
        refinement.frame(few, here),
        pool,
        here,
        base[first],
        out_of_time,
        lambda *how_far: tick("screening", *how_far),
    )
    visible = {s.candidate.effect for s in screened if s.visible > MIN_VISIBILITY}
    unseen = tuple(name for name in names if name not in visible | {c.effect for c in losing})
    promising = [s for s in screened if s.candidate.effect not in unseen]

    tick("fitting", shortlist.MAX_SINGLES)
    count = shortlist.MIN_SINGLES if out_of_time() else shortlist.MAX_SINGLES
    moved = starts.effects_of_far_nuisances(everywhere, at, {s.candidate.label for s in promising})
    singles = [
        starts.start_of_screened(s, few, here.nuisance) for s in shortlist.singles_to_fit(promising, count, moved)
    ]
    ranked = shortlist.by_evidence(few.fit_all([Start((), np.zeros(0), here.nuisance), *singles]))
    other = step_error.better_step_correction(few, ranked)
    if other is not None:
        few, everywhere = replace(few, predict=other), replace(everywhere, predict=other)
        base = everywhere.predictions([Point((), np.zeros(0), at)], keep=True)[0]
        (nominal,) = everywhere.fit_all([starts.restart(nominal)])
        ranked = shortlist.by_evidence(few.fit_all([starts.restart(f) for f in ranked]))

    def ranked_so_far(fits: Sequence[Fitted], by: Fitter) -> Ranked:
        shown = shortlist.reportable(shortlist.unique_by_labels(shortlist.by_evidence(fits)))
        excluded = tuple(k for k in trials if k not in by.trials) if by is not few else ()
        return Ranked(
            tuple(_with_readings(fit, known, shared) for fit in shown),
            tuple(screened),
            unseen,
            len(known),
            len(names),
            not out_of_time(),
            by.weight,
            by.predict,
            excluded,
        )

    so_far.ranked = ranked_so_far(ranked, few)
    if out_of_time():
        return so_far.ranked
    # Once something explains the bulk, what is left shows how correlated the residuals really are.
    reference = few.predictions([Point(ranked[0].parts, ranked[0].values, ranked[0].nuisance)])[0]
    weight = np.maximum(refinement.sample_weight(few.data, reference), weight)
    few, everywhere = replace(few, weight=weight), replace(everywhere, weight=weight)
    fits = everywhere.fit_all([starts.restart(nominal)])

    tick("refitting", shortlist.MAX_REFITTED_SINGLES)
    rivals = shortlist.singles_to_refit([f for f in ranked if f.parts], len(trials) / len(first))
    if refinement.is_adequate(fits[0]):
        rivals = (
            shortlist.expected_to_beat_nominal(rivals, shortlist.best_nominal(ranked), len(trials) / len(first))
            or rivals[:1]
        )
    leaders = [starts.start_on_all_trials(f, everywhere, at) for f in rivals]
    if (
        leaders
        and ranked[0].parts
        and ranked[0].evidence - shortlist.best_nominal(ranked).evidence > extend.MIN_PREDICTED_GAIN_NATS
    ):
        everywhere = everywhere.linearized_at(starts.point_of(leaders[0]))
    if not refinement.is_adequate(
        fits[0]
    ):  # what is left may be what its numbers were moved for: effects begin without that, too
        leaders += [Start(f.parts, f.values, np.zeros(everywhere.size)) for f in rivals[:MAX_ZERO_NUISANCE_STARTS]]
    fits += everywhere.fit_all(leaders)
    if not out_of_time():
        fits = refinement.relinearized(everywhere, fits)
        fits += refinement.refined(everywhere, fits, fits)
        fits += everywhere.fit_all([*starts.absorbed_by_nuisances(fits, everywhere), *starts.nominal_restarts(fits)])
    everywhere, fits, at = refinement.without_departing_trials(everywhere, fits, at)
    if refinement.leaves_gap(shortlist.by_evidence(fits)[0]) and not out_of_time():
        weight = np.maximum(weight, combinations.MIN_WEIGHT_WHILE_UNEXPLAINED)
        few, everywhere = replace(few, weight=weight), replace(everywhere, weight=weight)
        fits = everywhere.fit_all([starts.restart(f) for f in refinement.nominal_and_best(fits)])
    so_far.ranked = ranked_so_far(fits, everywhere)
    everywhere, decoded = _with_lost_commands(everywhere, losing, fits, motion)
    if decoded:
        few = replace(few, predict=everywhere.predict, weight=everywhere.weight)
        promising += screen(few, refinement.frame(few, here), decoded, here, base[first])
        promising.sort(key=lambda s: -s.gain)
        lost = [Start((c,), np.array(c.grid[:1]), shortlist.best_nominal(fits).nuisance) for c in decoded]
        fits = everywhere.fit_all([*(starts.restart(f) for f in refinement.nominal_and_best(fits)), *lost])
    search = Search(few, everywhere, fits, at, here, base[first])
    for size in range(2, MAX_EFFECTS + 1):
        if out_of_time() or not combinations.is_warranted(search, size):
            break
        tick("pairs" if size == 2 else "triples", extend.MAX_EXTENSIONS)
        found = combinations.with_further_effect(search, size, promising)
        if found is None:
            break
        search = found
        if len(search.everywhere.trials) == len(trials):
            everywhere, fits, at = refinement.without_departing_trials(search.everywhere, search.fits, search.at)
            search = replace(search, everywhere=everywhere, fits=fits, at=at)
        so_far.ranked = ranked_so_far(search.fits, search.everywhere)
    return ranked_so_far(search.fits, search.everywhere)


def _fit_nominal(fitter: Fitter) -> tuple[Fitter, Fitted]:
    """The nominal model at its best, and the fitter with the nuisances' responses around it.

    The nominal model must not look worse than it is: its fit goes on as long as it gets better. Where it stays far off,
    something else is wrong with it, and its numbers are left where they were.
    """
    (best,) = fitter.fit_all([Start((), np.zeros(0))])
    prediction = fitter.predictions([starts.point_of(best)])[0]
    for _ in range(MAX_NOMINAL_ROUNDS):
        if best.misfit > HOPELESS_NOMINAL_MISFIT or fitter.out_of_time():
            break
        fitter = replace(fitter, weight=np.maximum(refinement.sample_weight(fitter.data, prediction), fitter.weight))
        fitter = fitter.linearized_at(starts.point_of(best))
        (refitted,) = fitter.fit_all([starts.restart(best)])
        refitted_prediction, on = (
            fitter.predictions([starts.point_of(refitted)])[0],
            Whitening(fitter.data, fitter.weight),
        )
        gained = on.cost(prediction, best.nuisance) - on.cost(refitted_prediction, refitted.nuisance)
        best, prediction = refitted, refitted_prediction
        if gained < MIN_ROUND_GAIN_NATS:
            break
    return (_with_scatter(fitter, best) if best.misfit < HOPELESS_NOMINAL_MISFIT else fitter), best


def _with_lost_commands(
    everywhere: Fitter, candidates: Sequence[Candidate], fits: Sequence[Fitted], motion: ServoMotion | None
) -> tuple[Fitter, list[Candidate]]:
    """The same with the commands that were lost, and candidates that lose them: beside the nominal model or the best
    explanation, unless that leaves nothing to explain or is likelier without. Where samples tell more once they are
    lost, they count for that.
    """
    best, nominal = shortlist.by_evidence(fits)[0], shortlist.best_nominal(fits)
    if motion is None or not candidates or refinement.is_adequate(best):
        return everywhere, []
    for fit in (nominal, best) if best.parts else (nominal,):
        if everywhere.out_of_time():
            break
        decoded = lost_commands.decoded_beside(everywhere, starts.point_of(fit), motion, candidates)
        if decoded is None:
            continue
        losing = replace(everywhere, predict=decoded.predict)
        prediction = losing.predictions([starts.point_of(decoded.fit)])[0]
        reweighted = replace(
            losing, weight=np.maximum(losing.weight, refinement.sample_weight(losing.data, prediction))
        )
        for fitter in (reweighted, losing):
            penalised = lost_commands.penalised(fitter, decoded, motion, candidates)
            if penalised is None:
                continue
            rivals = [starts.restart(f) for f in ([best, fit] if fit is not best else [best])]
            there, *without = fitter.fit_all([starts.with_replaced_candidates(decoded.fit, penalised), *rivals])
            if there.evidence > max(f.evidence for f in without) - (
                starts.LOCAL_OPTIMUM_NATS if fit is nominal else 0.0
            ):
                return fitter, [penalised.get(c.label, c) for c in candidates]
    return everywhere, []


def _with_scatter(fitter: Fitter, fit: Fitted) -> Fitter:
    """The fitter with a tolerance for the scatter of predictions under negligible moves of the nuisances."""
    rng = np.random.default_rng(fitter.predict.seed)
    moved = fit.nuisance + SENSITIVITY_DEVIATION * rng.standard_normal((SENSITIVITY_DRAWS, fitter.size))
    apart = fitter.predictions([starts.point_of(fit), *(Point(fit.parts, fit.values, one) for one in moved)])
    return replace(fitter, data=noise_model.with_scatter(fitter.data, apart))


def _acting_on_misfit(pool: Sequence[Candidate], data: Data, base: Array) -> list[Candidate]:
    """Without candidates of one joint or cell where the nominal model predicts all of its channels."""
    known = np.isfinite(data.value).sum(axis=(0, 1))
    square = (likelihood.scaled(data, likelihood.residual(data, base)) ** 2).sum(axis=(0, 1)) / np.maximum(known, 1)
    quiet = (square < NOISE_ONLY_DISCREPANCY[0]) & (
        likelihood.lasting(data, data.value - base) < NOISE_ONLY_DISCREPANCY[1]
    )
    of: dict[str, list[bool]] = {}
    for channel, still in zip(data.channels, quiet, strict=True):
        of.setdefault(channel.partition(".")[2], []).append(bool(still))
    return [c for c in pool if c.target is None or not all(all(of.get(name, [False])) for name in c.target)]


def _with_readings(fit: Fitted, known: Sequence[Known], sensitive: NDArray[np.bool_]) -> Fitted:
    """The fit with the effects measured on the readings as parts, and with the nuisances that were not fitted as 0."""
    shared, count = np.zeros(len(sensitive)), int(sensitive.sum())
    shared[sensitive] = fit.nuisance[:count]
    return replace(
        fit,
        nuisance=np.concatenate([shared, fit.nuisance[count:]]),
        parts=(*fit.parts, *(k.candidate for k in known)),
        values=np.concatenate([fit.values, [k.value for k in known]]),
        deviations=np.concatenate([fit.deviations, [k.deviation for k in known]]),
    )
