"""Scatter of numbers of which a few may be wrong: the median absolute deviation, as a normal distribution's standard
deviation (SciPy's, 1.4826 times)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


def deviation(values: Array, *, about_zero: bool = False) -> float:
    """Robust standard deviation of normal numbers with a few outliers.

    Args:
        values: (n,), at least one.
        about_zero: whether they are known to lie about zero, as differences of noise do, and not about their median.
    """
    if about_zero:
        return float(stats.median_abs_deviation(values, center=_zero, scale="normal"))
    return float(stats.median_abs_deviation(values, scale="normal"))


def deviations(values: Array, axis: int) -> Array:
    """The same along an axis, each about its own median."""
    found: Array = stats.median_abs_deviation(values, axis=axis, scale="normal")
    return found


def _zero(values: Array, axis: int | None = None) -> float:
    return 0.0
