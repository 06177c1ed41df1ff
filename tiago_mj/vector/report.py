"""A vector environment's ``info``, in gymnasium's form: arrays, and which environments each is of."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def of_all(facts: Mapping[str, Any], everyone: Mask) -> dict[str, Any]:
    """What is known of every environment: ``key`` and ``_key``, also within dictionaries."""
    info: dict[str, Any] = {}
    for key, value in facts.items():
        info[key] = of_all(value, everyone) if isinstance(value, dict) else value
        info[f"_{key}"] = everyone
    return info


def of_some(facts: Mapping[str, Any], some: Mask) -> dict[str, Any]:
    """The same of some environments: zeros for the others."""
    info: dict[str, Any] = {}
    for key, value in facts.items():
        if isinstance(value, Mapping):
            info[key] = of_some(value, some)
        else:
            shown = np.zeros_like(value)
            shown[some] = value[some]
            info[key] = shown
        info[f"_{key}"] = some.copy()
    return info


def one_by_one(observation: Any, some: Mask) -> NDArray[np.object_]:
    """The observations of some environments, each for itself; None for the others."""
    listed = np.full(len(some), None, dtype=object)
    for k in np.flatnonzero(some).tolist():
        if isinstance(observation, Mapping):
            listed[k] = {key: value[k].copy() for key, value in observation.items()}
        else:
            listed[k] = observation[k].copy()
    return listed


class Episodes:
    """Length, return and duration of every environment's present episode."""

    def __init__(self, count: int) -> None:
        self.length = np.zeros(count, dtype=np.int64)
        self.total = np.zeros(count)
        self._begun = np.full(count, time.perf_counter())

    def begin(self, rows: NDArray[np.intp]) -> None:
        """A new episode."""
        self.length[rows], self.total[rows], self._begun[rows] = 0, 0.0, time.perf_counter()

    def add(self, reward: Array, stepped: Mask | None) -> None:
        """A step; ``stepped``: of which environments, None: of all."""
        if stepped is None:
            self.length += 1
            self.total += reward
        else:
            self.length[stepped] += 1
            self.total[stepped] += reward[stepped]

    def statistics(self, ended: Mask) -> dict[str, Any]:
        """Return ``r``, length ``l`` and seconds ``t`` of those that ended, as gymnasium's wrapper has them."""
        seconds = np.round(time.perf_counter() - self._begun, 6)
        return {
            "r": np.where(ended, self.total, 0.0),
            "l": np.where(ended, self.length, 0),
            "t": np.where(ended, seconds, 0.0),
        }
