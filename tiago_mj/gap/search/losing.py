"""A search with the commands that were lost decoded, where that explains more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.search import lost_commands, ranking, rounds, starts
from tiago_mj.gap.search.screen import screen
from tiago_mj.gap.search.state import State


def with_lost_commands(state: State) -> State:
    """The search with lost commands decoded and simulated, where that gains evidence."""
    full, decoded = _decoded(state.full, state.losing, state.fits, state.motion)
    if not decoded:
        return state
    screening = replace(state.screening, predict=full.predict, weight=full.weight)
    promising = [*state.promising, *screen(screening, decoded, state.linearization_point).on_all]
    ahead = [f for f in ranking.unique_by_labels(state.fits) if f.parts][: rounds.MAX_ON_ALL_TRIALS]
    nominal = ranking.best_nominal(state.fits)
    lost = [Start((c,), np.array(c.grid[:1]), nominal.nuisance) for c in decoded]
    fits = full.fit_all([*(starts.restart(f) for f in (nominal, *ahead)), *lost])
    return replace(
        state,
        screening=screening,
        full=full,
        promising=tuple(sorted(promising, key=lambda s: -s.gain)),
        pool=(*state.pool, *decoded),
        fits=tuple(ranking.unique_by_labels(fits)),
    )


def _decoded(
    full: Fitter, candidates: Sequence[Candidate], fits: Sequence[Fitted], motion: ServoMotion | None
) -> tuple[Fitter, list[Candidate]]:
    """The search with decoded lost commands and candidates for them, beside the nominal model or the best explanation;
    unchanged where that leaves nothing to explain or is more likely without.

    Sample weights are raised where the residuals are less correlated with the losses.
    """
    best, nominal = ranking.by_evidence(fits)[0], ranking.best_nominal(fits)
    if motion is None or not candidates or ranking.is_adequate(best):
        return full, []
    for fit in (nominal, best) if best.parts else (nominal,):
        if full.out_of_time():
            break
        decoded = lost_commands.decoded_beside(full, Point.of(fit), motion, candidates)
        if decoded is None:
            continue
        losing = replace(full, predict=decoded.predict)
        prediction = losing.predictions([Point.of(decoded.fit)])[0]
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
    return full, []
