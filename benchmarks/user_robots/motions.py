"""Motions that a careful user would record: steps, sines, chirps, and a mix; from rest to rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Stillness at both ends of a motion [s].
REST: Final = 0.3


def steps(time: Array, rng: np.random.Generator, pace: float) -> Array:
    """Levels that are held for 0.5 to 1.1 s, reached within 80 ms: (T,) in [-1, 1]."""
    out, begin, level = np.zeros_like(time), 0.0, 0.0
    while begin < time[-1]:
        wanted = float(rng.uniform(0.3, 1.0)) * (-1 if level > 0 else 1)
        reached = np.clip((time - begin) / 0.08, 0, 1)
        out = np.where(time >= begin, level + (wanted - level) * reached, out)
        begin, level = begin + float(rng.uniform(0.5, 1.1)) / pace, wanted
    return out


def sines(time: Array, rng: np.random.Generator, pace: float) -> Array:
    """Three sines of 0.2 to 1.2 Hz."""
    frequency, phase = rng.uniform(0.2, 1.2, 3) * pace, rng.uniform(0, 2 * np.pi, 3)
    return np.sin(2 * np.pi * frequency * time[:, None] + phase) @ np.array([0.5, 0.3, 0.2])


def chirp(time: Array, rng: np.random.Generator, pace: float) -> Array:
    """From 0.2 to about 2 Hz, smaller where it is faster."""
    first, last = 0.2 * pace, float(rng.uniform(1.5, 2.2)) * pace
    frequency = first + (last - first) * time / time[-1]
    turns = first * time + (last - first) * time**2 / (2 * time[-1])
    return np.sin(2 * np.pi * turns + float(rng.uniform(0, 2 * np.pi))) * np.minimum(1.0, 0.9 * pace / frequency)


def mix(time: Array, rng: np.random.Generator, pace: float) -> Array:
    """Slow sines with steps on top."""
    return 0.6 * sines(time, rng, 0.7 * pace) + 0.4 * steps(time, rng, pace)


KINDS: Final[tuple[Callable[[Array, np.random.Generator, float], Array], ...]] = (steps, sines, chirp, mix)


def motion(kind: int, time: Array, rng: np.random.Generator, pace: float, *, smooth: bool) -> Array:
    """Where one actuator is to go, (T,) in about [-1, 1]; 0 at both ends.

    Args:
        kind: which of :data:`KINDS`, counted on beyond their number.
        time: (T,) [s].
        rng: of this actuator and trial.
        pace: scales frequencies.
        smooth: it has a speed and an acceleration: steps are not taken.
    """
    made = KINDS[1 + kind % 2] if smooth else KINDS[kind % len(KINDS)]
    end = time[-1]
    edge = np.clip(np.minimum(time - REST, end - REST - time) / 0.5, 0, 1)
    return made(time, rng, pace) * edge**2 * (3 - 2 * edge)
