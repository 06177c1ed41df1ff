"""90 % intervals of what was fitted: moving-block bootstrap, widened by what the nominal model leaves open."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tiago_mj.gap.torque.evidence import Evidence
from tiago_mj.gap.torque.normal import Normal, Rows
from tiago_mj.gap.torque.search import Scored, Search

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

DRAWS: Final = 400
LEVEL: Final = 0.90
#: Segments of the bootstrap, in correlation times of the residual.
SEGMENT: Final = 2.0
#: Rise of -2 log likelihood at the end of a 90 % interval of one parameter.
PROFILE: Final = 2.71


def segments(evidence: Evidence, blocks: tuple[int, ...]) -> Ints:
    """Number of the segment of every row, -1 outside the blocks, (T,)."""
    length = max(int(SEGMENT * float(np.median(evidence.floor.correlation)) * evidence.course.rate), 1)
    of, number = np.full(len(evidence.blocks.of), -1), 0
    for block in blocks:
        rows = np.flatnonzero(evidence.blocks.of == block)
        for piece in np.array_split(rows, max(1, round(len(rows) / length))):
            if evidence.moving[piece].any():
                of[piece] = number
                number += 1
    return of


def strengths(evidence: Evidence, found: Scored, seed: int) -> dict[int, tuple[float, float]]:
    """(low, high) of every strength of an explanation."""
    if not found.terms:
        return {}
    e = evidence
    e.refresh(found.strengths, found.terms)
    rows = Rows(e.moving, segments(e, e.blocks.fitted), e.rows.weight)
    active = [*found.terms, *e.tolerance]
    n = e.normal
    columns = [e.column(k) for k in (*found.terms, *e.given)] + e.tolerance_columns
    part = Normal(rows, e.measured - e.nominal, columns, n.precision[active], n.low[active], n.high[active])
    count, chosen = len(rows.blocks), np.arange(len(active))
    drawn = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), size=DRAWS)
    fits = np.stack(
        [
            part.solve(np.tensordot(times, part.gram, axes=1), times @ part.right, chosen)[: len(found.terms)]
            for times in drawn.astype(float)
        ]
    )
    whole = part.gram.sum(axis=0)
    open_ = np.diag(np.linalg.pinv(whole + np.diag(part.precision), hermitian=True))[: len(found.terms)]
    closed = np.diag(np.linalg.pinv(whole[: len(found.terms), : len(found.terms)], hermitian=True))
    spread = np.sqrt(fits.var(axis=0, ddof=1) + np.maximum(open_ - closed, 0.0))
    half = stats.t.ppf(0.5 + LEVEL / 2, max(count - 1, 1)) * spread
    intervals = {}
    for i, k in enumerate(found.terms):
        value, term = found.strengths[k], e.terms[k]
        intervals[k] = float(max(value - half[i], term.low)), float(min(value + half[i], term.high))
    return intervals


def shapes(search: Search, found: Scored) -> dict[int, dict[str, tuple[float, float] | None]]:
    """(low, high) of every shape parameter: the values on its grid that fit as well; None where all do."""
    e = search.evidence
    intervals: dict[int, dict[str, tuple[float, float] | None]] = {}
    for k in found.terms:
        for name, value in e.terms[k].shape:
            rivals = [i for i, t in enumerate(e.terms) if t.key == e.terms[k].key]
            rest = [i for i in found.terms if i != k]
            scores = np.array([e.normal.criterion([*rest, i, *e.tolerance], e.fitted) for i in rivals])
            as_good = [
                dict(e.terms[i].shape)[name] for i, s in zip(rivals, scores, strict=True) if s < scores.min() + PROFILE
            ]
            grid = sorted(dict(e.terms[i].shape)[name] for i in rivals)
            ends = _between(grid, min([*as_good, value]), max([*as_good, value]))
            intervals.setdefault(k, {})[name] = ends if len(as_good) < len(rivals) else None
    return intervals


def _between(grid: list[float], low: float, high: float) -> tuple[float, float]:
    """Widen an interval on a grid by half a step at each end."""
    i, j = grid.index(low), grid.index(high)
    below = (grid[i - 1] + low) / 2 if i else low
    above = (grid[j + 1] + high) / 2 if j + 1 < len(grid) else high
    return below, above
