"""What an effect can act on: a robot's actuators, joints and load cells, by name."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def overlap(names: tuple[str, ...] | None, others: tuple[str, ...] | None) -> bool:
    """Whether two entries act on a target together; None: on all."""
    return names is None or others is None or not set(names).isdisjoint(others)


@dataclass(frozen=True)
class Targets:
    """What an entry can name, and the nominal limits that relative defaults refer to.

    Attributes:
        command, joint, sensor: names, in the order of the arrays.
        slides: of the joints, whether each slides (else it turns).
        velocity, effort: nominal limits of the actuators [m/s, rad/s], [N, N·m]; inf where there is none.
        actuated: per actuator, the index of its joint.
    """

    command: tuple[str, ...]
    joint: tuple[str, ...]
    sensor: tuple[str, ...]
    slides: tuple[bool, ...]
    velocity: Array
    effort: Array
    actuated: tuple[int, ...]

    def names(self, kind: str) -> tuple[str, ...]:
        """Of one kind of target."""
        return {"command": self.command, "joint": self.joint, "sensor": self.sensor}.get(kind, (kind,))

    def first(self, kind: str, names: tuple[str, ...] | None) -> int:
        """Index of the first of some targets; None: of all."""
        return self.names(kind).index(names[0]) if names else 0

    def side(self, kind: str, index: int) -> int:
        """Which of a parameter's two numbers is that target's: 0 of what slides, 1 of what turns."""
        if kind not in ("command", "joint"):
            return 0
        return 0 if self.slides[self.actuated[index] if kind == "command" else index] else 1

    def nominal(self, quantity: str, kind: str, index: int) -> float:
        """The limit that a relative parameter is a share of."""
        limits = self.velocity if quantity == "velocity" else self.effort
        if kind == "command":
            return float(limits[index])
        return float(limits[self.actuated.index(index)]) if index in self.actuated else math.inf
