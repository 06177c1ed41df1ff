"""Grid scan of two parameters of an effect by simulation, nuisances integrated out.

It replaces gradients where the two are confounded or their likelihood has narrow peaks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitter, Point
from tiago_mj.gap.inference.remembered import remembered
from tiago_mj.gap.search.state import State


def likeliest(fitter: Fitter, points: Sequence[Point], count: int) -> list[int]:
    """Indices of the ``count`` points with the largest log likelihood, nuisances integrated out.

    Args:
        fitter: of the trials in which they are tried.
        points: all beside the same nuisances, around which these are integrated out.
        count: how many.
    """

    def work() -> list[int]:
        on = likelihood.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial, points[0].nuisance)
        found = likelihood.log_likelihood(on, fitter.predictions(points))
        return [int(k) for k in np.argsort(-found)[:count]]

    depends_on = ("scan", fitter.settings(), list(points), count)
    return remembered(fitter.predict, work, depends_on, fitter.out_of_time)


def likeliest_on_screening_trials(state: State, points: Sequence[Point], count: int) -> list[int]:
    """As :func:`likeliest`, on the screening trials; on all trials where those were not fitted."""
    screening, full = state.screening, state.full
    if not full.trials.holds(screening.trials):
        return likeliest(full, points, count)
    rows = full.trials.rows_of(screening.trials)
    return likeliest(screening, [replace(one, nuisance=full.of(rows, one.nuisance)) for one in points], count)
