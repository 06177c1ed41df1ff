"""Recordings as answers are judged on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.session import Session
from tiago_mj.gap.simulation.subset import Subset


@dataclass(frozen=True)
class Recorded:
    """Recordings, what was measured in them, and what the robot was doing.

    Attributes:
        session: trials, and what each of them is used for.
        data: measured, in every trial.
        phase: of every row, (ntrials, T), as indices into ``PHASES``.
        seed: of the bootstrap.
    """

    session: Session
    data: Data
    phase: NDArray[np.int_]
    seed: int = 0

    @property
    def plant(self) -> Plant:
        """The nominal simulator."""
        return self.session.plant

    @property
    def test(self) -> Subset:
        """The trials that are kept aside."""
        return self.session.subset("test")
