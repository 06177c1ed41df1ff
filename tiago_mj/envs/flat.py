"""The paper's flat observations, as views of the goal environments."""

from __future__ import annotations

from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from tiago_mj.envs.robot_env import RobotEnv

Array = NDArray[np.float64]

#: What marks a goal environment for stable-baselines3; a flat one must not have it.
_GOAL_FORM_ONLY: Final = frozenset({"compute_reward", "compute_terminated", "compute_truncated"})

#: Attributes that the view has for itself, and those that it has as well as the goal environment.
_OWN: Final = frozenset({"core", "observation_space", "spec", "_relative", "_np_random", "_np_random_seed"})
_SHARED: Final = frozenset({"action_space", "metadata", "render_mode"})


def core_of(env: gymnasium.Env[Any, Any]) -> Any:
    """The goal environment behind an environment, its wrappers and its flat view."""
    return getattr(env.unwrapped, "core", env.unwrapped)


class FlatView(gymnasium.Env[Array, Array]):
    """One vector in place of the dictionary: ``observation`` whose last entries are taken relative to the goal.

    For the tactile tasks this is the paper's (q, q̇, Δf_right, Δf_left), Δf = f − f_goal, f raw or binary; for a task
    whose ``observation`` does not hold what the goal is about (no force observed), it is ``observation`` as it stands.

    It is an environment, not a wrapper, because stable-baselines3 looks through wrappers and would take it for a goal
    environment. Everything else (``model``, ``data``, ``n_substeps``, ``joints`` …) is the goal environment's, which is
    ``core``: read there, and set there.

    Args:
        core: the goal environment.
        relative: number of last entries of ``observation`` from which the goal is subtracted.
    """

    def __init__(self, core: RobotEnv, relative: int) -> None:
        self.core = core
        self._relative = relative
        bound, goal = core.bounds()
        if relative:
            bound[-relative:] += goal
        self.observation_space = spaces.Box(-bound, bound, dtype=np.float64)
        self.action_space = core.action_space
        self.metadata = core.metadata
        self.render_mode = core.render_mode
        self._share_generator()

    def __getattr__(self, name: str) -> Any:
        if name == "core" or name.startswith("__") or name in _GOAL_FORM_ONLY:  # "core": while being unpickled
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return getattr(self.core, name)

    def __setattr__(self, name: str, value: Any) -> None:
        """What is set reaches the goal environment, as what is read comes from there."""
        if name in _OWN:
            object.__setattr__(self, name, value)
            return
        if name in _SHARED:
            object.__setattr__(self, name, value)
        setattr(self.core, name, value)
        if name == "np_random":
            self._share_generator()

    def step(self, action: Any) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """As the goal environment's, with the flat observation."""
        observation, reward, terminated, truncated, info = self.core.step(action)
        return self.flattened(observation), reward, terminated, truncated, info

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """As the goal environment's, with the flat observation."""
        observation, info = self.core.reset(seed=seed, options=options)
        self._share_generator()
        return self.flattened(observation), info

    def _share_generator(self) -> None:
        """There is one generator: the goal environment's, which a seed replaces."""
        self._np_random = self.core.np_random
        self._np_random_seed = self.core._np_random_seed

    def flattened(self, observation: dict[str, Array]) -> Array:
        """The vector of a dictionary that nobody else has, or of a batch of them: it is made in place."""
        flat = observation["observation"]
        if self._relative:
            forces = flat[..., -self._relative :]
            forces -= observation["desired_goal"]
        return flat

    def render(self) -> Any:
        """As the goal environment's."""
        return self.core.render()

    def close(self) -> None:
        """Release the renderer."""
        self.core.close()
