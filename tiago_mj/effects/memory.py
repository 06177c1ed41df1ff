"""What effects remember: a delay line, a low-pass, a value that is held, a play."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: What comes later is the same, only later: what a delay changes differs by no more than this share. At the true delay
#: of six recordings whose gap is over 900 noise variances, 0.1 to 1.1 % of what it changes is left
#: (benchmarks/results/truth_audit.json).
SHIFTED: Final = 0.01


class DelayLine:
    """A signal as it was some seconds ago, with fractions of a control period by linear interpolation.

    Before the first sample the signal was ``before``, or the first sample where that is None.
    """

    def __init__(self, seconds: Array, before: Array | None = None) -> None:
        self._seconds = seconds
        self._before = before
        self._past: Array | None = None  # a ring, whose newest sample is at ...
        self._newest = 0
        self._period: Array | None = None
        self._whole = np.zeros(0, dtype=int)
        self._share = np.zeros(0)

    def __call__(self, value: Array, period: Array) -> Array:
        """Take the next sample, (nsim, n), and return the delayed one."""
        if self._period is None or not np.array_equal(period, self._period):  # periods hardly ever change
            self._look_back(value, period)
        past, share = self._past, self._share
        assert past is not None
        self._newest = (self._newest - 1) % len(past)
        past[self._newest] = value
        cells = np.arange(value.size).reshape(value.shape)
        newer, older = (
            past.take((self._whole + self._newest + more) % len(past) * value.size + cells) for more in (0, 1)
        )
        return (1 - share) * newer + share * older

    def _look_back(self, value: Array, period: Array) -> None:
        """How many samples ago, and the share of the one before, at this period."""
        with np.errstate(divide="ignore", invalid="ignore"):
            lag = np.where(period > 0, self._seconds / period, 0.0)
        if self._past is None:
            first = value if self._before is None else self._before
            self._past = np.repeat(np.asarray(first)[None], int(np.ceil(lag.max(initial=0.0))) + 2, axis=0)
        self._period = period.copy()
        self._whole = np.clip(np.floor(lag).astype(int), 0, len(self._past) - 2)
        self._share = np.clip(lag - self._whole, 0.0, 1.0)


class Conveyor:
    """A signal that is held over short steps, as it was some seconds ago.

    Args:
        seconds: how long ago, (nsim, n).
        before: what it was before the first step, (nsim, n).
    """

    def __init__(self, seconds: Array, before: Array) -> None:
        self._seconds = seconds
        self._before = before
        self._past: Array | None = None

    def __call__(self, values: Array, step: Array) -> Array:
        """Take the next steps, (nsim, m, n), each of a length, (nsim, 1) [s]; give the delayed signal's mean over
        each of them."""
        lag = self._seconds / step
        if self._past is None:
            length = int(np.ceil(1.5 * lag.max(initial=0.0))) + 2  # steps need not all be of one length
            self._past = np.repeat(self._before[:, None], length, axis=1)
        kept = self._past.shape[1]
        line = np.concatenate([self._past, values], axis=1)
        self._past = line[:, -kept:]
        whole = np.clip(np.floor(lag).astype(int), 0, kept - 1)
        share = np.clip(lag - whole, 0.0, 1.0)[:, None]
        newer = kept + np.arange(values.shape[1])[None, :, None] - whole[:, None]
        return (1 - share) * np.take_along_axis(line, newer, axis=1) + share * np.take_along_axis(
            line, newer - 1, axis=1
        )


class LowPass:
    """First-order lag of a sampled signal: time_constant · dy/dt = x - y, exact where x is straight between samples.

    Nothing was before the first sample, which passes as it is.
    """

    def __init__(self, time_constant: Array) -> None:
        self._time_constant = time_constant
        self._input: Array | None = None
        self._value = np.zeros(0)

    def __call__(self, value: Array, period: Array) -> Array:
        """Take the next sample, (nsim, n), and return the lagged one of the same instant."""
        if self._input is None:
            self._value = np.array(value)
        else:
            with np.errstate(divide="ignore"):
                decay = np.exp(-period / self._time_constant)
            behind = (value - self._input) / period * self._time_constant  # once the start is forgotten
            self._value = value - behind + (self._value - self._input + behind) * decay
        self._input = np.array(value)
        return self._value


class HeldLowPass:
    """First-order lag of a command that is held over each period: time_constant · dy/dt = x - y.

    It gives y's mean over the period, so that what follows, and holds it as long, is moved as far as y would move it.
    """

    def __init__(self, time_constant: Array, before: Array) -> None:
        self._time_constant = time_constant
        self._value = before
        self._period: Array | None = None
        self._missed = self._decay = np.zeros(0)

    def __call__(self, value: Array, period: Array) -> Array:
        """Take the next command, (nsim, n), and return the mean of the lagged one while it is held."""
        if period is not self._period:  # the exponentials are most of the work, and periods hardly ever change
            self._period = period
            with np.errstate(divide="ignore", invalid="ignore"):
                periods = period / self._time_constant
                self._missed = np.where(periods < np.inf, -np.expm1(-periods) / periods, 0.0)
            self._decay = np.exp(-periods)
        before = self._value - value
        self._value = value + before * self._decay
        return value + before * self._missed


class InARow:
    """One low-pass or two equal ones in a row, which are as late together as the one.

    Args:
        kind: :class:`LowPass` or :class:`HeldLowPass`.
        time_constant: of all together, (nsim, n) [s].
        poles: 1 or 2, (nsim, n).
        before: further arguments of the low-passes.
    """

    def __init__(
        self, kind: type[LowPass] | type[HeldLowPass], time_constant: Array, poles: Array, *before: Array
    ) -> None:
        self._two = poles > 1
        self._first = kind(np.where(self._two, time_constant / 2, time_constant), *before)
        self._second = kind(time_constant / 2, *before)

    def __call__(self, value: Array, period: Array) -> Array:
        """Take the next value, (nsim, n), and return what comes out."""
        once = self._first(value, period)
        return np.where(self._two, self._second(once, period), once) if self._two.any() else once


class Held:
    """A value that some updates never reach: the one before stays."""

    def __init__(self, before: Array | None = None) -> None:
        self._value = before

    def __call__(self, value: Array, lost: NDArray[np.bool_]) -> Array:
        """Take the next sample, (nsim, n), and return the one that arrived last."""
        self._value = np.array(value) if self._value is None else np.where(lost, self._value, value)
        return self._value


class Play:
    """The play (backlash) operator: the output moves only when the input pushes it at one side of the gap."""

    def __init__(self, width: Array, before: Array | None = None) -> None:
        self._half = width / 2
        self._value = before

    def __call__(self, value: Array) -> Array:
        """Take the next sample, (nsim, n), and return the output, which starts in the middle of the gap."""
        if self._value is None:
            self._value = np.array(value)
        self._value = np.clip(self._value, value - self._half, value + self._half)
        return self._value
