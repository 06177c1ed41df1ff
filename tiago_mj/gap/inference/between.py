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
NEGLIGIBLE_HALF_STEP: Final = 1e-3
#: Nearer to a prediction than this the working residual is a straight line [deviations].
NEAR_ZERO_RESIDUAL: Final = 1e-4
#: Range of step over deviation that is tabulated, and the number of points: linear interpolation in the logarithm is
#: then exact to 1e-4.
TABULATED_RATIOS: Final = (1e-2, 1e4, 400)
#: Half-width of the normal density that is integrated [deviations]: 1e-15 lies outside.
TAIL_DEVIATIONS: Final = 8.0
#: Points of each integral.
INTEGRATION_POINTS: Final = 4001
#: Rows of a window in which noise is looked for, and the lines that readings of a signal at rest may lie on in it: of
#: 16 normal deviates, which span 3.5 deviations, on a grid of two or more.
WINDOW_ROWS: Final = 16
MAX_GRID_LINES: Final = 3
#: Mean absolute difference of two normal deviates, in deviations: 2 / √π.
MEAN_NORMAL_DIFFERENCE: Final = 1.1283791670955126


def residual(difference: Array, sigma: Array, step: Array) -> Array:
    """Working residual of readings on a grid, in their unit.

    Args:
        difference: reading minus prediction, (...).
        sigma: deviation of all that is not the grid, of the same shape or one that fits it.
        step: of the grid; 0 where there is none.
    """
    out: Array = np.sign(difference) * _root_deviance(*_scaled(difference, sigma, step)) * sigma
    return out


def slope(difference: Array, sigma: Array, step: Array) -> Array:
    """Derivative of the working residual by the difference, from 0 to 1; arguments as of :func:`residual`."""
    r, half = _scaled(difference, sigma, step)
    r = np.maximum(r, NEAR_ZERO_RESIDUAL)  # at 0 both vanish
    root = _root_deviance(r, half)
    with np.errstate(divide="ignore", invalid="ignore"):
        out: Array = np.where(root > 0, np.clip(_score(r, half) / root, 0.0, 1.0), 0.0)
    return out


def score(difference: Array, sigma: Array, step: Array) -> Array:
    """The likelihood's slope −σ² ℓ'(r), in the reading's unit: at the truth its mean is 0 whatever the grid, and it is
    the difference itself without one; arguments as of :func:`residual`."""
    r, half = _scaled(difference, sigma, step)
    out: Array = np.sign(difference) * _score(r, half) * sigma
    return out


def relative_information(sigma: Array, step: Array) -> Array:
    """Fisher information of a rounded reading about the signal, relative to that of an unrounded one of the same
    deviation, averaged over where the signal lies between two lines of the grid."""
    ratio = np.maximum(step / sigma, TABULATED_RATIOS[0])
    # Beyond the table what readings around one line tell is spread over ever more that tell nothing.
    out: Array = np.interp(np.log(ratio), *_table()) * np.minimum(TABULATED_RATIOS[1] / ratio, 1.0)
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
        for begin in range(0, len(row) - WINDOW_ROWS + 1, WINDOW_ROWS):
            window = row[begin : begin + WINDOW_ROWS]
            if np.isfinite(window).all() and np.ptp(window) < (MAX_GRID_LINES - 0.5) * step:
                gone = float(np.abs(np.diff(window)).sum()) - abs(float(window[-1] - window[0]))
                shares.append(gone / (WINDOW_ROWS - 2))
    return float(np.mean(shares)) / MEAN_NORMAL_DIFFERENCE if shares else None


def _scaled(difference: Array, sigma: Array, step: Array) -> tuple[Array, Array]:
    """Size of the difference, and half the step of a shape that fits it, in deviations."""
    return np.nan_to_num(np.abs(difference) / sigma, nan=0.0, posinf=1e12), 0.5 * np.asarray(step) / sigma


def _log_likelihood(r: Array, half: Array) -> Array:
    """ℓ(r)."""
    upper, lower = log_ndtr(half - r), log_ndtr(-half - r)
    out: Array = upper + np.log1p(-np.exp(np.minimum(lower - upper, -1e-300)))
    return out


def _root_deviance(r: Array, half: Array) -> Array:
    """√(2 ℓ(0) − 2 ℓ(r)); r where the grid is fine."""
    with np.errstate(divide="ignore", invalid="ignore"):
        deviance = 2 * (_log_likelihood(np.zeros_like(half), half) - _log_likelihood(r, half))
    out: Array = np.where(half < NEGLIGIBLE_HALF_STEP, r, np.sqrt(np.maximum(deviance, 0.0)))
    return out


def _score(r: Array, half: Array) -> Array:
    """−ℓ'(r), from ratios of the densities at both ends of the interval to what it holds."""
    log = _log_likelihood(r, np.maximum(half, NEGLIGIBLE_HALF_STEP))
    near, far = (-0.5 * (r + way * half) ** 2 - 0.5 * np.log(2 * np.pi) - log for way in (-1, 1))
    out: Array = np.where(half < NEGLIGIBLE_HALF_STEP, r, np.exp(near) - np.exp(far))
    return out


@cache
def _table() -> tuple[Array, Array]:
    """Logarithms of steps over deviations, and what a reading tells at each."""
    ratios = np.geomspace(*TABULATED_RATIOS)
    told = []
    for ratio in ratios:  # around one of the two lines that bound the interval; the other is its mirror image
        r = np.linspace(max(ratio / 2 - TAIL_DEVIATIONS, 0.0), ratio / 2 + TAIL_DEVIATIONS, INTEGRATION_POINTS)
        half = np.full_like(r, ratio / 2)
        told.append(2 * np.trapezoid(_score(r, half) ** 2 * np.exp(_log_likelihood(r, half)), r) / ratio)
    return np.log(ratios), np.array(told)
