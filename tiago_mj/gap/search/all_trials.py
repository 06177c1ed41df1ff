"""What was found, fitted once more to every trial, and in how many of them each explanation gains.

A search fits to the trials in which the nominal model fails most: what happens to suit these few has to stand in the
others, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import MAX_ITERATIONS, Fitted, Fitter, Start
from tiago_mj.gap.search import additions, beginning, ranking, rounds, sharpen, starts
from tiago_mj.gap.search.state import Question, State

Array = NDArray[np.float64]

#: Explanations by effects that are fitted, the leaders of other classes and as many that are close, and Gauss-Newton
#: steps of each: they were fitted to some of the trials before. Chosen by hand; no ablation.
MAX_FITTED: Final = 3
ITERATIONS: Final = 2
#: Explanations that are fitted with the responses around themselves, the best and what is near it. Chosen by hand; no
#: ablation.
MAX_AROUND_THEMSELVES: Final = 3
#: Physics steps of all trials together at most, beyond those that were fitted anyway: eight grasps of six seconds have
#: 24 000; of trials of minutes each fit would cost many times more. Chosen by hand; no ablation.
MAX_STEPS: Final = 30_000


def fitted(state: State, wide: Fitter) -> tuple[State, Fitter]:
    """The search with its best explanations fitted to all trials, and no others but the nominal model; and ``wide``
    with the scatter of the simulation beside the best: what sticks and slips is more sensitive than the nominal model.

    Where commands were lost, it is not known which were in the trials that were not fitted: they stay out.

    Args:
        state: the search.
        wide: of all trials but those that were excluded, with floor and tolerance as they were assumed at first.
    """
    before, best = state.everywhere, state.best
    losing = before.predict.on.delivered is not None
    if set(wide.trials) == set(before.trials) or losing or wide.out_of_time():
        return state, wide
    everywhere = _linearized(before, wide, best)
    (there,) = everywhere.fit_all([_start(best, before, everywhere)])
    everywhere = beginning.with_scatter(everywhere, there)
    wide = replace(wide, data=everywhere.data)
    everywhere = sharpen.beside(everywhere, there)
    nominal = [starts.restart(state.nominal)] if best.parts else []
    begin = [starts.restart(there), *(_start(s, before, everywhere) for s in (*nominal, *_rivals(state)))]
    at = _own(state.at, before, everywhere)
    fits = everywhere.fit_all(begin)
    fits = ranking.unique_by_labels([*fits, *_around_themselves(everywhere, fits)])
    return replace(state, everywhere=everywhere, fits=tuple(fits), at=at), wide


def _around_themselves(everywhere: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Fits of what is near the best, each with the responses around itself.

    With those around the best, and its own far from there, a coupling that acted alone was 114 nats behind itself with
    a needless creep; with its own it is 11 behind (blind check's generator, seed 941, case 29).
    """
    ahead = ranking.by_evidence(fits)
    near = [f for f in ahead if f.evidence > ahead[0].evidence - rounds.HOPELESS_DEFICIT_NATS][:MAX_AROUND_THEMSELVES]
    if len(near) < 2 or everywhere.out_of_time():
        return []
    begin = [starts.restart(f) for f in near]
    longer = replace(everywhere, iterations=MAX_ITERATIONS)
    return everywhere.fit_each(longer.linearized_at_each([starts.point_of(s) for s in begin]), begin)


def wide(asked: Question, first: Fitter, excluded: Sequence[int]) -> Fitter:
    """The first fitter, of some trials, with all but those that are excluded, or of long ones as many as are worth it;
    its responses are left open.

    Args:
        asked: what is to be explained.
        first: with floor and tolerance as they were assumed at first.
        excluded: indices of trials.
    """
    others = [trial for trial in asked.trials if trial not in (*first.trials, *excluded)]
    more = max(MAX_STEPS // max(asked.steps, 1) - len(first.trials), 0)
    chosen = {*first.trials, *others[:more]} - set(excluded)
    trials = tuple(trial for trial in asked.trials if trial in chosen)
    data = noise_model.select_trials(asked.data, [asked.trials.index(trial) for trial in trials])
    rows = [k for k, trial in enumerate(first.trials) if trial in trials]
    known = [trials.index(first.trials[k]) for k in rows]
    data = noise_model.with_trials_replaced(data, known, noise_model.select_trials(first.data, rows))
    return replace(first, trials=trials, data=data, responses=np.zeros((len(first.terms), *data.value.shape)))


def _linearized(before: Fitter, wide: Fitter, best: Fitted) -> Fitter:
    """The fitter on all trials, with the responses of all nuisances around an explanation."""
    trials, empty = wide.trials, wide.responses
    known = [trials.index(trial) for trial in before.trials]
    everywhere = replace(wide, predict=before.predict, weight=before.weight, given=before.given, iterations=ITERATIONS)
    new = [k for k in range(len(trials)) if k not in known]
    start = _start(best, before, everywhere)
    some = everywhere.part(new)
    point = replace(starts.point_of(start), nuisance=everywhere.of(new, starts.point_of(start).nuisance))
    responses = empty.copy()
    responses[:, known] = before.responses
    responses[:, new] = some.linearized_at(point).responses
    return replace(everywhere, responses=responses)


def _rivals(state: State) -> list[Start]:
    """Explanations by effects that may turn out to be the best: the leaders by their classes, the best by fewer
    effects, the best without each of its own, and what is close to the best."""
    ahead, best = [f for f in ranking.unique_by_labels(state.fits) if f.parts], state.best
    fewer = [f for f in ahead if len(f.parts) < len(best.parts)][:1]
    near = [f for f in ahead if f.evidence > best.evidence - ranking.NEAR_BEST_NATS][:MAX_FITTED]
    found = ranking.unique_by_labels([*ranking.unique_by_classes(ahead)[:MAX_FITTED], *fewer, *near])
    kept = [[i for i in range(len(best.parts)) if i != k] for k in range(len(best.parts))]
    reduced = [s for s in (rounds.reduced_to(best, some) for some in kept) if s is not None]
    return additions.unique([*(starts.restart(f) for f in found if f is not best), *reduced])


def _start(fit: Fitted | Start, before: Fitter, everywhere: Fitter) -> Start:
    """Where a fit to some trials ended, on all of them."""
    at = starts.point_of(fit)
    return Start(at.parts, at.values, _own(at.nuisance, before, everywhere))


def _own(nuisance: Array, before: Fitter, everywhere: Fitter) -> Array:
    """Nuisances of some trials as those of all: of the trials that were not fitted their own are 0."""
    shared = len(before.shared)
    own = np.zeros((len(everywhere.trials), (everywhere.size - shared) // len(everywhere.trials)))
    for row, trial in zip(nuisance[shared:].reshape(len(before.trials), -1), before.trials, strict=True):
        own[everywhere.trials.index(trial)] = row
    return np.concatenate([nuisance[:shared], own.ravel()])
