"""What the regressions are made of: a uniform grid, a filter without phase, derivatives, least squares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import signal

Array = NDArray[np.float64]

#: Speed over which the direction of dry friction turns [rad/s, m/s]; regressions state theirs.
TURN = 0.05


@dataclass(frozen=True)
class Motion:
    """A motion and whatever was measured along it, all through the same filter.

    Attributes:
        time: (T,) [s], uniform.
        position, velocity, acceleration: (T, n).
        beside: (T, m): torques, commands.
    """

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    beside: Array


def motion(time: Array, position: Array, beside: Array, *, rate: float, cutoff: float) -> Motion:
    """Resample, low-pass (Butterworth of order 4, forward and backward) and differentiate.

    Args:
        time: (T,) [s], increasing; stamps that do not increase are left out.
        position: (T, n).
        beside: (T, m).
        rate: of the grid [Hz].
        cutoff: [Hz].
    """
    keep = np.concatenate([[True], np.diff(time) > 0])
    time, position, beside = time[keep], position[keep], beside[keep]
    grid = np.arange(time[0], time[-1], 1 / rate)

    def filtered(columns: Array) -> Array:
        even = np.stack([np.interp(grid, time, column) for column in columns.T], axis=1)
        b, a = signal.butter(4, cutoff / (rate / 2))
        return np.asarray(signal.filtfilt(b, a, even, axis=0))

    smooth = filtered(position)
    velocity = np.gradient(smooth, 1 / rate, axis=0)
    edge = round(1.5 * rate / cutoff)  # rows that the filter's ends reach
    rows = slice(edge, len(grid) - edge)
    return Motion(
        grid[rows],
        smooth[rows],
        velocity[rows],
        np.gradient(velocity, 1 / rate, axis=0)[rows],
        filtered(beside)[rows],
    )


def needed(model: mujoco.MjModel, motion: Motion) -> Array:
    """Torques that a model needs along a motion of all its joints, by inverse dynamics, (T, n) [N, N·m]."""
    data, out = mujoco.MjData(model), np.zeros_like(motion.position)
    for row in range(len(out)):
        data.qpos[:], data.qvel[:], data.qacc[:] = (
            table[row] for table in (motion.position, motion.velocity, motion.acceleration)
        )
        mujoco.mj_inverse(model, data)
        out[row] = data.qfrc_inverse
    return out


def turning(velocity: Array, over: float = TURN) -> Array:
    """Direction of motion, -1 to 1, smooth over a small speed."""
    return np.asarray(np.tanh(velocity / over))


@dataclass(frozen=True)
class Fit:
    """Least squares.

    Attributes:
        values: by name.
        explained: 1 - var(residual) / var(wanted).
        residual: (T,).
    """

    values: Mapping[str, float]
    explained: float
    residual: Array

    def __getitem__(self, name: str) -> float:
        return self.values[name]


def fit(columns: Mapping[str, Array], wanted: Array) -> Fit:
    """Ordinary least squares of named columns."""
    matrix = np.stack(list(columns.values()), axis=1)
    solution, *_ = np.linalg.lstsq(matrix, wanted, rcond=None)
    residual = wanted - matrix @ solution
    values = dict(zip(columns, solution.tolist(), strict=True))
    return Fit(values, float(1 - residual.var() / wanted.var()), residual)
