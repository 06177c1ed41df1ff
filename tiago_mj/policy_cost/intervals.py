"""Means of paired differences over episodes and drawn magnitudes, with intervals that hold both uncertainties."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

Array = NDArray[np.float64]

#: Of every interval.
LEVEL: Final = 0.95
#: Half a pair in each of the four cells of a table of paired successes (Agresti and Min 2005).
PSEUDO_PAIRS: Final = 2.0
#: Standard deviations from the outermost mean within which an end is looked for: Student's t of one degree of freedom
#: has 1 % beyond 32.
FAR: Final = 1e3


@dataclass(frozen=True)
class Interval:
    """A mean and its 95 % interval; the ends are None where one episode tells nothing of its spread."""

    mean: float
    low: float | None
    high: float | None

    @property
    def above_zero(self) -> bool:
        """Whether the whole interval is."""
        return self.low is not None and self.low > 0

    @property
    def below_zero(self) -> bool:
        """Whether the whole interval is."""
        return self.high is not None and self.high < 0


def of_returns(values: Array) -> Interval:
    """Mean of values that differ by episode, and by what magnitudes the simulator has.

    The values of one draw of the magnitudes are a sample of episodes, whose mean has Student's t distribution. Which
    draw is the robot's is not known: the interval is of the mixture of all draws' distributions, each as probable.

    Args:
        values: (draws, episodes), the same episodes in each draw.
    """
    count = values.shape[1]
    means = values.mean(axis=1)
    if count < 2:
        return Interval(float(means.mean()), None, None)
    errors = values.std(axis=1, ddof=1) / math.sqrt(count)
    return _mixture(means, errors, float(count - 1))


def of_successes(before: Array, after: Array) -> Interval:
    """Difference of the shares of successes of the same episodes, ``before`` less ``after``.

    For each draw Wald's interval with half a pair more in each cell (Agresti and Min 2005), which does not vanish where
    all pairs agree; over the draws as in :func:`of_returns`.

    Args:
        before, after: 0 or 1, (draws, episodes).
    """
    count = before.shape[1] + PSEUDO_PAIRS
    lost = (before > after).sum(axis=1) + PSEUDO_PAIRS / 4
    won = (after > before).sum(axis=1) + PSEUDO_PAIRS / 4
    means = (lost - won) / count
    errors = np.sqrt((lost + won) - (lost - won) ** 2 / count) / count
    found = _mixture(means, errors, math.inf)
    assert found.low is not None
    assert found.high is not None
    return Interval(float((before - after).mean()), max(found.low, -1.0), min(found.high, 1.0))


def _mixture(means: Array, errors: Array, freedom: float) -> Interval:
    """Mean, and the quantiles of equally weighted t distributions; where an error is 0, of a step."""
    tail = (1 - LEVEL) / 2
    certain = errors <= 1e-12 * (1.0 + np.abs(means))  # the rounding of sums of equal values
    widths = np.where(certain, 1.0, errors)

    def below(x: float) -> float:
        smooth = stats.t.cdf((x - means) / widths, freedom)
        return float(np.where(certain, x >= means, smooth).mean())

    reach = FAR * np.where(certain, 0.0, errors) + 1e-9 * (1.0 + np.abs(means))
    outer = float((means - reach).min()), float((means + reach).max())
    ends = [float(optimize.bisect(lambda x, p=p: below(x) - p, *outer, xtol=1e-12)) for p in (tail, 1 - tail)]
    if certain.all() and np.ptp(means) == 0:
        ends = [float(means[0])] * 2
    return Interval(float(means.mean()), ends[0], ends[1])
