"""Weighted least squares by blocks: normal equations are summed, so that leaving a block out costs nothing.

Every explanation is a subset of one set of columns. Columns of the nominal model's own uncertainty (nuisance) are in
every fit, each in units of its standard deviation, with a standard normal prior. Strengths stay inside their bounds:
where the least squares without them lie outside, :func:`scipy.optimize.lsq_linear` finds the optimum within.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

#: Added to the diagonal of the normal equations, which is 1: it decides between columns that are the same, and is far
#: below any prior.
RIDGE: Final = 1e-9
#: Steps of the active-set method per variable; each frees or holds one. SciPy's default, one, is too few where many
#: bounds hold.
STEPS: Final = 20


@dataclass(frozen=True)
class Rows:
    """Which samples count, how much, and to which block they belong.

    Attributes:
        used: (T, c), samples that count.
        block: (T,), -1 for none.
        weight: (c,) of a squared residual: effective samples per sample over its variance.
    """

    used: NDArray[np.bool_]
    block: Ints
    weight: Array

    @property
    def blocks(self) -> Ints:
        """Numbers of the blocks."""
        return np.unique(self.block[self.block >= 0])

    def flat(self, values: Array) -> Array:
        """Values (T, c) that count, weighted, (R,)."""
        return (values * np.sqrt(self.weight))[self._there]

    @property
    def of(self) -> Ints:
        """Block of every sample that counts, (R,)."""
        return np.broadcast_to(self.block[:, None], self.used.shape)[self._there]

    @property
    def _there(self) -> NDArray[np.bool_]:
        return self.used & (self.block >= 0)[:, None]


class Normal:
    """Normal equations of a gap over columns, block by block.

    Args:
        rows: samples.
        gap: (T, c), what is to be explained.
        columns: each (T, c).
        precision: of each column's zero-mean prior, (K,); 0: none.
        low, high: bounds of each strength, (K,).
        check: called between blocks; what it raises ends the work.
    """

    def __init__(
        self,
        rows: Rows,
        gap: Array,
        columns: Sequence[Array],
        precision: Array,
        low: Array,
        high: Array,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        self.rows, self.precision, self.low, self.high = rows, precision, low, high
        order = np.argsort(rows.of, kind="stable")
        edges = np.searchsorted(rows.of[order], [*rows.blocks, np.inf])
        self._order = order
        self._slices = [slice(int(i), int(j)) for i, j in itertools.pairwise(edges)]
        self._target = rows.flat(gap)[order]
        self._matrix = np.stack([rows.flat(c)[order] for c in columns])
        self.square = np.array([self._target[s] @ self._target[s] for s in self._slices])
        products = []
        for s in self._slices:
            check()
            products.append(self._matrix[:, s] @ self._matrix[:, s].T)
        self.gram = np.stack(products)
        self.right = np.stack([self._matrix[:, s] @ self._target[s] for s in self._slices])

    def renew(self, index: int, column: Array) -> None:
        """Replace a column."""
        new = self.rows.flat(column)[self._order]
        if np.array_equal(new, self._matrix[index]):
            return
        self._matrix[index] = new
        for b, s in enumerate(self._slices):
            products = self._matrix[:, s] @ new[s]
            self.gram[b, index], self.gram[b, :, index] = products, products
            self.right[b, index] = new[s] @ self._target[s]

    def fit(self, active: Sequence[int], blocks: Sequence[int] | Ints, *, bounded: bool = True) -> Array:
        """Strengths of the active columns, (n,), from these blocks (positions, not numbers)."""
        chosen = np.asarray(active, dtype=int)
        gram, right = self.gram[blocks].sum(axis=0), self.right[blocks].sum(axis=0)
        return self.solve(gram[np.ix_(chosen, chosen)], right[chosen], chosen, bounded=bounded)

    def solve(self, gram: Array, right: Array, chosen: Ints, *, bounded: bool = True) -> Array:
        """Minimum of the penalized misfit over the chosen columns, (n,), within their bounds unless not ``bounded``.

        Args:
            gram: products of the chosen columns, (n, n).
            right: their products with the gap, (n,).
            chosen: indices of the columns, (n,), for their priors and bounds.
        """
        full = gram + np.diag(self.precision[chosen])
        scale = np.sqrt(np.maximum(np.diag(full), 1e-300))
        full, right = full / np.outer(scale, scale) + RIDGE * np.eye(len(chosen)), right / scale
        values: Array = np.linalg.solve(full, right)
        if bounded:
            low, high = self.low[chosen] * scale, self.high[chosen] * scale
            if ((values < low) | (values > high)).any():
                values = within(full, right, low, high)
        return values / scale

    def misfit(self, active: Sequence[int], strengths: Array) -> Array:
        """Weighted squared residual of every block, (B,)."""
        chosen = np.asarray(active, dtype=int)
        gram = self.gram[:, chosen[:, None], chosen]
        cross = self.right[:, chosen] @ strengths
        return self.square - 2 * cross + np.einsum("i,bij,j->b", strengths, gram, strengths)

    def criterion(self, active: Sequence[int], blocks: Sequence[int] | Ints) -> float:
        """Misfit and prior at the best strengths: -2 log posterior up to a constant."""
        strengths = self.fit(active, blocks)
        prior = float(self.precision[np.asarray(active, dtype=int)] @ strengths**2)
        return float(self.misfit(active, strengths)[blocks].sum()) + prior

    def left_out(self, active: Sequence[int], blocks: Sequence[int] | Ints) -> Array:
        """Misfit of each block under the strengths that the other blocks give, (len(blocks),)."""
        scores = []
        for b in blocks:
            others = [k for k in blocks if k != b]
            scores.append(self.misfit(active, self.fit(active, others))[b])
        return np.array(scores)

    def residual(self, active: Sequence[int], strengths: Array) -> Array:
        """Weighted residual of every sample, (R,), in the order of the rows."""
        values = np.empty_like(self._target)
        values[self._order] = self._target - strengths @ self._matrix[np.asarray(active, dtype=int)]
        return values

    def gains(self, active: Sequence[int], blocks: Sequence[int] | Ints) -> Array:
        """Drop of the misfit that each column alone would bring beside the active ones, (K,)."""
        chosen = np.asarray(active, dtype=int)
        gram, right = self.gram[blocks].sum(axis=0), self.right[blocks].sum(axis=0)
        strengths = self.fit(active, blocks)
        score = right - gram[:, chosen] @ strengths
        inner = gram[np.ix_(chosen, chosen)] + np.diag(self.precision[chosen])
        inner += 1e-9 * np.diag(np.diag(inner) + 1e-300)
        own = np.diag(gram) - np.einsum("ki,ik->k", gram[:, chosen], np.linalg.solve(inner, gram[chosen]))
        return np.where(own > 1e-6 * np.diag(gram), score**2 / np.maximum(own, 1e-300), 0.0)


def within(gram: Array, right: Array, low: Array, high: Array) -> Array:
    """Minimum of ``x' gram x / 2 - right' x`` for ``low <= x <= high``, (n,).

    Args:
        gram: positive definite, (n, n).
        right: (n,).
        low, high: bounds, (n,); equal ones fix a variable, infinite ones are none.
    """
    values = np.array(low, dtype=float)
    free = low < high
    if not free.any():
        return values
    root = np.linalg.cholesky(gram[np.ix_(free, free)])  # |root' x - root^-1 right|² is the same up to a constant
    target = linalg.solve_triangular(root, right[free] - gram[np.ix_(free, ~free)] @ values[~free], lower=True)
    steps = STEPS * int(free.sum())
    found = optimize.lsq_linear(root.T, target, (low[free], high[free]), method="bvls", max_iter=steps)
    inside = np.clip(found.x, low[free], high[free])  # what is held is so but for rounding
    values[free] = np.select([found.active_mask < 0, found.active_mask > 0], [low[free], high[free]], inside)
    return values
