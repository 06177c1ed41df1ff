"""Set points over time, out of straight lines and sums of sines.

A shape is a function of time [s], any shape of array, that gives a set point [m, rad]. It is where it begins before 0
and where it ends after its last corner.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Shape = Callable[[Array], Array]


@dataclass(frozen=True)
class Path:
    """Straight lines from corner to corner.

    Attributes:
        corners: (time [s], set point [m, rad]), in order of time; two at one time are a step.
    """

    corners: tuple[tuple[float, float], ...]

    @property
    def ends(self) -> float:
        """When the last corner is reached [s]."""
        return self.corners[-1][0]

    def to(self, place: float, speed: float) -> Path:
        """Go to a place at a speed [m/s, rad/s]."""
        time, here = self.corners[-1]
        return Path((*self.corners, (time + abs(place - here) / speed, place)))

    def step(self, place: float) -> Path:
        """Be there at once: for position commands."""
        return Path((*self.corners, (self.ends, place)))

    def hold(self, seconds: float) -> Path:
        """Stay."""
        time, here = self.corners[-1]
        return Path((*self.corners, (time + seconds, here)))

    def between(self, a: float, b: float, speed: float, times: int, pause: float = 0.0) -> Path:
        """To and fro: to ``a``, to ``b``, and again, resting at each."""
        path = self
        for _ in range(times):
            path = path.to(a, speed).hold(pause).to(b, speed).hold(pause)
        return path

    def stairs(self, step: float, count: int, pause: float, speed: float) -> Path:
        """Small steps with rests between."""
        path = self
        for _ in range(count):
            path = path.to(path.corners[-1][1] + step, speed).hold(pause)
        return path

    def __call__(self, time: Array) -> Array:
        """Set point at times."""
        at, place = np.array(self.corners).T
        return np.interp(time, at, place)


def start(place: float, rest: float = 0.3) -> Path:
    """Rest where the motion begins, so that the recording shows the noise."""
    return Path(((0.0, place), (rest, place)))


def wave(path: Path, begins: float, seconds: float, signal: Shape) -> Shape:
    """A path with a signal of (time since ``begins``) added for a while, faded in and out over 0.3 s."""

    def shape(time: Array) -> Array:
        inside = np.clip(time - begins, 0.0, seconds)
        fade = np.clip(np.minimum(inside, seconds - inside) / 0.3, 0.0, 1.0)
        return np.asarray(path(time) + fade * signal(inside))

    return shape


def chirp(amplitude: float, low: float, high: float, seconds: float) -> Shape:
    """A sine whose frequency rises evenly from ``low`` to ``high`` [Hz]."""
    return lambda t: amplitude * np.sin(2 * np.pi * (low * t + (high - low) * t * t / (2 * seconds)))


def multisine(amplitude: float, frequencies: tuple[float, ...]) -> Shape:
    """Sines of equal size whose phases keep the sum's peak low (Schroeder 1970, doi:10.1109/TIT.1970.1054411)."""
    count = len(frequencies)
    phases = [-np.pi * k * (k + 1) / count for k in range(count)]
    return lambda t: np.asarray(
        amplitude / count * sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(frequencies, phases, strict=True))
    )


def stop_and_go(place: float, step: float, dwell: float, count: int, speed: float) -> Path:
    """Moves and stops at irregular instants, by a maximum-length binary sequence of 5 bits (x⁵ + x³ + 1)."""
    path, bits = start(place), [1, 0, 1, 1, 0]
    for _ in range(count):
        bits = [bits[4] ^ bits[2], *bits[:4]]
        target = place + (step if bits[0] else 0.0)
        time = path.ends + dwell
        path = path.to(target, speed)
        path = path.hold(max(time - path.ends, 0.0))
    return path
