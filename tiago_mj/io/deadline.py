"""When work has to be over: one value that everything which takes long is given, and asks between its steps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace


class OutOfTimeError(Exception):
    """A time budget is spent; what was known by then is the answer."""


@dataclass(frozen=True)
class Deadline:
    """An instant by which work has to be over.

    Attributes:
        seconds: from the beginning on; infinite: there is no such instant.
        begun: when the work began [s, of the clock].
        clock: seconds, never going back.
    """

    seconds: float = math.inf
    begun: float = field(default_factory=time.monotonic)
    clock: Callable[[], float] = field(default=time.monotonic, repr=False, compare=False)

    @property
    def set(self) -> bool:
        """Whether there is such an instant."""
        return math.isfinite(self.seconds)

    def spent(self) -> float:
        """Seconds since the beginning."""
        return self.clock() - self.begun

    def left(self) -> float:
        """Seconds that are left, below 0 once it is over."""
        return self.seconds - self.spent()

    def over(self, needed: float = 0.0) -> bool:
        """Whether no more is left than what is needed [s]."""
        return self.left() <= needed

    def check(self) -> None:
        """Go on, if there is time.

        Raises:
            OutOfTimeError: there is none.
        """
        if self.over():
            raise OutOfTimeError(f"{self.seconds:g} s are spent")

    def sooner(self, seconds: float) -> Deadline:
        """The same, so many seconds before."""
        return replace(self, seconds=self.seconds - seconds)
