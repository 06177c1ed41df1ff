"""How often a driver looks at its set point, tried by simulation beside the best explanation.

A driver that looks at other instants than commands arrive makes other steps of a dead band or a grid. There is no slope
to follow, neither of the period nor of the width, and one hides the other: both are tried together, with the nominal
numbers integrated out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.detectors.set_points import PERIOD
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitter, Point
from tiago_mj.gap.search import starts
from tiago_mj.gap.search.state import State

Array = NDArray[np.float64]

#: Periods that are tried first [s]: those of the usual control loops, 1 kHz to 25 Hz; 0: at every command.
PERIODS: Final = (0.0, 0.001, 0.002, 0.0025, 0.004, 0.005, 0.006, 0.008, 0.01, 0.0125, 0.016, 0.02, 0.025, 0.04)
#: Widths beside each of them, as shares of what was found beside another: 1 to 5 % off. Chosen by hand; no ablation.
WIDTHS: Final = tuple(np.linspace(0.95, 1.05, 11).tolist())
#: Pairs that are tried on all trials, and shares of their periods and widths there. Chosen by hand; no ablation.
MAX_PAIRS: Final = 3
NEAR_PERIODS: Final = (0.97, 1.0, 1.03)
NEAR_WIDTHS: Final = tuple(np.linspace(0.992, 1.008, 9).tolist())


def tried(state: State) -> State:
    """The search with the period of a driver that is part of its best explanation tried at several values."""
    best, few, everywhere = state.best, state.few, state.everywhere
    mine = [k for k, part in enumerate(best.parts) if PERIOD in dict(part.fixed)]
    if not mine or everywhere.out_of_time():
        return state
    which, at = mine[0], starts.point_of(best)
    at = replace(at, nuisance=np.zeros_like(at.nuisance))  # above all the delay has absorbed what the period does
    if set(few.trials) <= set(everywhere.trials):
        rows = [everywhere.trials.index(trial) for trial in few.trials]
        here = replace(at, nuisance=everywhere.of(rows, at.nuisance))
    else:
        few, here = everywhere, at
    pairs = [(period, at.values[which] * share) for period in PERIODS for share in WIDTHS]
    first = [pairs[k] for k in _ranked(few, here, which, pairs)[:MAX_PAIRS]]
    near = sorted({(p * a, w * b) for p, w in first for a in (NEAR_PERIODS if p else (1.0,)) for b in NEAR_WIDTHS})
    found = [near[k] for k in _ranked(everywhere, at, which, near)[:MAX_PAIRS]]
    points = [_with(at, which, period, width) for period, width in found]
    return state.with_fits(everywhere.fit_all([starts.start_at(one) for one in points]))


def _ranked(fitter: Fitter, at: Point, which: int, pairs: Sequence[tuple[float, float]]) -> list[int]:
    """Pairs of a period and a width, by index, the likeliest first."""
    on = likelihood.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial, at.nuisance)
    predicted = fitter.predictions([_with(at, which, period, width) for period, width in pairs])
    return [int(k) for k in np.argsort(-likelihood.log_likelihood(on, predicted))]


def _with(at: Point, which: int, period: float, width: float) -> Point:
    """An explanation whose driver looks every so many seconds, and passes on what moved by the width."""
    part, values = at.parts[which], at.values.copy()
    values[which] = min(max(width, part.low), part.high)
    fixed = tuple((name, float(f"{period:.4g}") if name == PERIOD else value) for name, value in part.fixed)
    parts = tuple(replace(part, fixed=fixed) if k == which else one for k, one in enumerate(at.parts))
    return Point(parts, values, at.nuisance)
