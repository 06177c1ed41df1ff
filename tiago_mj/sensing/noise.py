"""The readings' noise: standard normal numbers, drawn in blocks from one generator a simulation."""

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
    """What was drawn for each simulation and not used yet.

    Args:
        simulations: how many there are.
    """

    def __init__(self, simulations: int) -> None:
        self._blocks = np.zeros((simulations, NOISE_BLOCK, 2))
        self._next = np.full(simulations, NOISE_BLOCK)
        self._rows = np.arange(simulations)
        self._sure = 0  # how many more numbers every simulation has at least

    def forget(self, rows: Any = ...) -> None:
        """Nothing of an episode's noise reaches the next: the next number is a new one."""
        self._next[rows] = NOISE_BLOCK
        self._sure = 0

    def take(self, generators: Sequence[np.random.Generator], rows: NDArray[np.intp] | None = None) -> Array:
        """The next number of both cells, (n, 2).

        Args:
            generators: one a simulation.
            rows: of which simulations; None: of all.
        """
        if rows is None:
            rows = self._rows
        if self._sure <= 0:
            for k in rows[self._next[rows] >= NOISE_BLOCK].tolist():
                self._blocks[k] = generators[k].standard_normal((NOISE_BLOCK, 2))
                self._next[k] = 0
            self._sure = NOISE_BLOCK - int(self._next.max())
        taken: Array = self._blocks[rows, self._next[rows]]
        self._next[rows] += 1
        self._sure -= 1
        return taken
