"""The paper's flat observations, as views of the goal environments."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

Array = NDArray[np.float64]


class FlatView(gymnasium.ObservationWrapper[Array, Array, dict[str, Array]]):
    """One vector in place of the dictionary: `observation` whose last entries are taken relative to the goal.

    For the tactile tasks this is the paper's (q, q̇, Δf_right, Δf_left), Δf = f − f_goal, f raw or binary; for a task
    whose `observation` does not hold what the goal is about (no force observed), it is `observation` as it stands.

    Args:
        env: a goal environment.
        relative: number of last entries of `observation` from which the goal is subtracted.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], relative: int) -> None:
        super().__init__(env)
        inner = env.observation_space
        assert isinstance(inner, spaces.Dict)
        seen, goal = inner["observation"], inner["desired_goal"]
        assert isinstance(seen, spaces.Box) and isinstance(goal, spaces.Box)
        bound = seen.high.copy()
        if relative:
            bound[-relative:] += goal.high
        self._relative = relative
        self.observation_space = spaces.Box(-bound, bound, dtype=np.float64)

    def observation(self, observation: dict[str, Array]) -> Array:
        """The flat vector of a dictionary."""
        flat = observation["observation"].copy()
        if self._relative:
            flat[-self._relative :] -= observation["desired_goal"]
        return flat
