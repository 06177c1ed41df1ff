"""Integrated autocorrelation time: how many samples of a correlated signal are worth one independent one.

    τ = 1 + 2 Σ ρ_k

over the lags of the initial positive sequence: lags are taken in pairs, (0, 1), (2, 3) ..., up to the first pair whose
sum is not above 0, beyond which an estimate is noise (C. J. Geyer, "Practical Markov chain Monte Carlo", Statistical
Science 7, 1992, section 3.3). ρ_k is the usual estimate, with products divided by the number of all samples, so that
long lags, of which there are few products, count for little.

All that needs it asks for it here. What differs is the signal: whose deviations, from which mean, and of several
signals whether they are pooled (one process that was interrupted), the median is taken (trials alike) or the longest
(the slowest joint decides how far parts must lie apart).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Array = NDArray[np.float64]

#: Fewer samples than this tell nothing of their correlation: they are taken for independent.
FEWEST: Final = 16


def integrated_time(deviations: Array | Sequence[Array]) -> float:
    """Integrated autocorrelation time [samples], at least 1.

    Args:
        deviations: of a signal from its mean, (T,), or of several parts of one process, between which nothing is known.
            NaN: not measured; a product of which a factor is not known is left out.
    """
    parts = [deviations] if isinstance(deviations, np.ndarray) else list(deviations)
    if sum(int(np.isfinite(part).sum()) for part in parts) < FEWEST:
        return 1.0
    correlation = _autocorrelation(parts)
    even = len(correlation) // 2 * 2
    pairs = correlation[:even].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    last = int(negative[0]) if negative.size else len(pairs)
    return max(2 * float(pairs[:last].sum()) - 1, 1.0)


def _autocorrelation(parts: Sequence[Array]) -> Array:
    """ρ of every lag, (longest part,); 0 throughout where nothing varies."""
    longest = max(len(part) for part in parts)
    products, known, all_pairs = np.zeros(longest), np.zeros(longest), np.zeros(longest)
    for part in parts:
        count = len(part)
        size = fft.next_fast_len(2 * count)
        there = np.isfinite(part)
        products[:count] += _with_itself(np.where(there, part, 0.0), size)
        all_pairs[:count] += count - np.arange(count)
        known[:count] += count - np.arange(count) if there.all() else np.round(_with_itself(there.astype(float), size))
    if products[0] <= 0:
        return np.zeros(longest)
    mean = np.divide(products, known, out=np.zeros(longest), where=known > 0)
    correlation: Array = mean / mean[0] * all_pairs / all_pairs[0]
    return correlation


def _with_itself(values: Array, size: int) -> Array:
    """Autocovariance sum: products of values, (T,), with those each lag later, (T,)."""
    products: Array = fft.irfft(np.abs(fft.rfft(values, size)) ** 2, size)[: len(values)]
    return products
