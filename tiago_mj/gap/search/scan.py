"""Two numbers of an effect tried together by simulation, with the nominal numbers integrated out.

Where one number hides the other, or their likelihood has narrow peaks, no slope leads from one pair to a better one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitter, Point
from tiago_mj.gap.search.state import State


def likeliest(fitter: Fitter, points: Sequence[Point], count: int) -> list[int]:
    """So many of the points, by index, the likeliest first.

    Args:
        fitter: of the trials in which they are tried.
        points: all beside the same nuisances, around which these are integrated out.
        count: how many.
    """
    on = likelihood.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial, points[0].nuisance)
    found = likelihood.log_likelihood(on, fitter.predictions(points))
    return [int(k) for k in np.argsort(-found)[:count]]


def likeliest_in_few(state: State, points: Sequence[Point], count: int) -> list[int]:
    """The same in the trials of the first pass, for points of all trials; in all where the first pass had others."""
    few, everywhere = state.few, state.everywhere
    if not set(few.trials) <= set(everywhere.trials):
        return likeliest(everywhere, points, count)
    rows = [everywhere.trials.index(trial) for trial in few.trials]
    return likeliest(few, [replace(one, nuisance=everywhere.of(rows, one.nuisance)) for one in points], count)
