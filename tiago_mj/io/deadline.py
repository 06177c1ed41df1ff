"""Deadline of a computation, passed to every long-running function, which checks it between steps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace


class OutOfTimeError(Exception):
    """The deadline is over; what was found until then is the answer."""


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
        """Whether there is a deadline."""
        return math.isfinite(self.seconds)

    def spent(self) -> float:
        """Seconds since the beginning."""
        return self.clock() - self.begun

    def left(self) -> float:
        """Seconds that are left, below 0 once it is over."""
        return self.seconds - self.spent()

    def over(self, needed: float = 0.0) -> bool:
        """Whether at most the given time is left [s]."""
        return self.left() <= needed

    def check(self) -> None:
        """Raise :class:`OutOfTimeError` once the deadline is over.

        Raises:
            OutOfTimeError: there is none.
        """
        if self.over():
            raise OutOfTimeError(f"{self.seconds:g} s are spent")

    def sooner(self, seconds: float) -> Deadline:
        """A deadline so many seconds earlier."""
        return replace(self, seconds=self.seconds - seconds)
