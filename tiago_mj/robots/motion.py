"""A motion to record with a robot: slow strokes with rests, then waves, around where it may move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tiago_mj.robots.known import KnownRobot

Array = NDArray[np.float64]

#: Seconds of the strokes, of the waves and of the rests around them.
STROKES, WAVES, REST = 6.0, 6.0, 0.5
#: Periods of the first joint's stroke and wave [s]; each further joint's is so many times as long.
STROKE_PERIOD, WAVE_PERIOD, RATIO = 3.0, 1.7, 1.13
#: Share of the stroke that the waves have.
WAVE_SHARE = 0.4


def motion(robot: KnownRobot, rate_hz: float | None = None) -> tuple[Array, dict[str, Array]]:
    """Times (T,) [s] and position commands by actuator, (T,) each in its unit.

    Every joint begins and ends at rest where the robot is at home. Strokes are triangles, which show dry friction and
    play as they turn round; waves are fast enough to show inertia and delay. No two joints have the same period.

    Args:
        robot: which.
        rate_hz: of the rows; None: of its usual driver.
    """
    rate = robot.rate_hz if rate_hz is None else rate_hz
    time = np.arange(int((3 * REST + STROKES + WAVES) * rate) + 1) / rate
    commands = {}
    for k, actuator in enumerate(robot.joints):
        factor = RATIO**k
        strokes = _within(time, REST, STROKES) * _triangle((time - REST) / (STROKE_PERIOD * factor))
        since = time - 2 * REST - STROKES
        waves = _within(time, 2 * REST + STROKES, WAVES) * np.sin(2 * np.pi * since / (WAVE_PERIOD * factor))
        place = robot.home[k] + robot.stroke[k] * (strokes + WAVE_SHARE * waves)
        commands[actuator] = np.round(robot.commands * place, 6)
    return time, commands


def table(robot: KnownRobot, rate_hz: float | None = None) -> str:
    """The motion as ``record --motion`` and a robot's own player read it."""
    time, commands = motion(robot, rate_hz)
    rows = np.stack([time, *commands.values()], axis=1)
    lines = [",".join(["time", *(f"command.{name}" for name in commands)])]
    return "\n".join([*lines, *(",".join(f"{value:.6g}" for value in row) for row in rows)]) + "\n"


def _triangle(turns: Array) -> Array:
    """Between -1 and 1, 0 at 0, once a turn."""
    return np.asarray(2 * np.abs(2 * ((turns - 0.25) % 1) - 1) - 1)


def _within(time: Array, begin: float, seconds: float) -> Array:
    """From 0 to 1 and back over the ends of an interval, so that nothing jumps."""
    ramp = np.minimum(time - begin, begin + seconds - time) / REST
    return np.asarray(np.clip(ramp, 0.0, 1.0))
