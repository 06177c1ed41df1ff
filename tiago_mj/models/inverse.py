"""Inverse dynamics along a measured motion: which torque the model says each joint needed.

The motion is resampled to a uniform grid (recorded timestamps jitter), low-passed without phase shift and
differentiated; a torque to be compared with the prediction goes through the same filter. The model keeps its masses,
inertias, joint damping and friction; contacts, joint limits and gravity compensation are switched off, as the recorded
motion touched nothing and the measured torque carried the weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tiago_mj.models.files import model_file

Array = NDArray[np.float64]

#: Order of the Butterworth filter; run forward and backward, so the phase is zero and the attenuation doubles.
FILTER_ORDER: Final = 4


@dataclass(frozen=True)
class Motion:
    """Joint motion on a uniform grid.

    Attributes:
        joints: names, n.
        time: (T,) [s].
        position, velocity, acceleration: (T, n) [m, rad and per s, s²].
    """

    joints: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True)
class Agreement:
    """How close a predicted signal is to a measured one.

    Attributes:
        joint: which.
        measured_rms, predicted_rms: root mean squares [N·m].
        gap_rms: of measured − predicted [N·m].
        bias: mean of measured − predicted [N·m].
        explained: 1 − var(measured − predicted) / var(measured): 1 is perfect, 0 as good as a constant, below 0 worse.
    """

    joint: str
    measured_rms: float
    predicted_rms: float
    gap_rms: float
    bias: float
    explained: float


def uniform(time: Array, values: Array, rate: float) -> tuple[Array, Array]:
    """Interpolate linearly to a uniform grid.

    Args:
        time: (S,) [s], increasing; need not start at 0 nor be even.
        values: (S, n).
        rate: of the grid [Hz].

    Returns:
        Times (T,) and values (T, n).

    Raises:
        ValueError: times do not increase, numbers are not finite, or the shapes do not fit.
    """
    if time.ndim != 1 or values.ndim != 2 or len(time) != len(values) or len(time) < 2:
        raise ValueError(f"times of shape {time.shape} and values of shape {values.shape} do not belong together")
    if not (np.isfinite(time).all() and np.isfinite(values).all()):
        row = int(np.argmax(~(np.isfinite(time) & np.isfinite(values).all(axis=1))))
        raise ValueError(f"row {row + 1} is not finite: leave it out or interpolate it")
    if not (np.diff(time) > 0).all():
        row = int(np.argmax(np.diff(time) <= 0)) + 1
        raise ValueError(f"time does not increase at row {row + 1}: {time[row - 1]:.6g} s, then {time[row]:.6g} s")
    grid = np.arange(time[0], time[-1], 1 / rate)
    return grid, np.stack([np.interp(grid, time, column) for column in values.T], axis=1)


def low_pass(values: Array, *, rate: float, cutoff: float) -> Array:
    """Zero-phase Butterworth low-pass along the first axis.

    Raises:
        ValueError: the cut-off is not between 0 and half the rate, or there are too few samples.
    """
    if not 0 < cutoff < rate / 2:
        raise ValueError(f"cut-off {cutoff:g} Hz must be above 0 and below half the rate, {rate / 2:g} Hz")
    sections = signal.butter(FILTER_ORDER, cutoff, fs=rate, output="sos")
    filtered: Array = signal.sosfiltfilt(sections, values, axis=0)
    return filtered


def motion(joints: tuple[str, ...], time: Array, position: Array, *, rate: float, cutoff: float) -> Motion:
    """The motion behind measured positions.

    Args:
        joints: names, n.
        time, position: (S,) [s] and (S, n) [m, rad], as recorded.
        rate: of the grid [Hz].
        cutoff: of the low-pass [Hz]; well above what the motion holds, well below the noise.
    """
    grid, values = uniform(time, position, rate)
    smooth = low_pass(values, rate=rate, cutoff=cutoff)
    velocity = np.gradient(smooth, 1 / rate, axis=0)
    return Motion(joints, grid, smooth, velocity, np.gradient(velocity, 1 / rate, axis=0))


def free_model(robot: str) -> mujoco.MjModel:
    """A robot of :data:`tiago_mj.models.scene.ROBOTS` alone: no contacts, no joint limits, no gravity compensation."""
    model = mujoco.MjModel.from_xml_path(str(model_file(f"robots/{robot}.xml")))
    model.body_gravcomp[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    return model


def torque(model: mujoco.MjModel, motion: Motion) -> Array:
    """Torque that each joint's drive needed, (T, n) [N·m, N]; joints that are not in the motion stand in ``pre_grasp``.

    Raises:
        ValueError: the model has no joint of that name.
    """
    there = [model.joint(i).name for i in range(model.njnt)]
    for name in motion.joints:
        if name not in there:
            raise ValueError(f"the model has no joint {name!r}: it has {', '.join(there)}")
    position = [int(model.joint(name).qposadr[0]) for name in motion.joints]
    velocity = [int(model.joint(name).dofadr[0]) for name in motion.joints]
    data = mujoco.MjData(model)
    data.qpos[:] = model.key("pre_grasp").qpos
    needed = np.empty_like(motion.position)
    for t in range(len(motion.time)):
        data.qpos[position] = motion.position[t]
        data.qvel[velocity] = motion.velocity[t]
        data.qacc[velocity] = motion.acceleration[t]
        mujoco.mj_inverse(model, data)
        needed[t] = data.qfrc_inverse[velocity]
    return needed


def agreement(joint: str, measured: Array, predicted: Array) -> Agreement:
    """Compare two signals, (T,) each.

    Raises:
        ValueError: the measured one is constant: no share of its variance can be explained.
    """
    if measured.var() == 0:
        raise ValueError(f"the measured torque of {joint} is constant: leave it out")
    gap = measured - predicted
    return Agreement(
        joint=joint,
        measured_rms=_rms(measured),
        predicted_rms=_rms(predicted),
        gap_rms=_rms(gap),
        bias=float(gap.mean()),
        explained=float(1 - gap.var() / measured.var()),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
