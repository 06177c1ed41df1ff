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


class LoggedActions:
    """A policy that sends logged actions again, whatever it sees (open loop): of each episode in turn, then anew.

    :func:`tiago_mj.policy_cost.cost` plays as many episodes in each simulator as it is told: tell it as many as there
    are logged ones, so that each meets its own actions in every simulator.
    """

    def __init__(self, episodes: Sequence[Sequence[Any]]) -> None:
        """``episodes``: the actions of each, (T, n).

        Raises:
            ValueError: there is none, or one without actions; one line.
        """
        if not len(episodes) or not all(len(actions) for actions in episodes):
            raise ValueError("logged actions: give those of one episode or more, and one action or more of each")
        self._episodes, self._episode, self._step = episodes, -1, 0

    def reset(self) -> None:
        """The next episode begins."""
        self._episode, self._step = (self._episode + 1) % len(self._episodes), 0

    def __call__(self, observation: Any, info: dict[str, Any]) -> Any:
        """The next action; after the last one, that again."""
        actions = self._episodes[self._episode]
        self._step += 1
        return actions[min(self._step, len(actions)) - 1]
