"""Noise of the readings: standard normal numbers, drawn in blocks from each simulation's own generator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Noise is drawn for this many control steps at once, an episode of the paper's task and more: a generator call a step
#: would cost more than all the rest of the reading.
NOISE_BLOCK: Final = 320


class NoiseBlocks:
    """Numbers drawn for each simulation that are not used yet.

    Args:
        simulations: how many there are.
        deviation: of the numbers, (2,).
    """

    def __init__(self, simulations: int, deviation: Array) -> None:
        self._deviation = deviation
        self._blocks = np.zeros((NOISE_BLOCK, simulations, 2))
        self._next = np.full(simulations, NOISE_BLOCK)
        self._every = np.arange(simulations)
        #: Where all simulations are in their blocks, as they are while episodes begin together; None: see ``_next``.
        self._together: int | None = None

    def forget(self, rows: Any = ...) -> None:
        """Discard the numbers of some simulations, so that an episode's noise does not depend on the episode before."""
        self._part()
        self._next[rows] = NOISE_BLOCK

    def take(self, generators: Sequence[np.random.Generator], rows: NDArray[np.intp] | None = None) -> Array:
        """The next number of both cells, (n, 2), read-only.

        Args:
            generators: one a simulation.
            rows: of which simulations; None: of all.
        """
        if rows is None and self._together is not None and self._together < NOISE_BLOCK:
            self._together += 1
            taken: Array = self._blocks[self._together - 1]
            return taken
        self._part()
        some = self._every if rows is None else rows
        for k in some[self._next[some] >= NOISE_BLOCK].tolist():
            self._blocks[:, k] = self._deviation * generators[k].standard_normal((NOISE_BLOCK, 2))
            self._next[k] = 0
        taken = self._blocks[self._next[some], some]
        self._next[some] += 1
        if (self._next == self._next[0]).all():
            self._together = int(self._next[0])
        return taken

    def _part(self) -> None:
        """Copy the common position in the blocks to every simulation, before they advance separately."""
        if self._together is not None:
            self._next[:] = self._together
            self._together = None
