"""Robust statistics of one channel: noise, quantization step, runs; insensitive to a few outliers."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.recordings import robust
from tiago_mj.recordings.recording import Array

#: A lattice needs so many distinct values; that as many random ones lie on one by chance is below 1e-5.
_LATTICE_VALUES: Final = 6
#: Distance of a value from the lattice, in steps, that counts as on it, and the share that must lie there.
_LATTICE_SLACK, _LATTICE_SHARE = 0.05, 0.99
#: Distinct values per sample above which values do not repeat, so that nothing was rounded.
_LATTICE_REPEATS: Final = 0.6
#: Steps in the range above which rounding does not matter: below a twenty-thousandth of what the channel does.
_LATTICE_FINE: Final = 20_000


def noise(values: Array) -> float:
    """Standard deviation of the white noise on a smooth signal, from second differences.

    Args:
        values: (n,) without gaps.
    """
    if len(values) < 4:
        return 0.0
    return robust.deviation(np.diff(values, 2), about_zero=True) / float(np.sqrt(6))


def quantum(values: Array) -> float | None:
    """Step of which all values are multiples; None where there is none that matters.

    Args:
        values: (n,), in any order.
    """
    distinct = np.unique(values)
    span = float(np.ptp(distinct)) if len(distinct) else 0.0
    if span == 0.0:
        return None
    distinct = distinct[np.append(True, np.diff(distinct) > 1e-7 * span)]  # rounding of the file
    if len(distinct) < _LATTICE_VALUES or len(distinct) > _LATTICE_REPEATS * len(values):
        return None
    offset = distinct - distinct[0]
    step = float(np.diff(distinct).min())
    for _ in range(2):
        index = np.round(offset / step)
        step = float(index @ offset / (index @ index))
    on = np.abs(offset - np.round(offset / step) * step) <= _LATTICE_SLACK * step
    if on.mean() < _LATTICE_SHARE or span / step > _LATTICE_FINE:
        return None
    return step


def runs(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First index and length of every run of identical values, each (m,)."""
    change = np.flatnonzero(np.append(True, values[1:] != values[:-1]))
    return change, np.diff(np.append(change, len(values)))


def correlation(a: Array, b: Array) -> float:
    """Cosine similarity of two signals; 0 where one of them is zero."""
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / scale if scale > 0 else 0.0


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
