"""Torque that nobody named: smooth functions of a joint's own position, speed and time, and of others' positions.

They stand for what is outside the library. What they explain beside the best explanation remains unknown; where they
explain instead of a named effect, and better, the name is not supported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.torque.strips import Course

Array = NDArray[np.float64]

#: Half waves over a joint's range that a function of its position may have.
WAVES: Final = 6


@dataclass(frozen=True)
class Shape:
    """One function on one channel.

    Attributes:
        family: ``position``, ``speed``, ``friction over position`` or ``time``.
        channel: index.
        values: (T, c), of unit size on its channel, 0 on the others.
    """

    family: str
    channel: int
    values: Array


def shapes(course: Course) -> tuple[Shape, ...]:
    """All of them, filtered as the efforts are."""
    position, velocity = course.stack("position"), course.stack("velocity")
    centre, spread = position.mean(axis=0), np.maximum(position.std(axis=0), 1e-12)
    q = (position - centre) / spread
    fast = np.maximum(np.abs(velocity).max(axis=0), 1e-12)
    time = np.concatenate([strip.time for strip in course.strips])
    t = (time - time.mean()) / max(float(time.std()), 1e-12)
    found = []
    for c, j in enumerate(course.columns):
        s = np.clip(velocity[:, j] / course.rest_speed[j], -1, 1)
        for family, values in _of(q, j, velocity[:, j] / fast[j], s, t):
            column = np.zeros((len(q), len(course.channels)))
            column[:, c] = course.filtered(values[:, None])[:, 0]
            found.append(Shape(family, c, column))
    return tuple(found)


def _of(q: Array, j: int, v: Array, s: Array, t: Array) -> Iterator[tuple[str, Array]]:
    own = q[:, j]
    yield "position", np.ones_like(own)
    along = (own - own.min()) / max(float(np.ptp(own)), 1e-12)
    for wave in range(1, WAVES + 1):
        yield "position", np.sqrt(2) * np.cos(np.pi * wave * along)
    for k in range(q.shape[1]):
        if k != j and q[:, k].any():
            yield "position", q[:, k]
    yield "speed", v * np.abs(v)
    yield "speed", v**3
    yield "friction over position", s * own
    yield "friction over position", s * own**2
    yield "time", t
    yield "time", t**2
