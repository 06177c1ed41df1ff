"""Scores with 90 % intervals: Wilson intervals for shares, the bootstrap for everything else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A normal variable is within so many deviations in 90 % of cases.
NINETY: Final = 1.6449
DRAWS: Final = 2000
#: A probability of 0 costs no more than this one: the log loss of one case is limited.
MIN_PROBABILITY: Final = 1e-4


def share(hits: Sequence[bool]) -> dict[str, Any]:
    """A share of yes, with Wilson's interval; empty: null."""
    n = len(hits)
    if n == 0:
        return {"value": None, "low": None, "high": None, "n": 0}
    p = sum(hits) / n
    z2 = NINETY**2
    middle = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = NINETY * np.sqrt(p * (1 - p) / n + z2 / (4 * n * n)) / (1 + z2 / n)
    return {"value": p, "low": max(float(middle - half), 0.0), "high": min(float(middle + half), 1.0), "n": n}


def statistic(rows: Sequence[Any], of: Callable[[Array], float], seed: int = 0) -> dict[str, Any]:
    """A statistic of rows, with the bootstrap's percentile interval; empty: null."""
    n = len(rows)
    if n == 0:
        return {"value": None, "low": None, "high": None, "n": 0}
    table = np.asarray(rows, dtype=np.float64)
    rng = np.random.default_rng(seed)
    drawn = [of(table[rng.integers(n, size=n)]) for _ in range(DRAWS if n > 1 else 1)]
    low, high = np.quantile(drawn, [0.05, 0.95])
    return {"value": float(of(table)), "low": float(low), "high": float(high), "n": n}


def calibration_error(rows: Array, bins: int = 10) -> float:
    """Expected calibration error: rows of (probability, 0 or 1), in bins of equal width."""
    which = np.minimum((rows[:, 0] * bins).astype(int), bins - 1)
    total = 0.0
    for k in range(bins):
        inside = rows[which == k]
        if len(inside):
            total += len(inside) / len(rows) * abs(inside[:, 0].mean() - inside[:, 1].mean())
    return float(total)


def brier(rows: Array) -> float:
    """Mean squared error of rows of (probability, 0 or 1)."""
    return float(np.mean((rows[:, 0] - rows[:, 1]) ** 2))


def log_loss(rows: Array) -> float:
    """Mean of −log of what was said of what was the case, of rows of (probability, 0 or 1) [nats]."""
    said = np.where(rows[:, 1] > 0, rows[:, 0], 1 - rows[:, 0])
    return float(-np.log(np.maximum(said, MIN_PROBABILITY)).mean())


def gain_over_constant(rows: Array, loss: Callable[[Array], float]) -> float:
    """How much lower a loss is than with the best constant for the same rows: the share that was right."""
    constant = np.column_stack([np.full(len(rows), rows[:, 1].mean()), rows[:, 1]])
    return loss(constant) - loss(rows)


def reliability(rows: Array, bins: int = 5) -> list[tuple[float, float, int]]:
    """Mean probability, share that was right, and number, of bins of as many rows each."""
    ordered = rows[np.argsort(rows[:, 0], kind="stable")]
    return [
        (float(part[:, 0].mean()), float(part[:, 1].mean()), len(part))
        for part in np.array_split(ordered, bins)
        if len(part)
    ]


def spiegelhalter(rows: Array) -> float | None:
    """Two-sided p of calibrated probabilities (Spiegelhalter 1986); None where nothing can be said."""
    from scipy.stats import norm

    p, y = rows[:, 0], rows[:, 1]
    spread = float(np.sum((1 - 2 * p) ** 2 * p * (1 - p)))
    if spread <= 0:
        return None
    z = float(np.sum((y - p) * (1 - 2 * p))) / np.sqrt(spread)
    return float(2 * norm.sf(abs(z)))
