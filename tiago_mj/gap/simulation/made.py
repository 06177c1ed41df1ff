"""Simulations that were made, for those that are asked for again: fits begin where others ended, and what was found is
weighed anew. Of two hinges with two effects, and an arm without any, 15 to 28 % of all physics steps were repeated."""

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
        by: what else they depend on: the simulator, its commands.
        largest: memory [bytes].
    """

    def __init__(self, *by: object, largest: int = LARGEST) -> None:
        self._by, self._largest, self._bytes = by, largest, 0
        self._runs: OrderedDict[Hashable, Run] = OrderedDict()

    def are_by(self, *by: object) -> bool:
        """Whether these very objects made them."""
        return len(by) == len(self._by) and all(one is other for one, other in zip(by, self._by, strict=True))

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
