"""Rollouts: a policy is run in an environment, its episodes are traced and summarised."""

from tiago_mj.rollout.episode import Episode, Policy, Trace, play, summarise

__all__ = ["Episode", "Policy", "Trace", "play", "summarise"]
