"""How much of a diagnosis is still ahead: physics steps, since those are what takes its time.

How many a search takes turns out as it goes: a nominal model that explains the recordings ends it early, a gap that
two effects leave open makes it long. What is expected to be left is therefore told anew at every stage, from what
comparable diagnoses still took there. These amounts are close to log-normal, and what has been done without an end is
evidence that more is left: the expectation is the median of those that took at least as much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, Protocol

NORMAL: Final = NormalDist()
#: Beyond this many standard deviations a diagnosis is longer than all that were seen; the median of such a tail is
#: as good as any.
FARTHEST: Final = 3.0


class Listener(Protocol):
    """Told how far a diagnosis is."""

    def __call__(self, stage: str, done: float, left: float | None) -> None:
        """A stage begins or goes on; so much work is done in all, and so much expected to be left (None: not known)."""


@dataclass(frozen=True)
class Typical:
    """What was left from the beginning of a stage to the end of the diagnosis.

    Attributes:
        median: of the work; in units that make diagnoses alike.
        spread: standard deviation of its logarithm.
    """

    median: float
    spread: float

    def left(self, done: float) -> float:
        """Median of what is left where so much was done since the stage began, in the same units."""
        if done <= 0:
            return self.median
        place = min((math.log(done) - math.log(self.median)) / self.spread, FARTHEST)
        beyond = NORMAL.inv_cdf(0.5 * (1.0 + NORMAL.cdf(place)))
        return max(self.median * math.exp(self.spread * beyond) - done, 0.0)


#: What was left at the beginning of each stage, whether or not the best explanation by then left a gap. Of what replays
#: commands in simulations of all fitted trials: the first two of 204 kept cases of the blind check (version 7, seeds 14
#: to 16), the others of 14 of seeds 31, 33 and 35, rounded, and 60 more for the fit to all trials: 125 of 16 hinges at
#: 25 Hz (seed 932), next to none at 240 Hz, where all trials are fitted anyway.
TYPICAL: Final = {
    "replaying": Typical(480.0, 0.6),
    "fitting the nominal model": Typical(480.0, 0.6),
    "screening, no gap": Typical(300.0, 0.35),
    "screening, a gap": Typical(450.0, 0.65),
    "fitting, no gap": Typical(200.0, 0.45),
    "fitting, a gap": Typical(360.0, 0.75),
    "weighing, no gap": Typical(100.0, 0.6),
    "weighing, a gap": Typical(660.0, 0.35),
    "refitting, no gap": Typical(70.0, 0.6),
    "refitting, a gap": Typical(510.0, 0.6),
    "lost commands, no gap": Typical(68.0, 0.6),
    "lost commands, a gap": Typical(610.0, 0.3),
    "pairs, no gap": Typical(85.0, 0.6),
    "pairs, a gap": Typical(510.0, 0.5),
    "triples, a gap": Typical(310.0, 0.6),
    "all trials, no gap": Typical(65.0, 0.6),
    "all trials, a gap": Typical(65.0, 0.6),
    "next motion": Typical(30.0, 0.5),
    "writing": Typical(5.0, 0.5),
    "playing the policy": Typical(2.0, 0.5),
}


def key(stage: str, gap: bool | None) -> str:
    """Of a stage in :data:`TYPICAL`; ``gap``: whether the best explanation leaves one, where that is known."""
    return stage if gap is None else f"{stage}, {'a' if gap else 'no'} gap"


class Ahead:
    """What a diagnosis still has to do, told to a listener whenever a stage begins or some of it was done."""

    def __init__(self, listener: Listener) -> None:
        self.listener = listener
        self._stage = ""
        self._typical: Typical | None = None
        self._done, self._since, self._unit, self._most = 0.0, 0.0, 0.0, math.inf

    def measured_in(self, unit: float, most: float = math.inf) -> None:
        """Diagnoses are alike in units of so much work; after ``most`` of it in all the search ends."""
        self._unit, self._most = unit, most

    def __call__(self, stage: str, total: int = 0, done: int = 0, *, gap: bool | None = None) -> None:
        """A stage begins, or goes on; see :class:`tiago_mj.gap.search.state.Tick`."""
        if stage != self._stage or gap is not None:
            self._stage, self._since = stage, self._done
            self._typical = TYPICAL.get(key(stage, gap))
        self.listener(self._stage, self._done, self.left())

    def worked(self, amount: float) -> None:
        """So much more work was done."""
        self._done += amount
        self.listener(self._stage, self._done, self.left())

    def left(self) -> float | None:
        """Work that is expected to be left; None: not known."""
        if self._typical is None or not self._unit > 0:
            return None
        left = self._unit * self._typical.left((self._done - self._since) / self._unit)
        rest = max(self._most - self._done, 0.0) + self._unit * TYPICAL["writing"].median
        return min(left, rest)
