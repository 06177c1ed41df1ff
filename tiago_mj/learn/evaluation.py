"""Evaluation of a policy during training: the same few episodes every time, in parallel."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from tiago_mj.learn.agent_file import Agent

#: Seed of the first evaluation episode; training seeds are far below. Later ones add 1.
FIRST_SEED: Final = 1_000_000


class Evaluator:
    """Plays evaluation episodes.

    Args:
        env: of :func:`tiago_mj.learn.environments.make_env`, one environment an episode.
    """

    def __init__(self, env: Any) -> None:
        self._env = env

    def __call__(self, agent: Agent) -> dict[str, float]:
        """Mean and standard deviation of the returns, and the success rate."""
        env = self._env
        env.seed(FIRST_SEED)
        observation = env.reset()
        count = env.num_envs
        total, success, over = np.zeros(count), np.zeros(count), np.zeros(count, dtype=bool)
        while not over.all():
            observation, reward, done, infos = env.step(agent(observation))
            total += np.where(over, 0.0, reward)
            for k in np.flatnonzero(done & ~over).tolist():
                success[k] = infos[k]["is_success"]
            over |= done
        spread = float(total.std(ddof=1)) if count > 1 else 0.0
        return {"mean_return": float(total.mean()), "sd_return": spread, "success_rate": float(success.mean())}
