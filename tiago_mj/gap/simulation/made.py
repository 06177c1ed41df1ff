"""Simulations that were made, for those that are asked for again: fits begin where others ended, and what was found is
weighed anew. Of hinges and arms with and without an effect 8 to 29 % of all physics steps were repeated."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Signals of one simulation, in the order of their fields.
Run = tuple[NDArray[np.float64], ...]

#: Memory of one set of simulations [bytes].
LARGEST: Final = 256 * 2**20


class Made:
    """Signals of simulations by what was simulated; of more than fits into memory those that were asked for last.

    Args:
        largest: memory [bytes].
    """

    def __init__(self, largest: int = LARGEST) -> None:
        self._largest, self._bytes = largest, 0
        self._runs: OrderedDict[Hashable, Run] = OrderedDict()

    def get(self, key: Hashable) -> Run | None:
        """What was simulated; None: it was not, or is forgotten."""
        run = self._runs.get(key)
        if run is not None:
            self._runs.move_to_end(key)
        return run

    def keep(self, key: Hashable, run: Run) -> None:
        """Remember a simulation, and forget those that were not asked for the longest where there is no room."""
        self.forget(key)
        self._runs[key] = tuple(one.copy() for one in run)  # a view would keep its whole batch
        self._bytes += _size(run)
        while self._bytes > self._largest:
            self.forget(next(iter(self._runs)))

    def forget(self, key: Hashable) -> None:
        """Remember it no longer, if it was."""
        self._bytes -= _size(self._runs.pop(key, ()))


def _size(run: Run) -> int:
    return sum(one.nbytes for one in run)
