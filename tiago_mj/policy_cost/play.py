"""Episodes of a policy, in any environment of gymnasium: the return, and whether the end was a success."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import gymnasium

from tiago_mj.rollout.episode import Policy

#: An episode that is longer than this does not end, as far as anybody waits [control steps]: at 240 Hz seven minutes.
MOST_STEPS: Final = 100_000


@dataclass(frozen=True)
class Outcome:
    """What came of an episode.

    Attributes:
        episode_return: sum of the environment's rewards.
        success: at its end, 0 or 1, as ``info["is_success"]`` says; None where that says nothing.
    """

    episode_return: float
    success: float | None


def play(env: gymnasium.Env[Any, Any], policy: Policy, seed: int) -> Outcome:
    """Play one episode to its end.

    Raises:
        ValueError: it does not end; one line.
    """
    observation, info = env.reset(seed=seed)
    policy.reset()
    return finish(env, policy, observation, info, None)


def finish(
    env: gymnasium.Env[Any, Any], policy: Policy, observation: Any, info: dict[str, Any], steps: int | None
) -> Outcome:
    """Play from where an episode is, to its end or so many steps.

    Raises:
        ValueError: it does not end; one line.
    """
    total, success = 0.0, None
    for _ in range(MOST_STEPS if steps is None else steps):
        observation, reward, terminated, truncated, info = env.step(policy(observation, info))
        total += float(reward)
        if "is_success" in info:
            success = float(info["is_success"])
        if terminated or truncated:
            return Outcome(total, success)
    if steps is None:
        raise ValueError(
            f"an episode has not ended after {MOST_STEPS} steps: give the environment a time limit, as "
            "gymnasium.wrappers.TimeLimit does"
        )
    return Outcome(total, success)


def play_all(env: gymnasium.Env[Any, Any], policy: Policy, seeds: Sequence[int]) -> list[Outcome]:
    """One episode a seed."""
    return [play(env, policy, seed) for seed in seeds]
