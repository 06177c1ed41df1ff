"""TD3's updates, on one thread 1.2 times as fast as stable-baselines3's with fused Adam, the same up to rounding.

That is of benchmarks/results/training_speed.json: 1.26 with batches of 100, 1.16 with 256.

A run of updates works on flat copies of networks and optimiser states: gradients are computed layer by layer
(:mod:`tiago_mj.learn.perceptron`), Adam and the targets' averages go over one array each, and the critic's weight
gradients, which the actor's update does not need, are not computed. Random numbers are drawn as stable-baselines3 draws
them. Afterwards everything is put back, so that a model can be saved, loaded and evaluated as any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import torch
from stable_baselines3 import TD3
from stable_baselines3.common.torch_layers import CombinedExtractor, FlattenExtractor
from torch import Tensor, nn

from tiago_mj.learn.demonstrations import Examples
from tiago_mj.learn.perceptron import stacked

#: Fewest updates for which copying there and back pays: it takes as long as about one update.
FEWEST: Final = 10
#: What Adam remembers of every number.
MOMENTS: Final = ("exp_avg", "exp_avg_sq")


class FastTD3(TD3):  # type: ignore[misc]
    """stable-baselines3's TD3 with faster updates where its networks are multilayer perceptrons with ReLU.

    Attributes:
        hold: for how many steps a random action is held. Drawn anew in every step, velocities cancel, and a joint
            hardly moves. Before learning starts all environments explore so.
        hold_share: share of the environments that go on exploring so afterwards; it falls to 0 over the training.
        leak: least slope that the actor's tanh is given where the critic pulls an action inwards. At an action of ±1
            the slope is 0, so that an actor that went there early would never come back, and little noise explores
            nothing else.
        action_cost: what the actor pays for the mean square of its actions, in units of reward. Where the critic is
            flat, as within a goal that was reached, nothing else keeps a robot from drifting out again.
        value_range: lowest and highest value that the critics are taught. Where rewards are 0 or -1, no value is above
            0, but critics that err to the good side where nothing was tried send a robot there. None: any.
        examples: demonstrated actions that the actor is pulled towards; None: there are none.
    """

    hold = 1
    hold_share = 0.0
    leak = 0.0
    action_cost = 0.0
    value_range: Sequence[float] | None = None
    examples: Examples | None = None

    def imitate(self, updates: int) -> None:
        """Learn from the demonstrations before the first step: the actor imitates, the critics learn what it earns.

        Args:
            updates: of the critics; the actor has one at every ``policy_delay``-th of them.
        """
        self.policy.set_training_mode(True)
        with torch.no_grad():
            descent = Descent(self)
            for k in range(updates):
                batch = self.replay_buffer.sample(self.batch_size, env=self._vec_normalize_env)
                descent.update(batch, also_actor=False)
                if k % self.policy_delay == 0:
                    descent.imitate()
            descent.put_back()

    def begin_episodes(self) -> None:
        """Forget what was held in the episodes before."""
        self._held: Any = None
        self._held_for = 0

    def _sample_action(self, learning_starts: int, action_noise: Any = None, n_envs: int = 1) -> tuple[Any, Any]:
        action, scaled = super()._sample_action(learning_starts, action_noise, n_envs)
        if self.hold == 1:
            return action, scaled
        left = 1.0 - self.num_timesteps / max(1, self._total_timesteps)
        count = n_envs if self.num_timesteps < learning_starts else round(self.hold_share * left * n_envs)
        if getattr(self, "_held", None) is None or self._held_for == self.hold:
            self._held, self._held_for = np.array([self.action_space.sample() for _ in range(n_envs)]), 0
        self._held_for += 1
        action, scaled = action.copy(), scaled.copy()
        action[:count] = self._held[:count]
        scaled[:count] = self.policy.scale_action(self._held[:count])
        return action, scaled

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """Do a number of updates of the critics, and of actor and targets at every ``policy_delay``-th of them."""
        ours = self.leak or self.action_cost or self.value_range is not None or self.examples is not None
        if (gradient_steps < FEWEST and not ours) or not plain(self):
            super().train(gradient_steps, batch_size)
            return
        self.policy.set_training_mode(True)
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer])
        with torch.no_grad():
            descent = Descent(self)
            for _ in range(gradient_steps):
                self._n_updates += 1
                batch = self.replay_buffer.sample(batch_size, env=self._vec_normalize_env)
                descent.update(batch, also_actor=self._n_updates % self.policy_delay == 0)
            descent.put_back()
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/critic_loss", descent.critic_loss)  # of the last update
        self.logger.record("train/actor_loss", descent.actor_loss)


class Descent:
    """A run of updates of a TD3 model.

    Args:
        model: its networks and optimisers are copied.
    """

    def __init__(self, model: TD3) -> None:
        self._model, self._leak = model, float(getattr(model, "leak", 0.0))
        self._action_cost = float(getattr(model, "action_cost", 0.0))
        self._value_range = getattr(model, "value_range", None)
        self._actor_numbers = [list(model.actor.mu.parameters())]
        self._critic_numbers = [list(network.parameters()) for network in model.critic.q_networks]
        actor_targets = [list(model.actor_target.mu.parameters())]
        critic_targets = [list(network.parameters()) for network in model.critic_target.q_networks]
        self._targets = [*actor_targets, *critic_targets]
        self._actor_flat, (self._actor,) = stacked(self._actor_numbers)
        self._critic_flat, self._critics = stacked(self._critic_numbers)
        self._actor_target_flat, (self._actor_target,) = stacked(actor_targets)
        self._critic_target_flat, self._critic_targets = stacked(critic_targets)
        self._actor_flat.grad, (self._actor_gradient,) = stacked(self._actor_numbers)
        _, (self._example_gradient,) = stacked(self._actor_numbers)
        self._critic_flat.grad, self._critic_gradients = stacked(self._critic_numbers)
        self._actor_adam = _adam(model.actor.optimizer, self._actor_numbers, self._actor_flat)
        self._critic_adam = _adam(model.critic.optimizer, self._critic_numbers, self._critic_flat)
        self.actor_loss = self.critic_loss = 0.0

    def update(self, batch: Any, *, also_actor: bool) -> None:
        """One update of the critics; of the actor and all targets if asked."""
        model = self._model
        seen = model.actor.extract_features(batch.observations, model.actor.features_extractor)
        following = model.actor.extract_features(batch.next_observations, model.actor.features_extractor)
        wanted = self._wanted(batch, following)
        given = torch.cat([seen, batch.actions], dim=1)
        self.critic_loss = 0.0
        for critic, gradient in zip(self._critics, self._critic_gradients, strict=True):
            values = critic.forward(given)
            error = values[-1] - wanted
            self.critic_loss += float(torch.mean(error * error))
            critic.backward(values, error.mul_(2 / len(error)), gradient)
        self._critic_adam.step()
        if also_actor:
            self._update_actor(seen)
            self._follow()

    def _wanted(self, batch: Any, following: Tensor) -> Tensor:
        """What the critics should say, (batch, 1): the lowest of the targets' values of a noisy action."""
        model = self._model
        noise = torch.empty_like(batch.actions).normal_(0, model.target_policy_noise)
        noise.clamp_(-model.target_noise_clip, model.target_noise_clip)
        action = self._actor_target.forward(following)[-1].tanh_().add_(noise).clamp_(-1, 1)
        given = torch.cat([following, action], dim=1)
        lowest = self._critic_targets[0].forward(given)[-1]
        for target in self._critic_targets[1:]:
            lowest = torch.minimum(lowest, target.forward(given)[-1])
        discount = model.gamma if batch.discounts is None else batch.discounts
        wanted = batch.rewards + (1 - batch.dones) * discount * lowest
        return wanted if self._value_range is None else wanted.clamp_(*self._value_range)

    def _update_actor(self, seen: Tensor) -> None:
        model, critic = self._model, self._critics[0]
        values = self._actor.forward(seen)
        action = values[-1].tanh_()
        judged = critic.forward(torch.cat([seen, action], dim=1))
        self.actor_loss = -float(judged[-1].mean())
        first = critic.backward(judged, torch.full_like(judged[-1], -1 / len(seen)), None)
        by_action = torch.mm(first, critic.weights[0][:, seen.shape[1] :])
        if self._action_cost:
            by_action.add_(action, alpha=2 * self._action_cost / action.numel())
            self.actor_loss += self._action_cost * float(torch.mean(action * action))
        slope = 1 - action * action
        if self._leak:
            slope = torch.where(by_action * action > 0, slope.clamp_min(self._leak), slope)
        self._actor.backward(values, by_action * slope, self._actor_gradient)
        if model.examples is not None:
            pull = model.examples.weight(model._current_progress_remaining) * float(judged[-1].abs().mean())
            self._actor_gradient.flat.add_(self._towards(model.examples), alpha=pull)
        self._actor_adam.step()

    def imitate(self) -> None:
        """Update the actor by the examples alone, and all targets."""
        self._actor_gradient.flat.copy_(self._towards(self._model.examples))
        self._actor_adam.step()
        self._follow()

    def _follow(self) -> None:
        self._critic_target_flat.lerp_(self._critic_flat, self._model.tau)
        self._actor_target_flat.lerp_(self._actor_flat, self._model.tau)

    def _towards(self, examples: Examples) -> Tensor:
        """Gradient of the mean squared difference to demonstrated actions, flat."""
        model = self._model
        observations, wanted = examples.drawn(model._vec_normalize_env)
        seen = model.actor.extract_features(observations, model.actor.features_extractor)
        values = self._actor.forward(seen)
        action = values[-1].tanh_()
        gradient = (action - wanted) * (2 / len(wanted))
        slope = (1 - action * action).clamp_min(self._leak)
        self._actor.backward(values, gradient * slope, self._example_gradient)
        return self._example_gradient.flat

    def put_back(self) -> None:
        """Give the model what was learned, and its optimisers what they remember."""
        model = self._model
        numbers = ((self._actor_numbers, self._actor_flat), (self._critic_numbers, self._critic_flat))
        for networks, flat in numbers:
            _put(networks, flat)
        _put(self._targets[:1], self._actor_target_flat)
        _put(self._targets[1:], self._critic_target_flat)
        _put_adam(self._actor_adam, model.actor.optimizer, self._actor_numbers, self._actor_flat)
        _put_adam(self._critic_adam, model.critic.optimizer, self._critic_numbers, self._critic_flat)


