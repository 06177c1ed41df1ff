"""Search explanations of recordings, in rounds: propose, fit all proposals with the same effort, keep the best.

The first round proposes single effects, the next another one beside what is best so far. A search ends where nothing
that is proposed could become worth showing, or the best explains the recordings, or the time is over.
"""

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
from tiago_mj.gap.search import additions, lost_commands, ranking, rounds, second_parameter, starts, step_error
from tiago_mj.gap.search.screen import Screened, screen, worst_predicted

Array = NDArray[np.float64]

#: Physics steps of all trials that are fitted, and of those of the first pass; no fewer than so many trials: ten
#: grasps of a second and a quarter are all fitted, of ten-second ones those in which the nominal model fails most.
FIT_STEPS: Final = 8_000
FIRST_STEPS: Final = 4_000
FIT_TRIALS: Final = 3
FIRST_TRIALS: Final = 1
#: Trials of the first pass at most.
SCREEN_TRIALS: Final = 3
#: Further fits of the nominal model, each with the nuisances' responses around the one before, as long as one brings
#: this much [nats].
MAX_NOMINAL_ROUNDS: Final = 3
MIN_ROUND_GAIN_NATS: Final = 1.0
#: Size of random nuisance moves that change nothing physical [deviations], and number of draws: their predictions show
#: the simulator's own sensitivity. Chosen by hand; no ablation.
SENSITIVITY_DEVIATION: Final = 1e-5
SENSITIVITY_DRAWS: Final = 6
#: Misfit above which the nominal model lacks an effect whatever its nuisances: they are then left at 0. Chosen by hand;
#: no ablation.
HOPELESS_NOMINAL_MISFIT: Final = 20.0
#: Physics steps that a search takes at most, in units of those of all fitted trials: fits then end where they are.
#: Of 18 cases of the blind check (seed 14) right answers took 150 to 690, one 1130; three without any 1120 to 1930.
BUDGET: Final = 900
#: Effects of one explanation at most, apart from those measured on the readings. Chosen by hand; no ablation.
MAX_EFFECTS: Final = 3
#: Explanations that are extended by another effect. Chosen by hand; no ablation.
MAX_SEEDS: Final = 3
#: A nuisance whose move by one deviation changes the log-likelihood by less than this is not fitted [nats]. Chosen by
#: hand; no ablation.
NEAR_ZERO_RESPONSE_NATS: Final = 0.005
#: Effects on one joint or cell are not tried where the mean squares of its channels, by samples and over blocks, are
#: below these. Chosen by hand; no ablation.
NOISE_ONLY_DISCREPANCY: Final = (1.3, 2.0)
#: Effects whose largest tried magnitude changes predictions by less than this (rms, in units of floor and tolerance)
#: are reported as not excited. Chosen by hand; no ablation.
MIN_VISIBILITY: Final = 0.05
#: Smallest weight of a sample (square root) while another effect is sought: half of that of uncorrelated samples.
#: Residuals beside an explanation that lacks an effect are correlated by that effect, not by model error. Chosen by
#: hand; no ablation.
MIN_WEIGHT_WHILE_UNEXPLAINED: Final = 0.5 / ranking.SAMPLES_PER_INDEPENDENT**0.5
#: Names of the rounds, by the number of effects.
ROUNDS: Final = {1: "fitting", 2: "pairs", 3: "triples"}


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
    not_excited: tuple[str, ...]
    known: int
    pool: int
    complete: bool
    weight: Array
    predict: Predictor
    excluded: tuple[int, ...] = ()
    ended: BaseException | None = None


