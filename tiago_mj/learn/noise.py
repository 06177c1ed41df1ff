"""Exploration noise: of stable-baselines3, constant or falling to 0 over a training.

Noise finds what to do and then stands in the way: an agent that holds a force learns from forces that its own noise
shakes. ``noise_std: lin_0.3`` lets it fall, as ``lin_1e-3`` does the learning rate. What is independent from step to
step hardly moves a finger; ``noise_type: ornstein-uhlenbeck`` wanders, and so closes and opens it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import ActionNoise, NormalActionNoise, OrnsteinUhlenbeckActionNoise

#: What a value that falls to 0 begins with.
FALLING: Final = "lin_"


class Falling(ActionNoise):  # type: ignore[misc]
    """Action noise scaled by the remaining share of the training.

    Args:
        noise: at the training's start.
    """

    def __init__(self, noise: ActionNoise) -> None:
        super().__init__()
        self._noise, self.share = noise, 1.0

    def __call__(self) -> NDArray[np.float32]:
        """Noise of one step, (n,)."""
        drawn: NDArray[np.float32] = self._noise() * np.float32(self.share)
        return drawn

    def reset(self) -> None:
        """Begin an episode."""
        self._noise.reset()


class Fall(BaseCallback):  # type: ignore[misc]
    """Callback that tells decaying noise the remaining share of the training.

    Args:
        steps: of the training.
    """

    def __init__(self, steps: int) -> None:
        super().__init__()
        self._steps = steps

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        noise = getattr(self.model, "action_noise", None)
        for one in getattr(noise, "noises", [noise]):  # one each of several environments
            if isinstance(one, Falling):
                one.share = max(0.0, 1.0 - self.model.num_timesteps / self._steps)


def noise_of(given: Mapping[str, Any], shape: tuple[int, ...]) -> ActionNoise | None:
    """Action noise of the hyperparameters; None for none.

    Args:
        given: checked hyperparameters with ``noise_type`` and ``noise_std``.
        shape: of an action.
    """
    if given.get("noise_type") is None:
        return None
    kind = NormalActionNoise if given["noise_type"] == "normal" else OrnsteinUhlenbeckActionNoise
    deviation = given.get("noise_std", 0.0)
    falls = isinstance(deviation, str)
    noise = kind(np.zeros(shape), np.full(shape, float(deviation.removeprefix(FALLING) if falls else deviation)))
    return Falling(noise) if falls else noise
