"""Effort sensors of the recordings: a torque sensor behind the motor, or the motor's current."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.robots import Robot

Array = NDArray[np.float64]

SENSOR, CURRENT = "torque sensor", "motor current"
#: Standard deviations of a torque sensor: noise and offset (shares of the drive's limit), gain; its longest delay [s].
NOISE, OFFSET, GAIN, DELAY = 0.003, 0.005, 0.02, 0.004
#: Standard deviation of a motor's torque constant, which the sidecars state.
CONSTANT: Final = 0.2


@dataclass(frozen=True)
class EffortSensor:
    """What measures the drives' torques; arrays over joints, (n,).

    Attributes:
        of_current: whether it is told what the drive asked for, not what the motor gave.
        gain: factor.
        offset, noise: standard deviation of the noise [N, N·m].
        delay: age of what is logged [s].
    """

    of_current: bool
    gain: Array
    offset: Array
    noise: Array
    delay: float


def sensor(effort: str, seed: int, robot: Robot) -> EffortSensor:
    """A robot's sensors, with what nobody knows of them.

    Args:
        effort: :data:`SENSOR` or :data:`CURRENT`.
        seed: of the case.
        robot: whose drives they measure.
    """
    rng, n = np.random.default_rng([seed, 31]), len(robot.joints)
    drawn = np.clip(rng.standard_normal((2, n)), -2, 2)
    noise = NOISE * robot.limit
    if effort == CURRENT:
        return EffortSensor(True, 1 + CONSTANT * drawn[0], np.zeros(n), noise, 0.0)
    delay = float(rng.uniform(0, DELAY))
    return EffortSensor(False, 1 + GAIN * drawn[0], OFFSET * robot.limit * drawn[1], noise, delay)


def stated(effort: str) -> dict[str, Any]:
    """What a sidecar says of them."""
    return {"uncertainty": {"torque_constant": CONSTANT if effort == CURRENT else GAIN}}
