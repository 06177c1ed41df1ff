"""Quantization step of readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def grid_step(values: NDArray[np.float64], least: int = 3) -> float:
    """Largest step of which all values are multiples; 0 if there is none, or it is finer than a ten-thousandth of their
    range.

    Args:
        values: in any order, without gaps.
        least: number of different values that make a grid.
    """
    levels = np.unique(values)
    if len(levels) > 1:  # what a file's own rounding parts is one level
        levels = levels[np.append(True, np.diff(levels) > 1e-7 * float(levels[-1] - levels[0]))]
    if len(levels) < max(least, 2) or len(levels) > 0.5 * len(values):
        return 0.0
    gaps = np.diff(levels)
    step = float(gaps.min())
    if step <= 1e-4 * float(levels[-1] - levels[0]):
        return 0.0
    multiples = gaps / step
    return step if float(np.abs(multiples - np.round(multiples)).max()) < 1e-3 else 0.0
