"""Candidate functions for the shape of a residual: of speed, position, contact, time and command.

Each shape is a small set of functions, its columns; the residual is regressed on them. They are computed from
predictions and commands, which have no noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: A joint stands that is slower than this share of its fastest.
STANDS: Final = 0.02
#: What an event leaves decays within these times [s]; after touching and letting go there is a slow one, too.
DECAYS: Final = (0.03, 0.1, 0.3)
SLOW_DECAY: Final = 1.0
#: Half waves over a joint's range that a function of its position may have.
WAVES: Final = 5
#: Periods over a joint's range that are tried of a periodic function of its position.
PERIODS: Final = tuple(np.arange(2.0, 40.25, 0.5))
#: A set point jumps by more than this share of its range within a row; if it does so in more than this share of the
#: rows it does not jump but goes fast.
JUMPS: Final = 0.05
SELDOM: Final = 0.2


@dataclass(frozen=True)
class Trajectory:
    """Predicted motion and contact, and commands, belonging to one channel, (ntrials, T) each; finite.

    Attributes:
        position, velocity: of the channel's joint [m, rad; per s].
        command: to its actuator, in the command's unit.
        touching: whether the pad (of a joint: any pad) is in contact.
        force: on that pad, in any unit; 0 without contact.
        period: of the rows [s].
    """

    position: Array
    velocity: Array
    command: Array
    touching: Bools
    force: Array
    period: float


@dataclass(frozen=True)
class Columns:
    """Regressors that make up one shape.

    Attributes:
        shape: name, of :data:`tiago_mj.gap.result.SHAPES`.
        values: (ncolumns, ntrials, T), unit mean square each.
        at: of a periodic function its period [unit of the position]; None: there is none.
    """

    shape: str
    values: Array
    at: float | None = None


def columns(trajectory: Trajectory, seen: Bools) -> list[Columns]:
    """All shapes that these trials can show, the simplest first; a periodic one once for each period.

    Args:
        trajectory: belonging to the channel.
        seen: rows in which the channel was measured, (ntrials, T): a function that vanishes on them is left out.
    """
    found = []
    for shape, values, at in _shapes(trajectory, seen):
        unit = [one / size for one in values if (size := float(np.sqrt(np.mean(one[seen] ** 2)))) > 1e-12]
        if unit:
            found.append(Columns(shape, np.stack(unit), at))
    return sorted(found, key=lambda one: len(one.values) + (one.at is not None))


def _shapes(trajectory: Trajectory, seen: Bools) -> Iterator[tuple[str, list[Array], float | None]]:
    """Name, columns, (ntrials, T) each, and period of every shape."""
    v, h = trajectory.velocity, trajectory.period
    ntrials, length = v.shape
    one = np.ones_like(v)
    fastest = float(np.abs(v[seen]).max(initial=0.0))
    yield "offset", [one], None
    yield "drift", [one, one * np.arange(length) * h, one * np.arange(ntrials)[:, None]], None
    if fastest > 0:
        yield "speed", [v, v * np.abs(v), np.abs(v)], None
        yield "acceleration", [np.gradient(v, axis=1) / h], None
        now = np.where(np.abs(v) > STANDS * fastest, np.sign(v), 0.0)
        last = _held(now)
        yield "direction", [now, last], None
        turned = np.zeros_like(v)
        turned[:, 1:] = np.where(last[:, 1:] * last[:, :-1] < 0, last[:, 1:], 0.0)
        yield "reversal", _decays(turned, h), None
    reach = float(np.ptp(trajectory.position[seen])) if seen.any() else 0.0
    low = float(trajectory.position[seen].min()) if seen.any() else 0.0
    if reach > 0:
        along = (trajectory.position - low) / reach
        yield "position", [np.cos(np.pi * wave * along) for wave in range(WAVES + 1)], None
        if fastest > 0:
            yield "place", [last * np.cos(np.pi * wave * along) for wave in range(WAVES + 1)], None
        for count in PERIODS:
            angle = 2 * np.pi * count * along
            yield "periodic", [np.cos(angle), np.sin(angle)], reach / count
    yield "jump", _decays(_jumps(trajectory.command), h), None
    yield from _contact(trajectory)


def _contact(trajectory: Trajectory) -> Iterator[tuple[str, list[Array], None]]:
    """Shapes of contact."""
    touching = trajectory.touching.astype(float)
    if not touching.any():
        return
    change = np.diff(touching, axis=1, prepend=touching[:, :1])
    yield "touch", [touching], None
    yield "force", [trajectory.force, trajectory.force * np.abs(trajectory.force)], None
    slow = (*DECAYS, SLOW_DECAY)
    yield "onset", [touching * one for one in _decays(np.maximum(change, 0.0), trajectory.period, slow)], None
    yield "release", [(1 - touching) * one for one in _decays(np.maximum(-change, 0.0), trajectory.period, slow)], None


def _decays(events: Array, period: float, times: tuple[float, ...] = DECAYS) -> list[Array]:
    """Exponentially decaying responses to events, (ntrials, T); a later event replaces an earlier one."""
    found = []
    for time in times:
        left, now = np.zeros_like(events), np.zeros(len(events))
        for row in range(events.shape[1]):
            now = np.where(events[:, row] != 0, events[:, row], now * np.exp(-period / time))
            left[:, row] = now
        found.append(left)
    return found


def _held(signs: Array) -> Array:
    """Signs, (ntrials, T), with zeros replaced by the last sign before."""
    at = np.maximum.accumulate(np.where(signs != 0, np.arange(signs.shape[1]), 0), axis=1)
    return np.take_along_axis(signs, at, axis=1)


def _jumps(command: Array) -> Array:
    """Steps of a command from row to row, (ntrials, T); 0 throughout where it ramps."""
    step = np.diff(command, axis=1, prepend=command[:, :1])
    jumped = np.where(np.abs(step) > JUMPS * float(np.ptp(command)), step, 0.0)
    return jumped if np.count_nonzero(jumped) <= SELDOM * jumped.size else np.zeros_like(command)
