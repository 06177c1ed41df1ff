"""Episodes of one controller, with their traces and metrics."""

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


@dataclass(frozen=True)
class Callbacks:
    """Functions that are called while episodes are played.

    Attributes:
        step: with the index of every control step, 0 after a reset; None for none.
        episode: after every episode.
    """

    step: Callable[[int], None] | None = None
    episode: Callable[[], None] = lambda: None


def play_policy(
    env: gymnasium.Env[Any, Any],
    policy: str,
    *,
    name: str,
    seeds: Sequence[int],
    trust: bool = False,
    callbacks: Callbacks = Callbacks(),
) -> Played:
    """Traces and metrics of a policy's episodes, one for each seed.

    Args:
        env: environment to play in.
        policy: name or file, as :func:`play_seeds` takes it.
        name: what the controller is called in tables and files.
        seeds: of the episodes.
        trust: whether files may be unpickled.
        callbacks: called during and after the episodes.
    """
    traces = []
    for trace in play_seeds(env, policy, seeds, trust=trust, watch=callbacks.step):
        traces.append(trace)
        callbacks.episode()
    return Played(name, policy, tuple(seeds), tuple(traces), tuple(measure(trace) for trace in traces))
