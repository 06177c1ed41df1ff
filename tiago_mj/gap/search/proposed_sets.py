"""Sets of effects that were found elsewhere, fitted to the replay of commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tiago_mj.gap.inference import placing
from tiago_mj.gap.inference.fit import Fitted, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Label
from tiago_mj.gap.search import on_each, ranking, together
from tiago_mj.gap.search.state import State


def fitted(sets: Callable[[], Sequence[Fitted]], pool: Sequence[Candidate], state: State) -> list[Fitted]:
    """Explanations of all trials that begin at such sets, without what is needless in them, where they are worth it.

    Args:
        sets: explanations of something else, of the same robot.
        pool: candidates.
        state: of the search.
    """
    full, known = state.full, {candidate.label: candidate for candidate in reversed(pool)}
    begin = [start for one in sets() if (start := _start(one, known, state)) is not None]
    least = ranking.least_deviations(replays=True)
    needed = [one for fit in full.fit_all(begin) for one in on_each.without_needless(full, fit, least)]
    return together.worth_it(state, needed)


def _start(found: Fitted, known: dict[Label, Candidate], state: State) -> Start | None:
    """A start with the effects of an explanation, at their magnitudes and places; None where the pool lacks one."""
    if any(part.label not in known for part in found.parts):
        return None
    parts, values = [], []
    for part, value in zip(found.parts, found.values, strict=True):
        own = known[part.label]
        names = {detail.name for detail in placing.details(part.effect)}
        place = tuple(one for one in part.fixed if one[0] in names)
        parts.append(replace(own, fixed=(*placing.without_place(own).fixed, *place)))
        values.append(min(max(float(value), own.low), own.high))
    return Start(tuple(parts), np.array(values), state.nominal_nuisance)
