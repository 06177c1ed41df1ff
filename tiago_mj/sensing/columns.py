"""Vectors taken apart and put together: what is computed with a few numbers in every control step.

NumPy takes ten times as long to add two arrays of two numbers as Python takes to add four numbers, with the same bits.
So a formula of few numbers is written for each of them alone: of one simulation they are Python's floats, of many they
are arrays, and the one formula serves both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

#: Python computes with these and with no others: of other vectors a column is an array, which keeps its kind.
_FLOAT: Final = np.dtype(np.float64)


def columns(vectors: NDArray[Any]) -> list[Any]:
    """The entries of a vector, or of many (..., n): n floats, or n arrays (...)."""
    if vectors.ndim == 1 and vectors.dtype == _FLOAT:
        entries: list[Any] = vectors.tolist()
        return entries
    return [vectors[..., k] for k in range(vectors.shape[-1])]


def positive(entry: Any) -> Any:
    """An entry where it is above 0, else 0."""
    return max(entry, 0.0) if type(entry) is float else np.maximum(entry, 0.0)


def joined(entries: Sequence[Any]) -> NDArray[np.float64]:
    """A vector from n floats, or vectors (..., n) from n arrays (...)."""
    if isinstance(entries[0], float):
        return np.array(entries)
    vectors = np.empty((*entries[0].shape, len(entries)))
    for k, entry in enumerate(entries):
        vectors[..., k] = entry
    return vectors
