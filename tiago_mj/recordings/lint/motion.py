"""Displacement of a joint in windows of time, from each of its channels, so that channels can be compared.

Displacements over windows are insensitive to what disturbs derivatives: quantized encoders, jittering clocks, streams
of different rates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tiago_mj.recordings.lint.numbers import noise, quantum
from tiago_mj.recordings.recording import Array, Trial, sampled

#: Longest window [s], and how many windows the shortest recording is cut into.
WINDOW, WINDOWS = 0.25, 8
#: A displacement that rises above its floor by less than this factor is none.
CLEAR: Final = 5.0
#: A joint whose displacement is below :data:`CLEAR` times this [m, rad], 1 mm or 1 mrad, stands still: servos that hold
#: a pose give way by less, and what two channels make of that tells nothing about either.
STILL: Final = 2e-4
#: Time constants of filtered velocities [s]: to the most that the library's ``velocity_filter`` may have.
FILTERS: Final = (0.02, 0.4)
#: Commands act later by up to this [s]: hobby servos take 92 ms, and a lag comes on top.
LATEST: Final = 0.3


@dataclass(frozen=True)
class Travel:
    """Displacements of one channel over windows.

    Attributes:
        windows: (n,) [m, rad].
        floor: what noise and quantum alone give [m, rad].
    """

    windows: Array
    floor: float

    @property
    def moved(self) -> bool:
        """Whether the displacement is clearly above the noise."""
        return bool(np.sqrt(np.mean(self.windows**2)) > CLEAR * self.floor) if len(self.windows) else False


def edges(trial: Trial) -> tuple[Array, float]:
    """Beginnings of windows, (n,) [s], and their length [s]; they overlap by half."""
    span = float(trial.time[-1])
    length = min(max(span / WINDOWS, 5 * float(np.median(np.diff(trial.time)))), WINDOW)
    return np.arange(0.0, span - length + 1e-12, length / 2), length


def measured(trial: Trial, joint: str) -> Travel | None:
    """Displacements from the position; None without one."""
    if joint not in trial.positions:
        return None
    time, values = sampled(trial, f"position.{joint}")
    if len(values) < 4:
        return None
    start, length = edges(trial)
    floor = max(noise(values), (quantum(values) or 0.0) / np.sqrt(12), STILL)
    return Travel(np.interp(start + length, time, values) - np.interp(start, time, values), np.sqrt(2) * floor)


def filtered(trial: Trial, joint: str, time_constant: float) -> Array:
    """Displacements of the low-pass filtered position, (n,), with a time constant [s]: the integral of a filtered
    velocity."""
    time, values = sampled(trial, f"position.{joint}")
    out, share = values.copy(), np.exp(-np.diff(time) / time_constant)
    # Exact where the position is straight between samples: 1 - (1 - e) τ / dt of the new one, the rest of the old.
    new = 1 - (1 - share) * time_constant / np.diff(time)
    for k, (e, w) in enumerate(zip(share, new, strict=True), start=1):
        out[k] = e * out[k - 1] + (1 - e - w) * values[k - 1] + w * values[k]
    start, length = edges(trial)
    gone: Array = np.interp(start + length, time, out) - np.interp(start, time, out)
    return gone


def integrated(trial: Trial, joint: str, lag: float = 0.0) -> Travel | None:
    """Displacements from the velocity, which is delayed by ``lag`` [s]; None without one."""
    if joint not in trial.velocities:
        return None
    time, values = sampled(trial, f"velocity.{joint}")
    if len(values) < 4:
        return None
    start, length = edges(trial)
    gone = np.append(0.0, np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(time)))
    step = length / max(int(length / np.median(np.diff(time))), 1)
    floor = max(noise(values) * np.sqrt(length * step), (quantum(values) or 0.0) * length / np.sqrt(12), STILL)
    return Travel(np.interp(start + length + lag, time, gone) - np.interp(start + lag, time, gone), floor)


def commanded(trial: Trial, actuator: str, interface: str | None, lag: float = 0.0) -> Travel | None:
    """Displacements from the command, sent ``lag`` [s] earlier; None without one, or for an effort."""
    if actuator not in trial.commands or interface not in ("velocity", "position"):
        return None
    time, values = sampled(trial, f"command.{actuator}")
    if len(values) < 4:
        return None
    start, length = edges(trial)
    begin, end = np.maximum(start - lag, 0.0), np.maximum(start + length - lag, 0.0)
    if interface == "velocity":
        gone = np.append(0.0, np.cumsum(values[:-1] * np.diff(time)))
        return Travel(np.interp(end, time, gone) - np.interp(begin, time, gone), STILL)
    held = values[np.maximum(np.searchsorted(time, np.stack([begin, end]), side="right") - 1, 0)]
    return Travel(held[1] - held[0], STILL)


def time_constants() -> Array:
    """Time constants to try for a velocity that is a filtered derivative, (n,) [s]."""
    return np.geomspace(*FILTERS, 12)


def lags() -> Array:
    """Lags to try between a command and the motion, (n,) [s]."""
    return np.linspace(0.0, LATEST, 13)