@dataclass(frozen=True)
class State:
    """Where a search stands; every stage makes a new one.

    Attributes:
        few: fits to the trials of the first pass.
        everywhere: fits to all trials.
        fits: explanations of all trials, the nominal model among them.
        at: nuisances of the nominal model on all trials, beside which effects are sought.
        here: the nominal model in the first pass.
        promising: effects after the first pass, best first; none before it.
        pool: candidates that are visible, those too that gained little on the first trial.
        unseen: effects that no magnitude makes visible in these recordings.
        losing: candidates that lose commands: which were lost is decoded, not drawn.
    """

    few: Fitter
    everywhere: Fitter
    fits: tuple[Fitted, ...]
    at: Array
    here: Point
    promising: tuple[Screened, ...] = ()
    pool: tuple[Candidate, ...] = ()
    unseen: tuple[str, ...] = ()
    losing: tuple[Candidate, ...] = ()

    @property
    def best(self) -> Fitted:
        """The likeliest explanation."""
        return ranking.by_evidence(self.fits)[0]

    @property
    def nominal(self) -> Fitted:
        """The nominal model at its best."""
        return ranking.best_nominal(self.fits)

    def with_weight(self, weight: Array) -> State:
        """With other sample weights, (C,); what was fitted before keeps its evidence."""
        few, everywhere = replace(self.few, weight=weight), replace(self.everywhere, weight=weight)
        return replace(self, few=few, everywhere=everywhere)

    def with_fits(self, fits: Sequence[Fitted]) -> State:
        """With further explanations; of fits of the same effects the likeliest stays."""
        return replace(self, fits=tuple(ranking.unique_by_labels([*self.fits, *fits])))