def plain(model: TD3) -> bool:
    """Whether all networks are perceptrons with ReLU on what is observed as it stands, and learn with Adam."""
    *hidden, squash = model.actor.mu
    modules = [*hidden, *(module for network in model.critic.q_networks for module in network)]
    extractors = {type(network.features_extractor) for network in (model.actor, model.critic)}
    return (
        isinstance(squash, nn.Tanh)
        and {type(module) for module in modules} <= {nn.Linear, nn.ReLU}
        and extractors <= {FlattenExtractor, CombinedExtractor}
        and all(type(network.optimizer) is torch.optim.Adam for network in (model.actor, model.critic))
    )


def _adam(optimizer: torch.optim.Adam, networks: Sequence[Sequence[Tensor]], flat: Tensor) -> torch.optim.Adam:
    """The same optimiser, for all numbers in one array."""
    group = {key: value for key, value in optimizer.param_groups[0].items() if key != "params"}
    same = torch.optim.Adam([flat], lr=group["lr"], fused=group["fused"])
    same.param_groups[0].update(group)
    parts = [part for network in networks for part in network]
    if optimizer.state:
        state = {key: torch.cat([optimizer.state[part][key].reshape(-1) for part in parts]) for key in MOMENTS}
        same.state[flat] = {"step": optimizer.state[parts[0]]["step"].clone(), **state}
    return same


def _put_adam(
    same: torch.optim.Adam, optimizer: torch.optim.Adam, networks: Sequence[Sequence[Tensor]], flat: Tensor
) -> None:
    state, begin = same.state[flat], 0
    if not state:  # fewer updates than the actor waits for
        return
    for part in (part for network in networks for part in network):
        here = slice(begin, begin + part.numel())
        moments = {key: state[key][here].view(part.shape).clone() for key in MOMENTS}
        optimizer.state[part] = {"step": state["step"].clone(), **moments}
        begin += part.numel()


def _put(networks: Sequence[Sequence[Tensor]], flat: Tensor) -> None:
    begin = 0
    for part in (part for network in networks for part in network):
        part.data.copy_(flat[begin : begin + part.numel()].view(part.shape))
        begin += part.numel()
