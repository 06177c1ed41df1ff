"""Beginning of a search: the nominal model is fitted, then every effect is screened beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference import likelihood, noise_model, scatter, step_tolerance
from tiago_mj.gap.inference.fit import NUISANCE_STEP, Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, OwnNumber
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.whitening import Whitening
from tiago_mj.gap.search import lost_commands, mounting, ranking, sharpen, starts
from tiago_mj.gap.search.screen import screen, worst_predicted
from tiago_mj.gap.search.state import Question, State

Array = NDArray[np.float64]

#: Further fits of the nominal model, each with the nuisances' responses around the one before, as long as one brings
#: this much [nats].
MAX_NOMINAL_ROUNDS: Final = 3
MIN_ROUND_GAIN_NATS: Final = 1.0
#: Misfit above which the nominal model lacks an effect whatever its nuisances: they are then left at 0. Halved and
#: doubled, none of 16 answers about hinges changes (varied.json).
HOPELESS_NOMINAL_MISFIT: Final = 20.0
#: A nuisance whose move by one deviation changes the log-likelihood by less than this is not fitted [nats]: the
#: recordings would narrow its prior by 1 - 1/√(1 + 2 · 0.005) = 0.5 %.
NEAR_ZERO_RESPONSE_NATS: Final = 0.005
#: Effects on one joint or cell are not tried where the mean squares of its channels, by samples and over blocks, are
#: below these. Halved and doubled, none of 16 answers about hinges changes (varied.json).
NOISE_ONLY_DISCREPANCY: Final = (1.3, 2.0)
#: Effects whose largest tried magnitude changes predictions by less than this (rms, in units of floor and tolerance)
#: are reported as not excited. Halved and doubled, none of 16 answers about hinges changes (varied.json).
MIN_VISIBILITY: Final = 0.05


def fitter(asked: Question, over: Callable[[], bool]) -> tuple[Fitter, NDArray[np.bool_]]:
    """The fitter on the trials that the nominal model predicts worst, with the nuisances to which these trials are
    sensitive; and a mask of the shared nuisances that were kept."""
    weight = ranking.sample_weight(asked.data, asked.base)
    chosen = worst_predicted(asked.base, asked.data, asked.fitted_trials)
    data, base = noise_model.select_trials(asked.data, chosen), asked.base[chosen]
    trials = asked.trials.at(chosen)
    terms = tuple(sorted(asked.terms, key=lambda term: term.per_trial))
    responses = np.zeros((0, *base.shape))
    if terms:
        # Beside the nominal model the numbers of effects change nothing.
        moves = [() if isinstance(term, OwnNumber) else (term.entry(NUISANCE_STEP),) for term in terms]
        moved = asked.predict.all_trials(moves, trials)
        responses = (moved - base) / NUISANCE_STEP
    white = likelihood.whiten(data, likelihood.mean_visible_change(data, responses), weight)
    sensitive = (white**2).sum(axis=(1, 2, 3)) > 2 * NEAR_ZERO_RESPONSE_NATS
    sensitive |= np.array([isinstance(term, OwnNumber) for term in terms], dtype=bool)
    shared = sensitive[[not term.per_trial for term in terms]]
    terms = tuple(term for term, tells in zip(terms, sensitive, strict=True) if tells)
    given = tuple(k.candidate.entry(k.value) for k in asked.known)
    fitter = Fitter(asked.predict, trials, data, weight, terms, responses[sensitive], given, out_of_time=over)
    return fitter, shared


def with_nominal(full: Fitter, count: int) -> State:
    """Search state with the fitted nominal model, and the ``count`` trials that it predicts worst as screening
    trials."""
    full, nominal = _fit_nominal(full)
    nominal_nuisance = nominal.nuisance if nominal.misfit < HOPELESS_NOMINAL_MISFIT else np.zeros(full.size)
    base = full.predictions([Point((), np.zeros(0), nominal_nuisance)], keep=True)[0]
    first = worst_predicted(base, full.data, count)
    screening, linearization_point = full.part(first), Point((), np.zeros(0), full.of(first, nominal_nuisance))
    return State(screening, full, (nominal,), nominal_nuisance, linearization_point)


def sharpened(state: State) -> State:
    """Where the nominal model explains the recordings: the search with sensor noise and step error estimated from its
    residual, as the wider tolerances assumed between two simulators hide small effects.

    Not in contacts: two simulators differ by more than noise there, and of twelve grasps at 25 Hz (blind check, seed
    941) two without any effect were then given one.
    """
    if not ranking.is_adequate(state.nominal):
        return state
    state = sharpen.sharpened(state, in_contact=False)
    nominal_nuisance = state.nominal.nuisance
    rows = state.full.trials.rows_of(state.screening.trials)
    return replace(
        state,
        nominal_nuisance=nominal_nuisance,
        linearization_point=replace(state.linearization_point, nuisance=state.full.of(rows, nominal_nuisance)),
    )


def screened(
    state: State,
    pool: Sequence[Candidate],
    motion: ServoMotion | None,
    how_far: Callable[[int, int], None],
    tried: Callable[[Iterable[str]], None] = lambda names: None,
) -> State:
    """The search with the results of screening: promising effects, visible candidates, and effects that these
    recordings do not excite."""
    pool = [*pool, *mounting.proposed(state.screening, state.linearization_point, pool)]
    losing = tuple(c for c in pool if c.effect == lost_commands.EFFECT) if motion is not None else ()
    found = screen(state.screening, [c for c in pool if c not in losing], state.linearization_point, how_far, tried)
    tried(c.effect for c in losing)  # what was lost is decoded beside what is found, if it calls for that
    visible = {s.candidate.effect for s in (*found.on_all, *found.dropped) if s.visible > MIN_VISIBILITY}
    looked_at = {s.candidate.effect for s in (*found.on_all, *found.dropped)}
    names = dict.fromkeys(c.effect for c in pool if c.effect in looked_at)  # of the others nothing is known
    unseen = tuple(name for name in names if name not in visible | {c.effect for c in losing})
    promising = tuple(s for s in found.on_all if s.candidate.effect not in unseen)
    seen = tuple(s.candidate for s in (*promising, *found.dropped) if s.candidate.effect not in unseen)
    return replace(state, promising=promising, pool=seen, unseen=unseen, losing=losing)


def _fit_nominal(fitter: Fitter) -> tuple[Fitter, Fitted]:
    """The nominal model with its best nuisances, and the fitter with the nuisance responses linearized there.

    The fit is repeated as long as it improves, so that the nominal model does not look worse than it is. Where the
    residual stays large an effect is missing, and the nuisances stay at 0.
    """
    (best,) = fitter.fit_all([Start((), np.zeros(0))])
    prediction = fitter.predictions([Point.of(best)])[0]
    for _ in range(MAX_NOMINAL_ROUNDS):
        if best.misfit > HOPELESS_NOMINAL_MISFIT or fitter.out_of_time():
            break
        fitter = replace(fitter, weight=np.maximum(ranking.sample_weight(fitter.data, prediction), fitter.weight))
        fitter = fitter.linearized_at(Point.of(best))
        (refitted,) = fitter.fit_all([starts.restart(best)])
        refitted_prediction, on = (
            fitter.predictions([Point.of(refitted)])[0],
            Whitening(fitter.data, fitter.weight),
        )
        gained = on.cost(prediction, best.nuisance) - on.cost(refitted_prediction, refitted.nuisance)
        best, prediction = refitted, refitted_prediction
        if gained < MIN_ROUND_GAIN_NATS:
            break
    return (with_scatter(fitter, best) if best.misfit < HOPELESS_NOMINAL_MISFIT else fitter), best


def with_scatter(fitter: Fitter, fit: Fitted) -> Fitter:
    """The fitter with a tolerance for the simulator's own sensitivity: the scatter of predictions under random nuisance
    changes too small to matter."""
    if not fitter.size:
        return fitter
    alike = fitter.predictions(scatter.alike(Point.of(fit), fitter.predict.seed))
    return replace(fitter, data=step_tolerance.with_scatter(fitter.data, alike))


def with_unevenness(fitter: Fitter, fit: Fitted) -> Fitter:
    """The fitter that knows whether predictions scatter around an explanation."""
    if not fitter.size:
        return fitter
    alike = fitter.predictions(scatter.alike(Point.of(fit), fitter.predict.seed))
    return replace(fitter, uneven=scatter.is_uneven(scatter.of(Whitening(fitter.data, fitter.weight), alike)))


def acting_on_misfit(pool: Sequence[Candidate], data: Data, base: Array) -> list[Candidate]:
    """The pool without candidates on a single joint or load cell all of whose channels the nominal model predicts to
    within the noise."""
    known = np.isfinite(data.value).sum(axis=(0, 1))
    square = (likelihood.scaled(data, likelihood.residual(data, base)) ** 2).sum(axis=(0, 1)) / np.maximum(known, 1)
    quiet = (square < NOISE_ONLY_DISCREPANCY[0]) & (
        likelihood.lasting(data, data.value - base) < NOISE_ONLY_DISCREPANCY[1]
    )
    of: dict[str, list[bool]] = {}
    for channel, still in zip(data.channels, quiet, strict=True):
        of.setdefault(channel.partition(".")[2], []).append(bool(still))
    return [c for c in pool if c.target is None or not all(all(of.get(name, [False])) for name in c.target)]