@dataclass(frozen=True)
class Question:
    """What a search explains, and with what.

    Attributes:
        predict: simulations.
        data: measured, of the trials.
        trials: their indices.
        pool: candidates.
        terms: nuisance parameters.
        base: nominal predictions, (ntrials, T, C).
        known: effects that are measured on the readings alone: they are part of every explanation.
        motion: what the servos' motion says; None: there is nothing to be read from it.
        steps: physics steps of one trial; 0: not known, and no limit to them.
    """

    predict: Predictor
    data: Data
    trials: Sequence[int]
    pool: Sequence[Candidate]
    terms: Sequence[Term]
    base: Array
    known: Sequence[Known] = ()
    motion: ServoMotion | None = None
    steps: int = 0

    @property
    def fitted_trials(self) -> int:
        """How many trials are fitted to."""
        return min(max(FIT_STEPS // max(self.steps, 1), FIT_TRIALS), len(self.trials))

    @property
    def budget(self) -> float:
        """Physics steps of the whole search."""
        return BUDGET * self.fitted_trials * self.steps if self.steps else np.inf


def select(
    asked: Question,
    *,
    out_of_time: Callable[[], bool] = lambda: False,
    tick: Tick = lambda stage, total, done=0: None,
) -> Ranked:
    """Rank explanations of the trials; where something ends the search, those that were found until then.

    Args:
        asked: what is to be explained.
        out_of_time: asked between stages.
        tick: told what begins.
    """
    so_far = PartialResult()
    try:
        return _search(asked, so_far, out_of_time, tick)
    except (Exception, KeyboardInterrupt) as fault:
        if so_far.ranked is None or isinstance(fault, RecordingError):
            raise
        return replace(so_far.ranked, complete=False, ended=fault)


def _search(asked: Question, so_far: PartialResult, out_of_time: Callable[[], bool], tick: Tick) -> Ranked:
    """See :func:`select`; ``so_far`` is told what was found, from round to round."""
    read_off = {*ONLY_READ_OFF, *(k.candidate.effect for k in asked.known)}
    pool = _acting_on_misfit([c for c in asked.pool if c.effect not in read_off], asked.data, asked.base)
    count = len({c.effect for c in pool})

    def over() -> bool:
        return out_of_time() or asked.predict.tally["physics_steps"] > asked.budget

    tick("fitting the nominal model", MAX_NOMINAL_ROUNDS)
    everywhere, shared = _fitter(asked, over)
    state = _with_nominal(everywhere, max(FIRST_STEPS // max(asked.steps, 1), FIRST_TRIALS))
    tick("screening", len(pool))
    state = _screened(state, pool, asked.motion, lambda *how_far: tick("screening", *how_far))

    def ranked(state: State) -> Ranked:
        shown = ranking.reportable(ranking.unique_by_labels(state.fits))
        return Ranked(
            tuple(_with_readings(fit, asked.known, shared) for fit in shown),
            state.unseen,
            len(asked.known),
            count,
            not out_of_time(),
            state.everywhere.weight,
            state.everywhere.predict,
            tuple(k for k in everywhere.trials if k not in state.everywhere.trials),
        )

    def tell(state: State) -> None:
        so_far.ranked = ranked(state)

    tell(state)
    for size in range(1, MAX_EFFECTS + 1):
        if (size > 1 and over()) or not _is_warranted(state, size):
            break
        tick(ROUNDS[size], additions.MAX_SINGLES)
        found = _with_singles(state, tell) if size == 1 else _with_further_effect(state, size, tell)
        if found is None:
            break
        state = _departing_left_out(found)
        tell(state)
        if size == 1 and not over():
            state = _with_lost_commands(state, asked.motion)
            tell(state)
    return ranked(state)


def _fitter(asked: Question, over: Callable[[], bool]) -> tuple[Fitter, NDArray[np.bool_]]:
    """What fits to the trials that the nominal model predicts worst, with the nuisances that these tell something of;
    and which of those that trials share these are."""
    weight = ranking.sample_weight(asked.data, asked.base)
    chosen = worst_predicted(asked.base, asked.data, asked.fitted_trials)
    data, base = noise_model.select_trials(asked.data, chosen), asked.base[chosen]
    trials = tuple(asked.trials[k] for k in chosen)
    terms = tuple(sorted(asked.terms, key=lambda term: term.per_trial))
    responses = np.zeros((0, *base.shape))
    if terms:
        moved = asked.predict.all_trials([(term.entry(NUISANCE_STEP),) for term in terms], trials)
        responses = (moved - base) / NUISANCE_STEP
    white = likelihood.whiten(data, likelihood.mean_visible_change(data, responses), weight)
    sensitive = (white**2).sum(axis=(1, 2, 3)) > 2 * NEAR_ZERO_RESPONSE_NATS
    shared = sensitive[[not term.per_trial for term in terms]]
    terms = tuple(term for term, tells in zip(terms, sensitive, strict=True) if tells)
    given = tuple(k.candidate.entry(k.value) for k in asked.known)
    fitter = Fitter(asked.predict, trials, data, weight, terms, responses[sensitive], given, out_of_time=over)
    return fitter, shared


def _with_nominal(everywhere: Fitter, count: int) -> State:
    """The nominal model at its best, and so many trials of the first pass, in which it fails most."""
    everywhere, nominal = _fit_nominal(everywhere)
    at = nominal.nuisance if nominal.misfit < HOPELESS_NOMINAL_MISFIT else np.zeros(everywhere.size)
    base = everywhere.predictions([Point((), np.zeros(0), at)], keep=True)[0]
    first = worst_predicted(base, everywhere.data, min(count, SCREEN_TRIALS))
    few, here = everywhere.part(first), Point((), np.zeros(0), everywhere.of(first, at))
    return State(few, everywhere, (nominal,), at, here)


def _screened(
    state: State, pool: Sequence[Candidate], motion: ServoMotion | None, how_far: Callable[[int, int], None]
) -> State:
    """The same after the first pass over the pool."""
    losing = tuple(c for c in pool if c.effect == lost_commands.EFFECT) if motion is not None else ()
    tried = screen(state.few, [c for c in pool if c not in losing], state.here, how_far)
    visible = {s.candidate.effect for s in (*tried.on_all, *tried.dropped) if s.visible > MIN_VISIBILITY}
    names = dict.fromkeys(c.effect for c in pool)
    unseen = tuple(name for name in names if name not in visible | {c.effect for c in losing})
    promising = tuple(s for s in tried.on_all if s.candidate.effect not in unseen)
    seen = tuple(s.candidate for s in (*promising, *tried.dropped) if s.candidate.effect not in unseen)
    return replace(state, promising=promising, pool=seen, unseen=unseen, losing=losing)


def _is_warranted(state: State, size: int) -> bool:
    """Whether explanations by so many effects are sought: not where the best one explains hardly more than the nominal
    model and leaves no gap, and three effects only where the best two leave a gap."""
    best = state.best
    gap = ranking.discrepancy(best) > ranking.INADEQUATE_DISCREPANCY
    if size == 1:
        return True
    if best.evidence - state.nominal.evidence < ranking.MIN_EVIDENCE_GAIN_NATS and not gap:
        return False
    return size == 2 or (gap and len(best.parts) == size - 1)


def _with_singles(state: State, tell: Callable[[State], None]) -> State:
    """The search with the single effects that the first pass found promising."""
    few, here = state.few, state.here
    moved = starts.effects_of_far_nuisances(state.everywhere, state.at, {c.label for c in state.pool})
    hurried = few.out_of_time()  # the first few are fitted all the same: else there would be no answer
    chosen = additions.singles(state.promising, moved, additions.MIN_SINGLES if hurried else additions.MAX_SINGLES)
    begin = [starts.start_of_screened(s, few, here.nuisance) for s in chosen]
    on_few = few.fit_all([starts.start_at(here), *begin])
    other = None if hurried else step_error.better_step_correction(few, ranking.by_evidence(on_few))
    if other is not None:
        state = replace(state, few=replace(few, predict=other), everywhere=replace(state.everywhere, predict=other))
        state = replace(state, fits=tuple(state.everywhere.fit_all([starts.restart(state.nominal)])))
        few = state.few
        ahead = [f for f in ranking.by_evidence(on_few) if f.parts][: rounds.MAX_ON_ALL_TRIALS]
        on_few = few.fit_all([starts.restart(f) for f in (ranking.best_nominal(on_few), *ahead)])
    # Once something explains the bulk, what is left shows how correlated the residuals really are.
    reference = few.predictions([starts.point_of(ranking.by_evidence(on_few)[0])])[0]
    state = state.with_weight(np.maximum(ranking.sample_weight(few.data, reference), few.weight))
    state = replace(state, fits=tuple(rounds.reweighted(state.everywhere, state.fits)))
    times = len(state.everywhere.trials) / len(few.trials)
    near = rounds.worth_all_trials([f for f in on_few if f.parts], ranking.best_nominal(on_few), times)
    state = _fitted_to_all(state, [starts.start_on_all_trials(f, state.everywhere, state.at) for f in near], tell)
    if ranking.discrepancy(state.best) > ranking.INADEQUATE_DISCREPANCY and not few.out_of_time():
        state = state.with_weight(np.maximum(state.everywhere.weight, MIN_WEIGHT_WHILE_UNEXPLAINED))
        state = replace(state, fits=tuple(rounds.reweighted(state.everywhere, state.fits)))
    return state


def _with_further_effect(state: State, size: int, tell: Callable[[State], None]) -> State | None:
    """The search with explanations by so many effects, found beside those by one less; None where nothing promises
    anything.

    Beside what an effect leaves out errors last, so that samples tell little; beside all that acts they need not. So
    further effects are sought as if samples told more, and all is judged by what they tell beside the best that was
    found.
    """
    weight = state.everywhere.weight
    sought = state.with_weight(np.maximum(weight, MIN_WEIGHT_WHILE_UNEXPLAINED))
    begin = _further(sought, size)
    found = sought.everywhere.fit_all(begin)
    if not found:
        return None
    leader = ranking.by_evidence([f for f in found if len(f.parts) == size] or found)[0]
    prediction = state.everywhere.predictions([starts.point_of(leader)])[0]
    state = state.with_weight(np.maximum(weight, ranking.sample_weight(state.everywhere.data, prediction)))
    fits = [*state.fits, *found]
    state = replace(state, fits=tuple(rounds.reweighted(state.everywhere, fits)))
    return _fitted_to_all(state, [], tell)


def _further(state: State, size: int) -> list[Start]:
    """Starts for all trials of explanations by so many effects."""
    few, everywhere, at = state.few, state.everywhere, state.at
    adequate = bool(state.best.parts) and ranking.is_adequate(state.best, ranking.ADEQUATE_WITH_EFFECTS)
    seeds = ranking.unique_by_classes([f for f in ranking.by_evidence(state.fits) if len(f.parts) == size - 1])
    seeds = seeds[: 1 if adequate else MAX_SEEDS]
    least = additions.MIN_GAIN_BESIDE_ADEQUATE_NATS if adequate else additions.MIN_PREDICTED_GAIN_NATS
    tried = [
        start for seed in seeds for start in additions.beside(few, seed, state.here.nuisance, state.promising, least)
    ]
    if size == 2 and not adequate:
        tried = [*additions.superposed_pairs(few, state.here, state.promising), *tried]
    on_few = ranking.unique_by_labels(few.fit_all(additions.unique(tried)))
    gap = not seeds or ranking.discrepancy(seeds[0]) > ranking.INADEQUATE_DISCREPANCY
    if not gap and not rounds.expected_to_add(on_few, seeds[0], few, everywhere):
        return []
    begin = [starts.start_on_all_trials(f, everywhere, at) for f in on_few[: rounds.MAX_ON_ALL_TRIALS]]
    if seeds and not adequate:
        begin += additions.where_it_fails(everywhere, seeds[0], at, len(few.trials), state.pool)
    if seeds:
        begin += starts.starts_on_far_nuisances(seeds[0], everywhere, state.pool)
    return additions.unique(begin)


def _fitted_to_all(state: State, begin: Sequence[Start], tell: Callable[[State], None]) -> State:
    """The search with further explanations fitted to all trials, all fitted around the best, and what those lead to."""
    everywhere = state.everywhere
    state = state.with_fits(everywhere.fit_all(begin))
    tell(state)
    nothing = state.best.evidence - state.nominal.evidence < ranking.MIN_EVIDENCE_GAIN_NATS
    if everywhere.out_of_time() or (nothing and ranking.is_adequate(state.nominal)):
        return state
    everywhere, fits = rounds.around_the_best(everywhere, state.fits)
    state = replace(state, everywhere=everywhere).with_fits(fits)
    fails = ranking.discrepancy(state.best) > ranking.INADEQUATE_DISCREPANCY
    state = state.with_fits(second_parameter.refined(everywhere, state.fits, state.best, fails=fails))
    return state.with_fits(everywhere.fit_all(rounds.variations(state.fits, everywhere)))


def _departing_left_out(state: State) -> State:
    """The search without the trials whose motion departs from what the best explanation predicts."""
    everywhere, fits, at = rounds.without_departing_trials(state.everywhere, list(state.fits), state.at)
    return replace(state, everywhere=everywhere, fits=tuple(ranking.unique_by_labels(fits)), at=at)


def _with_lost_commands(state: State, motion: ServoMotion | None) -> State:
    """The search with commands lost that were, where that explains more, and candidates that lose them."""
    everywhere, decoded = _decoded(state.everywhere, state.losing, state.fits, motion)
    if not decoded:
        return state
    few = replace(state.few, predict=everywhere.predict, weight=everywhere.weight)
    promising = [*state.promising, *screen(few, decoded, state.here).on_all]
    ahead = [f for f in ranking.unique_by_labels(state.fits) if f.parts][: rounds.MAX_ON_ALL_TRIALS]
    nominal = ranking.best_nominal(state.fits)
    lost = [Start((c,), np.array(c.grid[:1]), nominal.nuisance) for c in decoded]
    fits = everywhere.fit_all([*(starts.restart(f) for f in (nominal, *ahead)), *lost])
    return replace(
        state,
        few=few,
        everywhere=everywhere,
        promising=tuple(sorted(promising, key=lambda s: -s.gain)),
        pool=(*state.pool, *decoded),
        fits=tuple(ranking.unique_by_labels(fits)),
    )


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
        fitter = replace(fitter, weight=np.maximum(ranking.sample_weight(fitter.data, prediction), fitter.weight))
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


def _decoded(
    everywhere: Fitter, candidates: Sequence[Candidate], fits: Sequence[Fitted], motion: ServoMotion | None
) -> tuple[Fitter, list[Candidate]]:
    """The same with the commands that were lost, and candidates that lose them: beside the nominal model or the best
    explanation, unless that leaves nothing to explain or is likelier without. Where samples tell more once they are
    lost, they count for that.
    """
    best, nominal = ranking.by_evidence(fits)[0], ranking.best_nominal(fits)
    if motion is None or not candidates or ranking.is_adequate(best):
        return everywhere, []
    for fit in (nominal, best) if best.parts else (nominal,):
        if everywhere.out_of_time():
            break
        decoded = lost_commands.decoded_beside(everywhere, starts.point_of(fit), motion, candidates)
        if decoded is None:
            continue
        losing = replace(everywhere, predict=decoded.predict)
        prediction = losing.predictions([starts.point_of(decoded.fit)])[0]
        reweighted = replace(losing, weight=np.maximum(losing.weight, ranking.sample_weight(losing.data, prediction)))
        for fitter in (reweighted, losing):
            penalised = lost_commands.penalised(fitter, decoded, motion, candidates)
            if penalised is None:
                continue
            rivals = [starts.restart(f) for f in ([best, fit] if fit is not best else [best])]
            there, *without = fitter.fit_all([starts.with_replaced_candidates(decoded.fit, penalised), *rivals])
            if there.evidence > max(f.evidence for f in without) - (
                ranking.LOCAL_OPTIMUM_NATS if fit is nominal else 0.0
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
