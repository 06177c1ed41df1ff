"""Second numbers of effects along a motion: speeds and periods are those that the motion shows."""

import mujoco
import numpy as np
import pytest
from made_motions import diagnosed, holds, named, pendulum, record, value

AMPLITUDE, PERIOD = 0.6, 0.23
BREAKAWAY, SPEED = 0.8, 0.5


def ripple(data: mujoco.MjData, time: float) -> np.ndarray:
    return np.array([AMPLITUDE * np.sin(2 * np.pi * data.qpos[0] / PERIOD)])


def breakaway(data: mujoco.MjData, time: float) -> np.ndarray:
    speed = data.qvel[0]
    return np.array([-BREAKAWAY * np.tanh(speed / 1e-3) * np.exp(-((speed / SPEED) ** 2))])


def test_a_ripple_of_any_period_is_found_in_efforts() -> None:
    """Tried at the library's own periods alone it was noise, and inertia beside a late clock was named."""
    rippled = diagnosed(record(pendulum(), ("swing",), spread=2.0, pull=ripple))
    assert rippled.kind == "effect"
    assert named(rippled.best) == {"motor_cogging"}
    assert value(rippled.best, "motor_cogging", "all", "amplitude").value == pytest.approx(AMPLITUDE, rel=0.05)
    period = value(rippled.best, "motor_cogging", "all", "period")
    assert holds(period, PERIOD)
    # A motion over four radians tells a period to a small share of a turn at either end.
    assert period.high - period.low < 0.01 * PERIOD


def test_breakaway_friction_that_fades_at_any_speed_is_found_in_efforts() -> None:
    """Tried up to 0.07 rad/s alone it was noise of the efforts."""
    found = diagnosed(record(pendulum(), ("swing",), spread=2.0, pull=breakaway))
    assert found.kind == "effect"
    assert named(found.best) == {"stribeck_friction"}
    assert holds(value(found.best, "stribeck_friction", "all", "static"), BREAKAWAY)
    assert holds(value(found.best, "stribeck_friction", "all", "velocity"), SPEED)
