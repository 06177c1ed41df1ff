"""Effects of the best explanation on each of their targets, with a magnitude of its own.

All joints of an arm have friction, and no two the same. Sought one by one, each would be a further effect. Along a
motion each further magnitude costs an evaluation of one torque. In a replay it costs the simulation of every trial, so
that it is tried only where one magnitude for all leaves a gap.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.hypotheses import GROUP, Candidate
from tiago_mj.gap.search import ranking, rounds
from tiago_mj.gap.search.state import State


def target(state: State, out_of_time: Callable[[], bool]) -> State:
    """The search with each effect of its best explanation on every target that needs it.

    Args:
        state: of the search.
        out_of_time: whether the user's time is over. The search's budget of physics steps is no limit: of a leg whose
            every joint rubs it is spent on single effects.
    """
    replays = state.full.predict.replays
    if replays and not ranking.leaves_a_gap(state.best, replays=True):
        return state
    full = replace(state.full, out_of_time=out_of_time)
    least = ranking.least_deviations(replays=replays)
    for effect in dict.fromkeys(part.effect for part in state.best.parts):
        start = _on_each(state.best, effect, state.pool)
        if start is None or out_of_time():
            continue
        state = state.with_fits(without_needless(full, full.fit_all([start])[0], least))
    return state


def without_needless(full: Fitter, fit: Fitted, least: float) -> list[Fitted]:
    """An explanation by what it needs: fitted without the effects that do not differ from none, the least first, until
    all do; itself where none does. What is needless is never told, and what is built on it is not either.

    One at a time: dry and viscous friction of one joint are each needless beside the other, and together needed.
    """
    while True:
        all_of_it = range(len(fit.parts))
        needless = [k for k in all_of_it if not ranking.differs_from_identity(fit, k, least)]
        if not needless or len(needless) == len(fit.parts):
            return [fit]
        least_of_all = min(needless, key=lambda k: abs(fit.values[k] - fit.parts[k].identity) / fit.deviations[k])
        fewer = rounds.reduced_to(fit, [k for k in all_of_it if k != least_of_all])
        if fewer is None:
            return [fit]
        (fit,) = full.fit_all([fewer])


def _on_each(best: Fitted, effect: str, pool: Sequence[Candidate]) -> Start | None:
    """A start with an effect of an explanation on each of its targets; None: there are too few of them."""
    mine = [k for k, part in enumerate(best.parts) if part.effect == effect]
    settings = {part.fixed for part in (best.parts[k] for k in mine)}
    each: dict[tuple[str, ...], Candidate] = {}
    for candidate in pool:
        if candidate.effect == effect and candidate.target is not None and candidate.fixed in settings:
            each.setdefault(candidate.target, candidate)
    if len(each) < GROUP or len(mine) >= len(each):
        return None
    rest = [k for k in range(len(best.parts)) if k not in mine]
    known = {best.parts[k].target: float(best.values[k]) for k in mine}
    values = [
        min(max(known.get(target, known.get(None, one.identity)), one.low), one.high) for target, one in each.items()
    ]
    parts = (*(best.parts[k] for k in rest), *each.values())
    return Start(parts, np.array([*best.values[rest], *values]), best.nuisance)
