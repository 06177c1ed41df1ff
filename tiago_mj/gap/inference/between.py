"""Likelihood of readings that lie on a grid: a rounded reading only says between which two values the signal was.

A reading y on a grid of step s = 2 h, of a signal whose prediction μ errs by a normal deviate of deviation σ, has

    ℓ(r) = log [Φ((r + h) / σ) − Φ((r − h) / σ)],   r = y − μ.

The same holds, up to a constant, where the noise comes after the rounding and the readings lie on no grid any more: a
uniform and a normal error together have that density. Sums of squares take its place where the residual r is replaced
by the signed root of the deviance (McCullagh and Nelder 1989, section 2.4.3),

    working residual = sign(r) σ √(2 ℓ(0) − 2 ℓ(r)),

which is r without a grid, nearly 0 inside of a coarse grid's interval and nearly the distance to it outside.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

Array = NDArray[np.float64]

#: Half a step below this share of the deviation changes the likelihood by less than 2e-7 of the residual's square.
FINE: Final = 1e-3
#: Nearer to a prediction than this the working residual is a straight line [deviations].
NEAR: Final = 1e-4
#: Range of step over deviation that is tabulated, and the number of points: linear interpolation in the logarithm is
#: then exact to 1e-4.
RATIOS: Final = (1e-2, 1e4, 400)
#: Half-width of the normal density that is integrated [deviations]: 1e-15 lies outside.
TAILS: Final = 8.0
#: Points of each integral.
POINTS: Final = 4001
#: Rows of a window in which noise is looked for, and the lines that readings of a signal at rest may lie on in it: of
#: 16 normal deviates, which span 3.5 deviations, on a grid of two or more.
WINDOW: Final = 16
LINES: Final = 3
#: Mean absolute difference of two normal deviates, in deviations: 2 / √π.
APART: Final = 1.1283791670955126


def residual(difference: Array, sigma: Array, step: Array) -> Array:
    """Working residual of readings on a grid, in their unit.

    Args:
        difference: reading minus prediction, (...).
        sigma: deviation of all that is not the grid, of the same shape or one that fits it.
        step: of the grid; 0 where there is none.
    """
    out: Array = np.sign(difference) * _root(*_scaled(difference, sigma, step)) * sigma
    return out


def slope(difference: Array, sigma: Array, step: Array) -> Array:
    """Derivative of the working residual by the difference, from 0 to 1; arguments as of :func:`residual`."""
    r, half = _scaled(difference, sigma, step)
    r = np.maximum(r, NEAR)  # at 0 both vanish
    root = _root(r, half)
    with np.errstate(divide="ignore", invalid="ignore"):
        out: Array = np.where(root > 0, np.clip(_pull(r, half) / root, 0.0, 1.0), 0.0)
    return out


def pull(difference: Array, sigma: Array, step: Array) -> Array:
    """The likelihood's slope −σ² ℓ'(r), in the reading's unit: at the truth its mean is 0 whatever the grid, and it is
    the difference itself without one; arguments as of :func:`residual`."""
    r, half = _scaled(difference, sigma, step)
    out: Array = np.sign(difference) * _pull(r, half) * sigma
    return out


def relative_information(sigma: Array, step: Array) -> Array:
    """How much a reading tells of where the signal is (Fisher's information), relative to one of the same deviation
    that is not rounded, on average over where the signal lies between two lines."""
    ratio = np.maximum(step / sigma, RATIOS[0])
    # Beyond the table what readings around one line tell is spread over ever more that tell nothing.
    out: Array = np.interp(np.log(ratio), *_table()) * np.minimum(RATIOS[1] / ratio, 1.0)
    return np.where(step > 0, out, 1.0)


def noise(values: Array, step: float) -> float | None:
    """One standard deviation of what a sensor adds before its readings are rounded: 0 where no reading flickers, None
    where no window is at rest.

    Rounding leaves the mean absolute difference of two values as it is, on average over where they lie between two
    lines. So it is read off how far readings at rest go to and fro, less how far they get, over windows in which they
    keep to neighbouring lines.

    Args:
        values: (ntrials, T) on a grid; NaN where nothing was measured, or what was measured has no noise.
        step: of the grid.
    """
    shares = []
    for row in values:
        for begin in range(0, len(row) - WINDOW + 1, WINDOW):
            window = row[begin : begin + WINDOW]
            if np.isfinite(window).all() and np.ptp(window) < (LINES - 0.5) * step:
                gone = float(np.abs(np.diff(window)).sum()) - abs(float(window[-1] - window[0]))
                shares.append(gone / (WINDOW - 2))
    return float(np.mean(shares)) / APART if shares else None


def _scaled(difference: Array, sigma: Array, step: Array) -> tuple[Array, Array]:
    """Size of the difference and half the step, in deviations, of one shape."""
    r, half = np.broadcast_arrays(np.abs(difference) / sigma, 0.5 * step / sigma)
    return np.nan_to_num(r, nan=0.0, posinf=1e12), half


def _log(r: Array, half: Array) -> Array:
    """ℓ(r)."""
    upper, lower = log_ndtr(half - r), log_ndtr(-half - r)
    out: Array = upper + np.log1p(-np.exp(np.minimum(lower - upper, -1e-300)))
    return out


def _root(r: Array, half: Array) -> Array:
    """√(2 ℓ(0) − 2 ℓ(r)); r where the grid is fine."""
    with np.errstate(divide="ignore", invalid="ignore"):
        deviance = 2 * (_log(np.zeros_like(r), half) - _log(r, half))
    out: Array = np.where(half < FINE, r, np.sqrt(np.maximum(deviance, 0.0)))
    return out


def _pull(r: Array, half: Array) -> Array:
    """−ℓ'(r), from ratios of the densities at both ends of the interval to what it holds."""
    log = _log(r, np.maximum(half, FINE))
    near, far = (-0.5 * (r + way * half) ** 2 - 0.5 * np.log(2 * np.pi) - log for way in (-1, 1))
    out: Array = np.where(half < FINE, r, np.exp(near) - np.exp(far))
    return out


@cache
def _table() -> tuple[Array, Array]:
    """Logarithms of steps over deviations, and what a reading tells at each."""
    ratios = np.geomspace(*RATIOS)
    told = []
    for ratio in ratios:  # around one of the two lines that bound the interval; the other is its mirror image
        r = np.linspace(max(ratio / 2 - TAILS, 0.0), ratio / 2 + TAILS, POINTS)
        half = np.full_like(r, ratio / 2)
        told.append(2 * np.trapezoid(_pull(r, half) ** 2 * np.exp(_log(r, half)), r) / ratio)
    return np.log(ratios), np.array(told)
