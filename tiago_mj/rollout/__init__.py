"""Running a policy in an environment and saying what came of it."""

from tiago_mj.rollout.episode import Episode, Policy, Trace, play, summarise

__all__ = ["Episode", "Policy", "Trace", "play", "summarise"]
