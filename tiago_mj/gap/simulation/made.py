"""Simulations that were made, for those that are asked for again: fits begin where others ended, and what was found is
weighed anew. Of two hinges with two effects (seed 9917 of the blind check, cases 0 and 9) and an arm without any (seed
7711, case 0) 28, 15 and 19 % of all physics steps were repeated.

A diagnosis that goes on finds the results of finished work in its journal, and not the simulations that this made. It
is told which these were, so that it counts, remembers and forgets as if it had not been interrupted; where one of them
is asked for, it is made again.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
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

    Attributes:
        asked: simulations that were asked for, in turn, each with its size [bytes].
    """

    def __init__(self, *by: object, largest: int = LARGEST) -> None:
        self._by, self._largest, self._bytes = by, largest, 0
        self._sizes: OrderedDict[str, int] = OrderedDict()
        self._runs: dict[str, Run] = {}
        self.asked: list[tuple[str, int]] = []

    def are_by(self, *by: object) -> bool:
        """Whether these very objects made them."""
        return len(by) == len(self._by) and all(one is other for one, other in zip(by, self._by, strict=True))

    def __contains__(self, key: str) -> bool:
        return key in self._sizes

    def get(self, key: str) -> Run | None:
        """What was simulated; None: it was not, or by an earlier run, or is forgotten."""
        return self._runs.get(key)

    def keep(self, key: str, run: Run) -> None:
        """Remember a simulation that was asked for, and forget what was not for the longest where there is no room."""
        if key not in self._runs:
            self._runs[key] = tuple(one.copy() for one in run)  # a view would keep its whole batch
        self._ask(key, sum(one.nbytes for one in run))

    def replay(self, asked: Sequence[tuple[str, int]]) -> None:
        """What an earlier run asked for: known from now on, though without its signals."""
        for key, size in asked:
            self._ask(key, size)

    def _ask(self, key: str, size: int) -> None:
        self.asked.append((key, size))
        self._bytes += size - self._sizes.pop(key, 0)
        self._sizes[key] = size
        while self._bytes > self._largest:
            oldest, its = self._sizes.popitem(last=False)
            self._bytes -= its
            self._runs.pop(oldest, None)
