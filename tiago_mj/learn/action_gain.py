"""Actions that an environment clips: what an agent asks for is multiplied, and cut at the joints' limits.

In the 2021 project an action was a velocity in a box of ±1 m/s, which the fingers' limit of 0.08 m/s cut. The paper's
exploration noise N(0, 0.1) was therefore 1.25 times the fingers' full speed, and almost every action was full speed one
way or the other. Here an action of 1 is full speed; a gain of 12.5 brings those conditions back.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnvWrapper


class ActionGain(VecEnvWrapper):  # type: ignore[misc]
    """A vector environment whose actions are multiplied by ``gain`` and clipped to their space.

    Args:
        venv: of stable-baselines3.
        gain: above 0.
    """

    def __init__(self, venv: Any, gain: float) -> None:
        super().__init__(venv)
        self.gain = gain

    def reset(self) -> Any:
        """Begin an episode of every environment."""
        return self.venv.reset()

    def step_async(self, actions: Any) -> None:
        """Take the actions, (num_envs, n), of the next step."""
        space = self.venv.action_space
        self.venv.step_async(np.clip(np.asarray(actions) * np.float32(self.gain), space.low, space.high))

    def step_wait(self) -> Any:
        """Step."""
        return self.venv.step_wait()


def gain_of(env: Any) -> float:
    """The gain of an environment's actions: 1 where nothing multiplies them."""
    while env is not None:
        if isinstance(env, ActionGain):
            return env.gain
        env = getattr(env, "venv", None)
    return 1.0
