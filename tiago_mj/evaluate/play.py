"""Episodes of one controller: played, traced, measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium

from tiago_mj.evaluate.metrics import Metrics, measure
from tiago_mj.rollout import Trace
from tiago_mj.rollout.sweep import play_seeds


@dataclass(frozen=True)
class Played:
    """The episodes of one controller.

    Attributes:
        name: what it is called in tables and files.
        policy: as it was given.
        seeds: of the episodes.
        traces, metrics: one an episode.
    """

    name: str
    policy: str
    seeds: tuple[int, ...]
    traces: tuple[Trace, ...]
    metrics: tuple[Metrics, ...]


def play_policy(
    env: gymnasium.Env[Any, Any],
    policy: str,
    *,
    name: str,
    seeds: Sequence[int],
    trust: bool = False,
    watch: Callable[[int], None] | None = None,
    done: Callable[[], None] = lambda: None,
) -> Played:
    """Play a policy once a seed and measure its episodes.

    ``name`` is for tables, ``done`` is called after every episode, the rest is as of :func:`play_seeds`.
    """
    traces = []
    for trace in play_seeds(env, policy, seeds, trust=trust, watch=watch):
        traces.append(trace)
        done()
    return Played(name, policy, tuple(seeds), tuple(traces), tuple(measure(trace) for trace in traces))
