"""What a user hands to an environment, read or refused in one line before anything changes; and how rendering fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import error
from numpy.typing import NDArray

from tiago_mj.io.quoting import quoted
from tiago_mj.view import headless

Array = NDArray[np.float64]


def action_in_range(action: Any, joints: Sequence[str]) -> Array:
    """An action as floats, clipped to [-1, 1], (njoints,).

    Raises:
        ValueError: it is not numeric, of another shape, or not finite.
    """
    shape = (len(joints),)
    if type(action) is np.ndarray:
        given = action
    else:
        try:
            given = np.asarray(action)
        except ValueError:  # a ragged list
            given = np.asarray(None)
    if given.dtype.kind not in "biuf":
        raise ValueError(f"action {quoted(action)} is not numeric: give {len(joints)} numbers from -1 to 1")
    if given.shape != shape:
        raise ValueError(f"action has shape {given.shape}: give {shape}, one number a joint of {tuple(joints)}")
    numbers = given.tolist()
    # What is finite may have a sum that is not, and a long double may be larger than any float.
    if not math.isfinite(sum(numbers)) and not np.isfinite(given).all():
        raise ValueError(f"action {given} is not finite: give numbers from -1 to 1")
    if min(numbers) < -1.0 or max(numbers) > 1.0:
        given = np.clip(given, -1.0, 1.0)
    return given.astype(np.float64)


def whole_number(name: str, value: Any, most: int) -> int:
    """A whole number from 1 to ``most``.

    Raises:
        ValueError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= most:
        raise ValueError(f"{name} is {quoted(value)}: give a whole number from 1 to {most}")
    return int(value)


def goal_numbers(goal: Any, size: int) -> Array:
    """A goal as floats, (size,); one number serves all.

    Raises:
        ValueError: it is not numeric, of another shape, or not finite.
    """
    try:
        values = np.array(goal, dtype=np.float64)
        if values.shape != (size,):
            values = np.broadcast_to(values, (size,)).copy()
    except (TypeError, ValueError, OverflowError) as fault:
        raise ValueError(f"goal {quoted(goal)} is not usable: give {size} numbers") from fault
    if not np.isfinite(values).all():
        raise ValueError(f"goal {quoted(goal)} is not finite: give {size} numbers")
    return values


def reset_options(options: Any, known: Sequence[str]) -> dict[str, Any]:
    """The options of a reset.

    Raises:
        ValueError: they are no mapping, or one of them is unknown.
    """
    listed = ", ".join(repr(name) for name in known)
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise ValueError(f"reset options {quoted(options)} are no mapping: give a dict with {listed}, or nothing")
    for name in options:
        if name not in known:
            raise ValueError(f"reset option {quoted(name)} is unknown: there is {listed}")
    return dict(options)


def begun(begins: bool, ended: bool, call: str) -> None:
    """Refuse a call of an environment that is not in an episode.

    Args:
        begins: whether an episode has begun.
        ended: whether the environment was closed.
        call: what was called.

    Raises:
        gymnasium.error.ResetNeeded, gymnasium.error.ClosedEnvironmentError: one line.
    """
    if ended:
        raise closed()
    if not begins:
        raise error.ResetNeeded(f"reset() must be called before {call}()")


def closed() -> error.ClosedEnvironmentError:
    """What is said of an environment that was closed."""
    return error.ClosedEnvironmentError("the environment was closed: make a new one with gymnasium.make")


def rendered(frame: Callable[[], Any], mode: str | None, started: Callable[[], bool]) -> Any:
    """A frame, or an error that says what to set.

    Args:
        frame: draws it.
        mode: the environment's render mode.
        started: whether OpenGL is running, so that a fault has another cause.

    Raises:
        gymnasium.error.DependencyNotInstalled: no OpenGL could be started, or there is no display for a window.
    """
    if mode == "human" and headless.without_display():
        raise error.DependencyNotInstalled(  # GLFW would end the process instead
            "render_mode 'human' needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set: use "
            "render_mode='rgb_array', which renders without one"
        )
    try:
        return frame()
    except Exception as fault:
        if started():
            raise
        raise error.DependencyNotInstalled(
            "no OpenGL context could be created. Without a display set the environment variable MUJOCO_GL=egl before "
            f"Python starts, and install EGL ({headless.LIBRARIES['egl'][1]}). Cause: {cause_of(fault)}"
        ) from fault


def cause_of(fault: Exception) -> str:
    """Why nothing can be rendered, in one line."""
    return "; ".join(headless.complaints) or " ".join(str(fault).split())
