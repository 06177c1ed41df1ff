"""Episodes of many seeds, in this process or in many."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import gymnasium

from tiago_mj import scale
from tiago_mj.rollout.episode import Episode, Policy, play, summarise
from tiago_mj.rollout.policies import RANDOM, make_policy

#: Episodes of one task, at most: enough to spread the cost of making an environment, and little to lose with a node.
EPISODES: Final = 4


@dataclass(frozen=True)
class Batch:
    """Episodes that are played one after the other.

    Attributes:
        env: id, with its namespace.
        policy: name or file, as :func:`~tiago_mj.rollout.policies.make_policy` takes it.
        seeds: of the episodes.
        trust: whether files may be unpickled.
    """

    env: str
    policy: str
    seeds: tuple[int, ...]
    trust: bool


def play_seeds(
    env: gymnasium.Env[Any, Any], batch: Batch, *, watch: Callable[[int], None] | None = None
) -> list[Episode]:
    """Play a batch in an environment that is there; an episode depends on its seed and on no other episode.

    Raises:
        ValueError: the policy cannot be had, or does not fit the environment.
    """
    policy: Policy | None = None
    episodes = []
    for seed in batch.seeds:
        if policy is None or batch.policy == RANDOM:  # the others forget; this one's actions follow from its seed
            policy = make_policy(batch.policy, env, seed=seed, trust=batch.trust)
        episodes.append(summarise(play(env, policy, seed=seed, watch=watch), seed))
    return episodes


def play_batch(batch: Batch) -> list[Episode]:
    """Play a batch in an environment of its own."""
    env = gymnasium.make(batch.env)
    try:
        return play_seeds(env, batch)
    finally:
        env.close()


def play_all(batch: Batch, *, jobs: int = 1, backend: str = "local") -> list[Episode]:
    """Play a batch in many processes; the episodes are those of :func:`play_batch`.

    Args:
        batch: what is played.
        jobs, backend: as :func:`tiago_mj.scale.run_all` takes them.
    """
    size = max(1, min(EPISODES, len(batch.seeds) // (jobs or os.cpu_count() or 1)))
    parts = [
        Batch(batch.env, batch.policy, batch.seeds[first : first + size], batch.trust)
        for first in range(0, len(batch.seeds), size)
    ]
    played: Sequence[list[Episode]] = scale.run_all(play_batch, parts, jobs=jobs, backend=backend)
    return [episode for part in played for episode in part]
