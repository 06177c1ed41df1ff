"""Episodes of many seeds, in this process or in many."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import gymnasium

from tiago_mj.rollout import scale
from tiago_mj.rollout.episode import Episode, Policy, Trace, play, summarise
from tiago_mj.rollout.options import make_env
from tiago_mj.rollout.policies import RANDOM, make_policy

#: Episodes of one task, at most: enough to spread the cost of making an environment, and little to lose with a node.
EPISODES: Final = 4


@dataclass(frozen=True)
class Batch:
    """Episodes that are played one after the other.

    Attributes:
        env: id, with its namespace.
        env_options: its arguments.
        policy: name or file, as :func:`~tiago_mj.rollout.policies.make_policy` takes it.
        seeds: of the episodes.
        trust: whether files may be unpickled.
    """

    env: str
    env_options: Mapping[str, Any]
    policy: str
    seeds: tuple[int, ...]
    trust: bool


def play_seeds(
    env: gymnasium.Env[Any, Any],
    policy: str,
    seeds: Sequence[int],
    *,
    trust: bool = False,
    watch: Callable[[int], None] | None = None,
) -> Iterator[Trace]:
    """Play a policy once a seed; an episode depends on its seed and on no other episode.

    Args:
        env: one that ends.
        policy: name or file, as :func:`~tiago_mj.rollout.policies.make_policy` takes it.
        seeds: of the episodes.
        trust: whether files may be unpickled.
        watch: called with 0 after a reset and with t after control step t; takes the film.

    Raises:
        ValueError: the policy cannot be had, or does not fit the environment.
    """
    commander: Policy | None = None
    for seed in seeds:
        if commander is None or policy == RANDOM:  # the others forget; this one's actions follow from its seed
            commander = make_policy(policy, env, seed=seed, trust=trust)
        yield play(env, commander, seed=seed, watch=watch)


def play_in(env: gymnasium.Env[Any, Any], batch: Batch, *, watch: Callable[[int], None] | None = None) -> list[Episode]:
    """Play a batch in a given environment; see :func:`play_seeds`."""
    traces = play_seeds(env, batch.policy, batch.seeds, trust=batch.trust, watch=watch)
    return [summarise(trace, seed) for trace, seed in zip(traces, batch.seeds, strict=True)]


def play_batch(batch: Batch) -> list[Episode]:
    """Play a batch in an environment of its own."""
    env = make_env(batch.env, batch.env_options)
    try:
        return play_in(env, batch)
    finally:
        env.close()


def play_all(
    batch: Batch, *, jobs: int = 1, backend: str = "local", done: Callable[[int], None] | None = None
) -> list[Episode]:
    """Play a batch in many processes; the episodes are those of :func:`play_batch`.

    Args:
        batch: what is played.
        jobs, backend: as :func:`tiago_mj.rollout.scale.run_all` takes them.
        done: called with the number of episodes that are done since it was called last.
    """
    size = max(1, min(EPISODES, len(batch.seeds) // (jobs or os.cpu_count() or 1)))
    parts = [replace(batch, seeds=batch.seeds[first : first + size]) for first in range(0, len(batch.seeds), size)]
    told = None if done is None else lambda part: done(len(part.seeds))
    played: Sequence[list[Episode]] = scale.run_all(play_batch, parts, jobs=jobs, backend=backend, done=told)
    return [episode for part in played for episode in part]
