"""Conversion of a stable-baselines3 model to an agent file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from tiago_mj.learn.agent_file import ACTIVATIONS, Agent


def agent_of(model: Any, origin: Mapping[str, Any] | None = None) -> Agent:
    """Deterministic policy of a TD3, DDPG, SAC, PPO or A2C model with its normalisation, as an agent.

    Args:
        model: of stable-baselines3, with a multilayer perceptron.
        origin: where it comes from, kept in the file.

    Raises:
        ValueError: its policy is of another kind.
    """
    policy = model.policy
    actor = getattr(policy, "actor", None)
    if actor is not None and hasattr(actor, "latent_pi"):  # SAC
        modules, output = [*actor.latent_pi, actor.mu], "tanh"
    elif actor is not None:  # TD3, DDPG: the last module is the Tanh that "tanh" stands for
        modules, output = list(actor.mu)[:-1], "tanh"
    elif hasattr(policy, "mlp_extractor"):  # PPO, A2C
        modules, output = [*policy.mlp_extractor.policy_net, policy.action_net], "clip"
    else:
        raise ValueError(f"the policy of a {type(model).__name__} cannot be exported: TD3, DDPG, SAC, PPO and A2C can")
    layers, names = [], set()
    for module in modules:
        if hasattr(module, "weight"):
            layers.append(tuple(p.detach().cpu().numpy().copy() for p in (module.weight, module.bias)))
        else:
            names.add(type(module).__name__)
    if len(names) > 1 or not names <= set(ACTIVATIONS):
        raise ValueError(f"activations {', '.join(sorted(names))} cannot be exported: {', '.join(ACTIVATIONS)} can")
    space = model.observation_space
    parts = dict(space.spaces) if isinstance(space, gymnasium.spaces.Dict) else {"": space}
    inputs = tuple((key, int(np.prod(part.shape or (1,)))) for key, part in parts.items())
    mean, deviation, limit = _normalisation(model, inputs)
    return Agent(
        layers=tuple(layers),
        activation=names.pop() if names else "ReLU",
        output=output,
        inputs=inputs,
        low=model.action_space.low.astype(np.float32),
        high=model.action_space.high.astype(np.float32),
        mean=mean,
        deviation=deviation,
        limit=limit,
        origin=dict(origin or {}),
    )


def _normalisation(model: Any, inputs: tuple[tuple[str, int], ...]) -> tuple[Any, Any, float]:
    envs = model.get_vec_normalize_env()
    if envs is None or not envs.norm_obs:
        return None, None, 10.0
    means, variances = [], []
    for key, size in inputs:
        running = envs.obs_rms if not key else envs.obs_rms.get(key)
        means.append(np.zeros(size) if running is None else running.mean)
        variances.append(np.ones(size) - envs.epsilon if running is None else running.var)
    return np.concatenate(means), np.sqrt(np.concatenate(variances) + envs.epsilon), float(envs.clip_obs)
