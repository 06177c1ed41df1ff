"""Period at which a motor driver reads its set point, found by simulating a grid of periods and widths beside the best
explanation by one.

A driver that samples its set point at its own period, not when commands arrive, produces other steps of a dead band or
a quantization. The likelihood has no useful gradient in the period or the width, and the two are confounded, so both
are scanned together with the nominal numbers integrated out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.gap.detectors.set_points import PERIOD, has_driver
from tiago_mj.gap.inference.fit import Point
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.search import scan, starts
from tiago_mj.gap.search.ranking import by_evidence, labels_of
from tiago_mj.gap.search.rounds import HOPELESS_DEFICIT_NATS
from tiago_mj.gap.search.state import State

#: Periods that are tried first [s]: shorter than a physics step, and those of the usual control loops, 1 kHz to 25 Hz.
PERIODS: Final = (1e-4, 0.001, 0.002, 0.0025, 0.004, 0.005, 0.006, 0.008, 0.01, 0.0125, 0.016, 0.02, 0.025, 0.04)
#: Widths beside each of them, as shares of what was found beside another: 1 to 5 % off. Halved and doubled, none of
#: 16 answers about hinges changes (varied.json).
WIDTHS: Final = tuple(np.linspace(0.95, 1.05, 11).tolist())
#: Pairs that are tried on all trials, and shares of their periods and widths there. Halved and doubled, none of 48
#: answers about hinges changes (varied.json).
MAX_PAIRS: Final = 3
NEAR_PERIODS: Final = (0.97, 1.0, 1.03)
NEAR_WIDTHS: Final = tuple(np.linspace(0.992, 1.008, 9).tolist())
#: Widths around the best of those as fitted: a grid of 1.4 mm, 21 of whose lines a finger passes, is 180 nats
#: likelier at its true width than 0.06 % beside it, and there is no slope that leads there.
FINE_WIDTHS: Final = tuple(np.linspace(0.997, 1.003, 25).tolist())
#: An explanation by a driver is not looked at where it leaves more than so many times what the best leaves, beside
#: HOPELESS_DEFICIT_NATS. Of hinge 18 of seed 8801 a dead band left 91 000 nats and damping 8 500: a quarter of what a
#: search may simulate went into its periods, and the second effect was not sought for lack of it.
MAX_COST_RATIO: Final = 3.0


def tried(state: State) -> State:
    """The search with a grid of driver periods tried for the best explanation by a driver for which they were not yet;
    unchanged where none is.

    At a wrong period that may be far behind: of a dead band of 0.61 mm, read every 5 ms, one of 0.63 mm at 2.5 ms was
    138 nats behind friction (blind check, seed 3741, case 15).
    """
    full, ahead = state.full, by_evidence(state.fits)
    least = MAX_COST_RATIO * ahead[0].evidence - HOPELESS_DEFICIT_NATS
    driven = [
        fit
        for fit in ahead
        if any(map(has_driver, fit.parts)) and fit.evidence > least and labels_of(fit) not in state.periods_tried
    ]
    if not driven or full.out_of_time():
        return state
    which, point = next(k for k, part in enumerate(driven[0].parts) if has_driver(part)), Point.of(driven[0])
    point = replace(
        point, nuisance=np.zeros_like(point.nuisance)
    )  # above all the delay has absorbed what the period does

    def beside(there: Point, pairs: Iterable[tuple[float, float]]) -> list[Point]:
        return [_with(there, which, period, width) for period, width in pairs]

    pairs = [(period, point.values[which] * share) for period in (0.0, *PERIODS) for share in WIDTHS]
    first = [pairs[k] for k in scan.likeliest_on_screening_trials(state, beside(point, pairs), MAX_PAIRS)]
    step = full.predict.plant.max_timestep
    near = beside(
        point,
        sorted({(p * a, w * b) for p, w in first for a in (NEAR_PERIODS if p > step else (1.0,)) for b in NEAR_WIDTHS}),
    )
    found = [near[k] for k in scan.likeliest(full, near, MAX_PAIRS)]
    fits = full.fit_all([starts.start_at(one) for one in found])
    there = Point.of(by_evidence(fits)[0])
    period = dict(there.parts[which].fixed)[PERIOD]
    fine = beside(there, [(period, there.values[which] * share) for share in FINE_WIDTHS])
    begin = [starts.start_at(fine[k]) for k in scan.likeliest(full, fine, MAX_PAIRS)]
    state = replace(state, periods_tried=state.periods_tried | {labels_of(driven[0])})
    return state.with_fits([*fits, *full.fit_all(begin)])


def _with(point: Point, which: int, period: float, width: float) -> Point:
    """The explanation with another period of the driver [s] and another width of its dead band or quantization."""
    part, values = point.parts[which], point.values.copy()
    values[which] = min(max(width, part.low), part.high)
    parts = tuple(with_period(part, period) if k == which else one for k, one in enumerate(point.parts))
    return Point(parts, values, point.nuisance)


def with_period(candidate: Candidate, period: float) -> Candidate:
    """The candidate with another period of the driver [s]."""
    fixed = tuple((name, float(f"{period:.4g}") if name == PERIOD else value) for name, value in candidate.fixed)
    return replace(candidate, fixed=fixed)
