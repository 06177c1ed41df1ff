"""Imitation with corrections: the agent acts, and a controller says at every step what it would have done there.

An actor that only imitates what a controller did goes astray where the controller never was. So the controller acts
first, and afterwards the actor itself; the controller's actions for all that was seen are what the actor learns
(DAgger, Ross, Gordon and Bagnell 2011, arXiv 1011.0686). No reward is used. The replay buffer is what the paper calls
the aggregated data set: it holds the controller's actions, not those that were executed.
"""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3 import TD3
from torch.nn.functional import mse_loss

from tiago_mj.control.scripted import Scripted
from tiago_mj.envs.flat import core_of
from tiago_mj.learn.agent_file import Agent
from tiago_mj.learn.demonstrations import each_part
from tiago_mj.rollout.episode import Policy
from tiago_mj.rollout.policies import make_policy


class Dagger(TD3):  # type: ignore[misc]
    """TD3 whose actor imitates a controller (DAgger); the critics learn nothing.

    Attributes:
        expert: the controller; it remembers nothing, so that one serves all environments.
    """

    expert: Policy

    @property
    def acts(self) -> bool:
        """Whether the actor acts; until its first update the controller does."""
        return bool(self._n_updates > 0)

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """Update the actor to reduce the mean squared difference from the controller's actions over batches."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.actor.optimizer)
        for _ in range(gradient_steps):
            batch = self.replay_buffer.sample(batch_size, env=self._vec_normalize_env)
            loss = mse_loss(self.actor(batch.observations), batch.actions)
            self.actor.optimizer.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            self.actor.optimizer.step()
        self._n_updates += gradient_steps
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/actor_loss", loss.item())  # of the last update

    def _sample_action(self, learning_starts: int, action_noise: Any = None, n_envs: int = 1) -> tuple[Any, Any]:
        """Executed action, and the controller's action, which is stored."""
        wanted = self._corrections(n_envs)
        action = self.predict(self._last_obs, deterministic=True)[0] if self.acts else wanted
        if action_noise is not None:
            action = np.clip(action + action_noise(), -1.0, 1.0)
        return action, wanted

    def _corrections(self, count: int) -> NDArray[np.float32]:
        """The controller's actions for the observations, (environments, n)."""
        seen = self._last_obs if self._vec_normalize_env is None else self._last_original_obs
        rows = [each_part(seen, itemgetter(k)) for k in range(count)]
        return np.clip([self.expert(row, {}) for row in rows], -1.0, 1.0).astype(np.float32)


def expert_of(name: str, env: gymnasium.Env[Any, Any]) -> Policy:
    """A controller that can be imitated: its action depends on the present observation alone.

    Args:
        name: ``scripted``, or an agent's name or file.
        env: one of those that are trained on.

    Raises:
        ValueError: there is no such controller for it, or it knows what an agent does not see; one line.
    """
    policy = make_policy(name, env, seed=0, trust=False)
    if not isinstance(policy, (Scripted, Agent)):
        raise ValueError(
            f"expert {name} cannot be imitated: it does not decide by what is seen at one moment; use scripted, or an "
            "agent"
        )
    choice = getattr(core_of(env), "object_choice", None)
    if isinstance(policy, Scripted) and choice is not None and not choice.fixed:
        raise ValueError(
            "expert scripted looks at the object once, and here it is drawn for every episode: give one object, and no "
            "ranges of its width, mass, stiffness or damping"
        )
    return policy
