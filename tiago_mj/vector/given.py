"""What a user hands to a vector environment, read or refused in one line before anything changes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from tiago_mj.io.quoting import quoted

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Where the system does not say how much memory is free [B]: what a small machine has.
UNKNOWN_MEMORY: Final = 4e9


def number_of_simulations(num_envs: Any, each: int) -> int:
    """How many simulations to make.

    Args:
        num_envs: what the user asked for.
        each: memory of one [B].

    Raises:
        ValueError: no whole number above 0, or more than there is memory for.
    """
    if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
        raise ValueError(f"num_envs is {quoted(num_envs)}: give a whole number of environments, 1 or more")
    free = _free_memory()
    if num_envs * each > free:
        raise ValueError(
            f"num_envs is {num_envs}: they need about {num_envs * each / 1e9:.3g} GB and {free / 1e9:.3g} GB are free; "
            f"give at most {int(free // each)}"
        )
    return int(num_envs)


def number_of_threads(threads: Any, simulations: int) -> int:
    """How many threads to step on: those asked for, else one a processor that this process may use.

    Raises:
        ValueError: no whole number from 0 to 1024; 0 is all processors.
    """
    if isinstance(threads, bool) or not isinstance(threads, (int, np.integer)) or not 0 <= threads <= 1024:
        raise ValueError(f"threads is {quoted(threads)}: give a whole number from 1 to 1024, or 0 for all processors")
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(int(threads) or processors, simulations)


def autoreset(mode: Any) -> AutoresetMode:
    """When an environment that has ended begins again.

    Raises:
        ValueError: no such mode; says which there are.
    """
    try:
        return mode if isinstance(mode, AutoresetMode) else AutoresetMode(mode)
    except ValueError as fault:
        known = ", ".join(repr(known.value) for known in AutoresetMode)
        raise ValueError(
            f"autoreset_mode {quoted(mode)} is unknown: use one of {known}, or gymnasium's AutoresetMode"
        ) from fault


def time_limit(steps: Any) -> int | None:
    """Control steps of an episode, or None for no limit.

    Raises:
        ValueError: no whole number above 0.
    """
    if steps is None:
        return None
    if isinstance(steps, bool) or not isinstance(steps, (int, np.integer)) or steps < 1:
        raise ValueError(f"max_episode_steps is {quoted(steps)}: give a whole number of steps, 1 or more")
    return int(steps)


def actions_in_range(actions: Any, shape: tuple[int, int]) -> tuple[Array, Mask | None]:
    """Actions as floats, clipped to [-1, 1], and which rows are not finite (None: all are).

    Raises:
        ValueError: they are not numeric or of another shape.
    """
    try:
        given = np.asarray(actions)
    except ValueError:  # a ragged list
        given = np.asarray(None)
    if given.dtype.kind not in "biuf":
        raise ValueError(f"actions are not numeric: give an array of shape {shape} with numbers from -1 to 1")
    if given.shape != shape:
        raise ValueError(f"actions have shape {given.shape}: give {shape}, a row an environment and a column a joint")
    finite = np.isfinite(given)
    refused: Mask | None = None
    if np.count_nonzero(finite) < finite.size:  # a fifth of the time of .all()
        refused = ~finite.all(axis=1)
        given = np.where(refused[:, None], 0.0, given)
    return np.minimum(np.maximum(given, -1.0), 1.0).astype(np.float64), refused


def seeds(seed: Any, count: int) -> list[int | None]:
    """One seed an environment: ``seed + i`` of a number, as gymnasium's vector environments have it.

    Raises:
        ValueError: not a whole number from 0, nor a list of as many as there are environments.
    """
    if seed is None:
        return [None] * count
    if isinstance(seed, (int, np.integer)) and not isinstance(seed, bool):
        listed: Sequence[Any] = [int(seed) + k for k in range(count)]
    elif isinstance(seed, (list, tuple, np.ndarray)):
        listed = list(seed)
    else:
        raise ValueError(f"seed is {quoted(seed)}: give a whole number, or a list of {count}, one an environment")
    if len(listed) != count:
        raise ValueError(f"{len(listed)} seeds for {count} environments: give one each, or a single number")
    for one in listed:
        if one is not None and (isinstance(one, bool) or not isinstance(one, (int, np.integer)) or one < 0):
            raise ValueError(f"seed {quoted(one)} is not usable: give whole numbers from 0, or None to go on as before")
    return [None if one is None else int(one) for one in listed]


def rows_to_reset(mask: Any, count: int) -> NDArray[np.intp]:
    """Which environments to reset.

    Raises:
        ValueError: no boolean array with one entry an environment, or none is chosen.
    """
    chosen = np.asarray(mask)
    if chosen.dtype != np.bool_ or chosen.shape != (count,) or not chosen.any():
        raise ValueError(
            f"reset option 'reset_mask' must be a boolean array of shape ({count},) with at least one True"
        )
    return np.flatnonzero(chosen)


def _free_memory() -> float:
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return UNKNOWN_MEMORY
