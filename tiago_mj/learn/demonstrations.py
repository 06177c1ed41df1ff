"""Demonstrations: episodes of a controller, in the replay buffer before the agent has acted, and as examples for it.

An agent that has never touched an object cannot learn what touching is worth. The episodes are replayed as the agent's
own are, with hindsight where there is hindsight. Before its first step the actor imitates the controller and the
critics learn what that earns; from then on the actor is pulled towards the controller's actions, less and less (TD3
with behaviour cloning, Fujimoto and Gu 2021, arXiv 2106.06860, equation 3, whose 1 / 2.5 is a weight of 0.4 here).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.learn.environments import make_one_env
from tiago_mj.learn.settings import Settings
from tiago_mj.rollout.policies import make_policy

#: Seed of the first demonstrated episode of seed 0; evaluations have other ones.
FIRST_SEED: Final = 2_000_000


@dataclass(frozen=True)
class Demonstrations:
    """Transitions of a controller; every array is (steps, environments, ...), dictionaries of arrays in the goal form.

    Attributes:
        observations, next_observations: of the environments.
        actions: that were executed, noise included.
        intended: the controller's, without noise.
        rewards: of the steps.
        ended: whether an episode was over with the step.
    """

    observations: Any
    next_observations: Any
    actions: NDArray[np.float32]
    intended: NDArray[np.float32]
    rewards: NDArray[np.float64]
    ended: NDArray[np.bool_]


def played(settings: Settings, count: int, seed: int) -> Demonstrations:
    """Demonstrations of the controller that the hyperparameters name.

    Args:
        settings: of the training.
        count: environments that are played side by side.
        seed: of the training; another seed has other episodes.

    Raises:
        ValueError: there is no such controller for this environment; one line.
    """
    asked: Mapping[str, Any] = settings.hyperparameters["demonstrations"]
    each = episodes_each(asked, count)
    columns = []
    for k in range(count):
        env = make_one_env(settings)
        try:
            policy = make_policy(asked["policy"], env, seed=0, trust=False)
            first = FIRST_SEED + (seed * count + k) * each
            rng = np.random.default_rng([seed, k])
            episodes = (_episode(env, policy, first + n, asked["noise"], rng) for n in range(each))
            columns.append([row for rows in episodes for row in rows])
        finally:
            env.close()
    shortest = min(len(column) for column in columns)
    steps = [[column[t] for column in columns] for t in range(shortest)]
    parts = [[[row[field] for row in step] for step in steps] for field in range(6)]
    return Demonstrations(*(_stacked(part) for part in parts))


def episodes_each(asked: Mapping[str, Any], count: int) -> int:
    """Number of episodes for each of ``count`` environments, for a total of at least those asked for."""
    return -(-int(asked["episodes"]) // count)


def store(found: Demonstrations, buffer: Any) -> None:
    """Add demonstrations to a replay buffer of stable-baselines3."""
    for t in range(len(found.rewards)):
        ended = found.ended[t]
        buffer.add(
            _at(found.observations, t),
            _at(found.next_observations, t),
            found.actions[t],
            found.rewards[t],
            ended,
            [{"TimeLimit.truncated": bool(one)} for one in ended],
        )


def show(found: Demonstrations, normalised: Any) -> None:
    """Update the statistics of a ``VecNormalize`` with their observations."""
    if not (normalised.norm_obs and normalised.training):
        return
    seen, statistics = found.observations, normalised.obs_rms
    pairs = [(seen[name], one) for name, one in statistics.items()] if isinstance(seen, dict) else [(seen, statistics)]
    for part, one in pairs:
        one.update(part.reshape(-1, part.shape[-1]))


class Examples:
    """Demonstrated actions for the imitation loss of the actor.

    Args:
        found: demonstrations.
        weight: of the mean squared difference, in units of the critic's mean value, at the beginning.
        keep: share of the weight to which it falls over the training.
        batch: how many are compared with at each update of the actor.
    """

    def __init__(self, found: Demonstrations, weight: float, keep: float = 0.0, batch: int = 256) -> None:
        self._weight, self._keep, self._batch = weight, keep, batch
        self._seen = each_part(found.observations, lambda part: part.reshape(-1, *part.shape[2:]).astype(np.float32))
        self._actions = found.intended.reshape(-1, found.intended.shape[-1])

    def weight(self, left: float) -> float:
        """Weight of the imitation loss at a remaining share of the training, from 1 to 0."""
        return self._weight * (self._keep + (1.0 - self._keep) * left)

    def drawn(self, normalised: Any = None) -> tuple[Any, Any]:
        """A random batch: normalised observations and actions, (batch, n) tensors.

        Args:
            normalised: a ``VecNormalize`` whose statistics observations are normalised by; None: they are not.
        """
        import torch

        rows = torch.randint(len(self._actions), (self._batch,)).numpy()
        seen = each_part(self._seen, lambda part: part[rows])
        if normalised is not None:
            seen = normalised.normalize_obs(seen)
        return each_part(seen, torch.as_tensor), torch.as_tensor(self._actions[rows])


def _episode(env: Any, policy: Any, seed: int, noise: float, rng: np.random.Generator) -> list[tuple[Any, ...]]:
    """One episode, step by step: the fields of :class:`Demonstrations`."""
    observation, info = env.reset(seed=seed)
    policy.reset()
    rows, over = [], False
    while not over:
        intended = np.asarray(policy(observation, info), dtype=np.float32)
        drawn = intended + noise * rng.standard_normal(intended.shape)
        action = np.clip(drawn, env.action_space.low, env.action_space.high).astype(np.float32)
        following, reward, terminated, truncated, info = env.step(action)
        over = bool(terminated or truncated)
        rows.append((observation, following, action, np.clip(intended, -1.0, 1.0), reward, over))
        observation = following
    return rows


def _stacked(rows: Sequence[Sequence[Any]]) -> Any:
    """Arrays from [step][environment], (steps, environments, ...), one for each key of dictionaries."""
    if isinstance(rows[0][0], dict):
        return {name: np.array([[one[name] for one in step] for step in rows]) for name in rows[0][0]}
    return np.array(rows)


def _at(part: Any, t: int) -> Any:
    return each_part(part, lambda one: one[t])


def each_part(part: Any, change: Callable[[Any], Any]) -> Any:
    """A function applied to an observation, or to each entry of a dictionary of them."""
    return {name: change(one) for name, one in part.items()} if isinstance(part, dict) else change(part)
