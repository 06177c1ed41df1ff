"""Search over explanations of recordings in rounds: propose, fit all proposals with equal effort, keep the best.

The first round proposes single effects, the next adds another effect to the best so far. A search ends when no proposal
could become worth reporting, when the best explains the recordings, or when the time is over.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.detectors.readings import only_read_off
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.search import (
    additions,
    agreement,
    all_trials,
    beginning,
    driver_period,
    losing,
    lost_commands,
    on_each,
    proposed_sets,
    ranking,
    rounds,
    second_parameter,
    set_point_starts,
    sharpen,
    starts,
    step_error,
    together,
    wider,
)
from tiago_mj.gap.search.beside_readings import with_readings
from tiago_mj.gap.search.own_numbers import in_effects
from tiago_mj.gap.search.state import MIN_WEIGHT_WHILE_UNEXPLAINED, Question, Ranked, State, Tick
from tiago_mj.io.deadline import Deadline, OutOfTimeError

Array = NDArray[np.float64]
#: Makes the fitter of a question, asked whether the search is over; and a mask of the shared nuisances that it has.
Begin = Callable[[Question, Callable[[], bool]], tuple[Fitter, NDArray[np.bool_]]]

#: Effects of one explanation at most, apart from those measured on the readings. Halved and doubled, none of 16
#: answers about hinges changes (varied.json).
MAX_EFFECTS: Final = 3
#: Explanations that are extended by another effect. Halved and doubled, none of 15 answers about hinges changes
#: (varied.json).
MAX_SEEDS: Final = 3
#: Simulations of a screening trial from the moment on at which a search hurries until its first explanations are
#: fitted to those. Halved and doubled, none of 16 answers about hinges changes (varied.json).
LANDING: Final = 60
#: Names of the rounds, by the number of effects.
ROUNDS: Final = {1: "fitting", 2: "pairs", 3: "triples"}


@dataclass
class PartialResult:
    """Best result so far of a search, which is its result where it ends early.

    Attributes:
        ranked: None before the nominal model was fitted.
        tried: effects that were tried.
        effects: number of those that there are to try; 0: not known yet.
        hurried: whether time was found to be short, once and for all.
    """

    ranked: Ranked | None = None
    tried: set[str] = field(default_factory=set)
    effects: int = 0
    hurried: bool = False

    @property
    def stands(self) -> bool:
        """Whether an explanation by effects was found."""
        return self.ranked is not None and any(len(fit.parts) > self.ranked.known for fit in self.ranked.fits)


def select(
    asked: Question,
    *,
    so_far: PartialResult | None = None,
    deadline: Deadline | None = None,
    landing: float = 0.0,
    tick: Tick = lambda stage, total, done=0, *, gap=None: None,
    begin: Begin = beginning.fitter,
) -> Ranked:
    """Explanations of the trials ranked by evidence; where time or user end the search, those found until then.

    Args:
        asked: what is to be explained; its simulations have the same deadline, which ends them.
        so_far: updated with what was found; None: not wanted.
        deadline: of the search; None: there is none.
        landing: seconds before it from which on the search hurries to what it can fit, as long as nothing stands.
        tick: told what begins.
        begin: makes the fitter.

    Raises:
        OutOfTimeError: the deadline was over before the nominal model was fitted.
    """
    so_far, by = so_far or PartialResult(), deadline or Deadline()

    def out_of_time() -> bool:
        so_far.hurried = so_far.hurried or by.over(0.0 if so_far.stands else landing)
        return so_far.hurried

    try:
        return _search(asked, so_far, out_of_time, tick, begin)
    except (OutOfTimeError, KeyboardInterrupt) as end:
        if so_far.ranked is None:
            raise
        return replace(so_far.ranked, complete=False, ended=end)


def _search(
    asked: Question, so_far: PartialResult, out_of_time: Callable[[], bool], tick: Tick, begin: Begin
) -> Ranked:
    """The rounds of :func:`select`; ``so_far`` is updated after each."""
    read_off = {*only_read_off(), *(k.candidate.effect for k in asked.known)}
    pool = beginning.acting_on_misfit([c for c in asked.pool if c.effect not in read_off], asked.data, asked.base)
    count = so_far.effects = len({c.effect for c in pool})
    size = 1

    def over() -> bool:
        tally = asked.predict.tally
        spent = tally["physics_steps"] - tally[step_error.APART] - asked.already
        return out_of_time() or spent > asked.budget(size)

    tick("fitting the nominal model", beginning.MAX_NOMINAL_ROUNDS)
    full, shared = begin(asked, over)
    state = replace(beginning.with_nominal(full, asked.first_trials), motion=asked.motion)
    first = state.full
    state = state if over() else beginning.sharpened(state)

    def ranked(state: State, wide: Fitter | None = None) -> Ranked:
        fits, full, known = _shown(state, asked, shared, wide), state.full, len(asked.known)
        complete = not out_of_time()
        return Ranked(fits, state.unseen, known, count, complete, full.weight, full.predict, state.excluded)

    def tell(state: State) -> None:
        so_far.ranked = ranked(state)

    def fitted(state: State) -> None:
        tell(state)
        tick("refitting", rounds.MAX_ROUNDS, gap=_leaves_a_gap(state.best))

    tell(state)
    tick("screening", len(pool), gap=_leaves_a_gap(state.best))
    state = beginning.screened(state, pool, asked.motion, partial(tick, "screening"), so_far.tried.update)
    tell(state)
    sought = False
    for size in range(1, (asked.most or MAX_EFFECTS) + 1):
        further = size == 1 or (not over() and (asked.beyond or _leaves_a_gap(state.best)))
        if not further or not _is_warranted(state, size):
            break
        tick(ROUNDS[size], additions.MAX_SINGLES, gap=_leaves_a_gap(state.best))
        found = _with_singles(state, fitted, tick) if size == 1 else _with_further_effect(state, size, fitted)
        if found is None:
            break
        if size == 1 and asked.sets is not None and _leaves_a_gap(found.best):
            before = asked.predict.tally["physics_steps"]
            found = _with_sets(
                _ending(found, out_of_time), fitted, partial(proposed_sets.fitted, asked.sets, asked.pool)
            )
            found = _ending(found, over)
            asked.predict.tally[step_error.APART] += asked.predict.tally["physics_steps"] - before
        state = _departing_left_out(on_each.target(found, out_of_time))
        open_still = size == 1 or state.full.predict.corrected < 1
        state = sharpen.sharpened(step_error.decided(state) if open_still and not over() else state)
        tell(state)
        if size == 1 and not over() and _losses_are_likely(state):
            tick("lost commands", 1, gap=_leaves_a_gap(state.best))
            state, sought = losing.with_lost_commands(state), True
            tell(state)
    if not state.full.predict.replays and not out_of_time() and _leaves_a_gap(state.best):  # whatever the budget
        state = _with_sets(_ending(state, out_of_time), fitted, together.found)
        tell(state)
    if not sought and not out_of_time():  # nor by its budget: they may be all that there is
        tick("lost commands", 1, gap=_leaves_a_gap(state.best))
        state = replace(state, full=replace(state.full, out_of_time=out_of_time))
        state = _with_losses_at_last(state, over, fitted)
        tell(state)
    if not out_of_time():  # whatever the budget: one effect for its like may be all that is wrong
        state = _exchanged(replace(state, full=replace(state.full, out_of_time=out_of_time)), gap=False)
        tell(state)
    # Not by the search's budget of physics steps: whatever that found is not told before it was seen on all trials.
    wide = replace(all_trials.wide(asked, first, state.excluded), out_of_time=out_of_time)
    if not out_of_time():
        tick("all trials", 1, gap=_leaves_a_gap(state.best))
        state, wide = all_trials.fitted(state, wide)
        state = all_trials.settled(_departing_left_out(state))
    return ranked(state, wide)


def _shown(state: State, asked: Question, shared: NDArray[np.bool_], wide: Fitter | None) -> tuple[Fitted, ...]:
    """Explanations as they are told; ``wide``: the first fitter, for how they do in the noise assumed at first."""
    fits = ranking.each_once(ranking.unique_by_labels(state.fits))
    shown = ranking.reportable(fits, replays=state.full.predict.replays)
    if wide is not None:
        shown = agreement.with_agreement(state.full, shown)
        if asked.assumed is None:
            shown = sharpen.misfits_by(wide, state.full, shown)
        else:
            data = noise_model.select_trials(asked.assumed, asked.trials.rows_of(wide.trials))
            judged = sharpen.misfits_by(replace(wide, data=data), state.full, shown)
            shown = [replace(fit, sharp=None) for fit in judged]
    terms = sorted(asked.terms, key=lambda term: term.per_trial)
    return tuple(in_effects(with_readings(fit, asked.known, shared), terms) for fit in shown)


def _with_losses_at_last(state: State, over: Callable[[], bool], tell: Callable[[State], None]) -> State:
    """The search with lost commands, and with another effect beside them, where that explains more."""
    found = losing.with_lost_commands(state)
    if found is state:
        return state
    found = found if over() else _with_further_effect(found, 2, tell) or found
    return sharpen.sharpened(_departing_left_out(found))


def _losses_are_likely(state: State) -> bool:
    """Whether lost commands are decoded before a second effect is sought."""
    if state.motion is None or not state.losing or ranking.is_adequate(state.best):
        return False
    return lost_commands.are_likely(state.full, state.best, state.motion)


def _leaves_a_gap(best: Fitted) -> bool:
    """Whether the reduced chi-square of the best explanation is too large, so that the search is expected to go on."""
    return not ranking.is_adequate(best, ranking.ADEQUATE_WITH_EFFECTS if best.parts else ranking.ADEQUATE_DISCREPANCY)


def _is_warranted(state: State, size: int) -> bool:
    """Whether explanations with ``size`` effects are sought: two only where the best one gains evidence or leaves a
    gap, three only where the best two leave a gap."""
    best = state.best
    gap = ranking.leaves_a_gap(best, replays=state.full.predict.replays)
    if size == 1:
        return True
    if best.evidence - state.nominal.evidence < ranking.MIN_EVIDENCE_GAIN_NATS and not gap:
        return False
    return size == 2 or (gap and ranking.size(best) == size - 1)


def _with_singles(state: State, tell: Callable[[State], None], tick: Tick) -> State:
    """The search with single effects fitted: the most promising to the screening trials, the best of those to all
    trials."""
    screening, linearization_point = state.screening, state.linearization_point
    moved = starts.effects_of_far_nuisances(state.full, state.nominal_nuisance, {c.label for c in state.pool})
    hurried = screening.out_of_time()  # the first few are fitted all the same: else there would be no answer
    chosen = additions.singles(state.promising, moved, additions.MIN_SINGLES if hurried else additions.MAX_SINGLES)
    begin = [starts.start_of_screened(s, screening, linearization_point.nuisance) for s in chosen]
    on_screening = wider.fitted(screening, screening.fit_all([starts.start_at(linearization_point), *begin]))
    other = None if hurried else step_error.better_step_correction(screening, step_error.leaders(on_screening))
    if other is not None:
        state = replace(state, screening=replace(screening, predict=other), full=replace(state.full, predict=other))
        state = replace(state, fits=tuple(state.full.fit_all([starts.restart(state.nominal)])))
        screening = state.screening
        ahead = [f for f in ranking.by_evidence(on_screening) if f.parts][: rounds.MAX_ON_ALL_TRIALS]
        on_screening = screening.fit_all([starts.restart(f) for f in (ranking.best_nominal(on_screening), *ahead)])
    tick("weighing", 1, gap=_leaves_a_gap(ranking.by_evidence(on_screening)[0]))
    tell(replace(state, fits=tuple(on_screening)))
    # Once something explains the bulk, what is left shows how correlated the residuals really are.
    reference = screening.predictions([Point.of(ranking.by_evidence(on_screening)[0])])[0]
    state = state.with_weight(np.maximum(ranking.sample_weight(screening.data, reference), screening.weight))
    state = replace(state, fits=tuple(rounds.reweighted(state.full, state.fits)))
    times = len(state.full.trials) / len(screening.trials)
    near = rounds.worth_all_trials([f for f in on_screening if f.parts], ranking.best_nominal(on_screening), times)
    begin = [starts.start_on_all_trials(f, state.full, state.nominal_nuisance) for f in near]
    if _leaves_a_gap(ranking.by_evidence(on_screening)[0]) and not screening.out_of_time():
        begin += set_point_starts.beside(state, state.nominal, additions.MIN_PREDICTED_GAIN_NATS)
    state = _fitted_to_all(state, begin, tell)
    if ranking.discrepancy(state.best) > ranking.INADEQUATE_DISCREPANCY and not screening.out_of_time():
        state = state.with_weight(np.maximum(state.full.weight, MIN_WEIGHT_WHILE_UNEXPLAINED))
        state = replace(state, fits=tuple(rounds.reweighted(state.full, state.fits)))
    return state


def _with_further_effect(state: State, size: int, tell: Callable[[State], None]) -> State | None:
    """The search with explanations by ``size`` effects, each one of fewer effects with one added; None where no
    addition is promising."""
    return _with_explanations(state, lambda sought: sought.full.fit_all(_further(sought, size)), tell, size)


def _with_sets(state: State, tell: Callable[[State], None], find: Callable[[State], Sequence[Fitted]]) -> State:
    """The search with sets of effects that are sought together."""
    found = _with_explanations(state, find, tell)
    return state if found is None else sharpen.sharpened(_departing_left_out(found))


def _ending(state: State, out_of_time: Callable[[], bool]) -> State:
    """The search whose fits to all trials end once that is true."""
    return replace(state, full=replace(state.full, out_of_time=out_of_time))


def _with_explanations(
    state: State, find: Callable[[State], Sequence[Fitted]], tell: Callable[[State], None], size: int = 0
) -> State | None:
    """The search with further explanations, some of which may be of ``size`` effects; None where there are none.

    The residual of an explanation that lacks an effect is strongly correlated, which lowers the weight of a sample; the
    missing effect is the cause of that and not model error. So additions are sought with at least a minimum weight, and
    all explanations are compared under the weight that the residual of the best found gives.
    """
    weight = state.full.weight
    sought = state.with_weight(np.maximum(weight, MIN_WEIGHT_WHILE_UNEXPLAINED))
    found = find(sought)
    if not found:
        return None
    leader = ranking.by_evidence([f for f in found if ranking.size(f) == size] or found)[0]
    prediction = state.full.predictions([Point.of(leader)])[0]
    state = state.with_weight(np.maximum(weight, ranking.sample_weight(state.full.data, prediction)))
    fits = [*state.fits, *found]
    state = replace(state, fits=tuple(rounds.reweighted(state.full, fits)))
    return _fitted_to_all(state, [], tell)


def _further(state: State, size: int) -> list[Start]:
    """Starts for all trials of explanations by ``size`` effects."""
    screening, full, nominal_nuisance = state.screening, state.full, state.nominal_nuisance
    adequate = bool(state.best.parts) and ranking.is_adequate(state.best, ranking.ADEQUATE_WITH_EFFECTS)
    seeds = ranking.unique_by_classes([f for f in ranking.by_evidence(state.fits) if ranking.size(f) == size - 1])
    seeds = seeds[: 1 if adequate else MAX_SEEDS]
    least = additions.MIN_GAIN_BESIDE_ADEQUATE_NATS if adequate else additions.MIN_PREDICTED_GAIN_NATS
    tried = [
        start
        for seed in seeds
        for start in additions.beside(screening, seed, state.linearization_point.nuisance, state.promising, least)
    ]
    if size == 2 and not adequate:
        tried = [*additions.superposed_pairs(screening, state.linearization_point, state.promising), *tried]
    on_screening = ranking.unique_by_labels(wider.fitted(screening, screening.fit_all(additions.unique(tried))))
    gap = not seeds or ranking.leaves_a_gap(seeds[0], replays=full.predict.replays)
    begin = [
        start
        for seed in set_point_starts.worth(seeds)
        for start in set_point_starts.beside(state, seed, least, drivers=not adequate)
    ]
    if not gap and not rounds.expected_to_add(on_screening, seeds[0], screening, full):
        return begin
    begin += [starts.start_on_all_trials(f, full, nominal_nuisance) for f in on_screening[: rounds.MAX_ON_ALL_TRIALS]]
    if seeds and not adequate:
        begin += additions.where_it_fails(full, seeds[0], nominal_nuisance, len(screening.trials), state.pool)
    if seeds:
        begin += starts.starts_on_far_nuisances(seeds[0], full, state.pool)
    return additions.unique(begin)


def _fitted_to_all(state: State, begin: Sequence[Start], tell: Callable[[State], None]) -> State:
    """The search with further explanations fitted to all trials, then with fits linearized around the best and
    simplified."""
    full = state.full
    state = state.with_fits(wider.fitted(full, full.fit_all(begin)))
    tell(state)
    if len(state.best.parts) > 1 and _leaves_a_gap(state.best):
        state = _exchanged(state, gap=True)
    nothing = state.best.evidence - state.nominal.evidence < ranking.MIN_EVIDENCE_GAIN_NATS
    if full.out_of_time() or (nothing and ranking.is_adequate(state.nominal)):
        return state
    full, fits = rounds.around_the_best(full, state.fits)
    state = replace(state, full=full).with_fits(fits)
    fails = ranking.discrepancy(state.best) > ranking.INADEQUATE_DISCREPANCY
    state = state.with_fits(second_parameter.refined(state, fails=fails))
    state = set_point_starts.looked_for_again(state)
    if _leaves_a_gap(state.best):
        state = driver_period.tried(state)
    return state.with_fits(full.fit_all(rounds.variations(state.fits, full)))


def _exchanged(state: State, *, gap: bool) -> State:
    """The search with one effect of its best explanation exchanged for others, see :func:`additions.exchanged`."""
    if not state.best.parts or state.full.out_of_time():
        return state
    tried = {ranking.labels_of(fit) for fit in state.fits}
    begin = additions.exchanged(state.full, state.best, len(state.screening.trials), state.pool, tried, gap=gap)
    return state.with_fits(state.full.fit_all(begin))


def _departing_left_out(state: State) -> State:
    """The search without the trials whose motion departs from what the best explanation predicts."""
    full, fits, nominal_nuisance = rounds.without_departing_trials(state.full, list(state.fits), state.nominal_nuisance)
    excluded = tuple(k for k in state.full.trials if k not in full.trials)
    fits = ranking.unique_by_labels(fits)
    return replace(
        state, full=full, fits=tuple(fits), nominal_nuisance=nominal_nuisance, excluded=(*state.excluded, *excluded)
    )
