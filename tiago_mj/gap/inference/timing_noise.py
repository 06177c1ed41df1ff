"""Noise of positions that are read earlier or later than their stamps say, from the readings alone.

A reading that is made s seconds off its stamp is off by its slope times s, so that a fast joint is noisier than one at
rest. On robots that are driven by a program of a computer it is most of the noise: the root mean square of s is 0.3 ms
of a Dynamixel XL330 read every 5.3 ms, 0.9 ms of a Go2's joints at 200 Hz, 0.7 to 1.1 ms of an SO-101 at 50 Hz, 1.5 ms
of a Feetech STS3250 read every 20.5 ms (benchmarks/real).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]

#: Divided differences of these orders are compared: what two orders leave alike is white, and no motion.
ORDERS: Final = (4, 6)
ROWS: Final = max(ORDERS) + 1
#: The higher order has to leave this share of the variance that the lower one leaves at least. Of eight late channels
#: of four real robots it leaves 0.79 to 0.96; of ten hinges that are simulated in time at 25 Hz, where a motion bends
#: from row to row, 0 to 0.34.
WHITE: Final = 0.5
#: What lateness adds in fast motion is at least this share of the noise at rest, both typically and on average, one
#: standard deviation each: less raises the noise by a ninth at most. What rounding a smooth motion leaves over is
#: typically up to 1.0 of its step over √12, and 0.3 on average.
MATTERS: Final = 0.5
#: Fewest rows in fast motion that are believed: the variance is then known to a fifth.
FEWEST: Final = 50
#: Noise at rest is measured in this share of the rows, the slowest, with what lateness makes of these taken off, in
#: turns with the lateness: of a Go2 and an STS3250 the third turn changes neither by a thousandth.
SLOW: Final = 0.25
ROUNDS: Final = 3
#: Median of a squared standard normal number.
MEDIAN_SQUARE: Final = 0.4549364


@dataclass(frozen=True)
class Lateness:
    """By how much readings are early or late.

    Attributes:
        seconds: root mean square [s]; 0: they are in time.
        noise: one standard deviation of what is read at rest, apart from a grid.
    """

    seconds: float
    noise: float


def lateness(times: Sequence[Array], values: Sequence[Array], noise: float, step: float = 0.0) -> Lateness:
    """By how much readings are early or late, and their noise apart from that.

    Whether there is any is asked of the typical reading in fast motion, the median, which corners of a motion do not
    move, and of their mean square; how much there is, of the latter.

    Args:
        times: of every trial, (T,) [s].
        values: of every trial, (T,), NaN where nothing was read.
        noise: one standard deviation where readings are quietest, apart from a grid.
        step: of the grid that readings lie on; 0: none.

    Returns:
        0 s, and the noise as given, where readings show no lateness, and where it would be more than the period over
        √12, as of readings that are made at any time of their period: a coarse grid below other noise looks like that.
    """
    in_time = Lateness(0.0, noise)
    read = [_windows(time[known], value[known]) for time, value, known in _known(times, values)]
    if not read:
        return in_time
    period = float(np.median(np.concatenate([np.diff(time, axis=1).ravel() for time, _ in read])))
    slope = np.abs(np.concatenate([_slopes(time, value) for time, value in read]))
    fast = slope >= max(float(np.median(slope)), step / period)  # slower, the grid's error is smaller
    if fast.sum() < FEWEST or not slope[fast].all():
        return in_time
    lower, higher = (np.concatenate([_differences(time, value, order) for time, value in read]) for order in ORDERS)
    v, rounding = slope[fast], step**2 / 12

    def mean(own: float) -> float:
        """Variance of the time [s²], beside such a noise."""
        return float(np.sum(v**2 * (higher[fast] ** 2 - own**2 - rounding)) / np.sum(v**4))

    quiet = noise**2 + rounding
    typical = [_typical(one[fast], quiet, v, period) for one in (lower, higher)]
    enough = MATTERS**2 * quiet / float(np.mean(v**2))
    if typical[1] < WHITE * typical[0] or not enough <= min(typical[1], mean(noise)) or mean(noise) > period**2 / 12:
        return in_time
    if step:
        return Lateness(math.sqrt(mean(noise)), noise)
    slow = slope <= np.quantile(slope, SLOW)
    own = noise
    for _ in range(ROUNDS):  # where readings are quietest they are not in time either
        late = mean(own) * float(np.median(slope[slow] ** 2))
        own = min(math.sqrt(max(float(np.median(higher[slow] ** 2)) / MEDIAN_SQUARE - late, 0.0)), noise)
    return Lateness(math.sqrt(mean(own)), own)


def variance(time: Array, value: Array, seconds: float) -> Array:
    """Of readings that are so many seconds early or late, (T,): where nothing was read, as between its neighbours."""
    known = np.isfinite(value)
    if not seconds or known.sum() < ROWS:
        return np.zeros_like(value)
    times, values = _windows(time[known], value[known])
    return np.asarray(np.interp(time, times[:, ROWS // 2], (seconds * _slopes(times, values)) ** 2))


def _known(times: Sequence[Array], values: Sequence[Array]) -> list[tuple[Array, Array, NDArray[np.bool_]]]:
    """Trials with enough readings, and where they are."""
    known = [np.isfinite(value) for value in values]
    return [one for one in zip(times, values, known, strict=True) if one[2].sum() >= ROWS]


def _windows(time: Array, value: Array) -> tuple[Array, Array]:
    """Every run of :data:`ROWS` readings, (n, ROWS) each."""
    times, values = (np.lib.stride_tricks.sliding_window_view(one, ROWS) for one in (time, value))
    return times, values


def _slopes(times: Array, values: Array) -> Array:
    """Of the straight lines through runs of readings, (n,)."""
    centred = times - times.mean(axis=1, keepdims=True)
    out: Array = (centred * values).sum(axis=1) / np.square(centred).sum(axis=1)
    return out


def _differences(times: Array, values: Array, order: int) -> Array:
    """Divided differences of the middle of every run, (n,), scaled to what they make of white noise: its deviation. The
    stamps' own distances count, whether they are even or not."""
    inner = slice((ROWS - 1 - order) // 2, (ROWS + 1 + order) // 2)
    time, value = times[:, inner], values[:, inner]
    unit = np.median(np.diff(times))
    apart = (time[:, :, None] - time[:, None, :]) / unit
    apart[:, range(order + 1), range(order + 1)] = 1.0
    weight = 1 / np.prod(apart, axis=2)
    out: Array = (weight * value).sum(axis=1) / np.linalg.norm(weight, axis=1)
    return out


def _typical(left: Array, quiet: float, slope: Array, period: float) -> float:
    """Variance of the time [s²] with which half of the differences are below the median of their normal distribution;
    at most the period's square."""

    def surplus(variance: float) -> float:
        return float(np.median(left**2 / (quiet + variance * slope**2))) - MEDIAN_SQUARE

    if surplus(0.0) <= 0:
        return 0.0
    most = period**2
    return most if surplus(most) >= 0 else float(brentq(surplus, 0.0, most, rtol=1e-3, xtol=1e-6 * most))
