"""Episodes of one controller: played, traced, measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.evaluate.metrics import EpisodeTrace, Metrics, measure
from tiago_mj.rollout import Policy, play
from tiago_mj.rollout.policies import RANDOM, make_policy


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
    traces: tuple[EpisodeTrace, ...]
    metrics: tuple[Metrics, ...]


def core_of(env: gymnasium.Env[Any, Any]) -> Any:
    """The goal environment behind an environment or its flat view."""
    return getattr(env.unwrapped, "core", env.unwrapped)


def play_policy(
    env: gymnasium.Env[Any, Any],
    policy: str,
    *,
    name: str,
    seeds: Sequence[int],
    trust: bool = False,
    watch: Callable[[int], None] | None = None,
) -> Played:
    """Play a policy, given by name or file, once a seed.

    Args:
        env: one that ends.
        policy: as :func:`tiago_mj.rollout.policies.make_policy` takes it.
        name: for tables.
        seeds: of the episodes.
        trust: whether files may be unpickled.
        watch: called with 0 after a reset and with t after control step t; takes the film.

    Raises:
        ValueError: the policy cannot be had, or does not fit the environment.
    """
    commander: Policy | None = None
    traces = []
    for seed in seeds:
        if commander is None or policy == RANDOM:  # the others forget; this one's actions follow from its seed
            commander = make_policy(policy, env, seed=seed, trust=trust)
        traces.append(trace_of(env, commander, seed=seed, watch=watch))
    return Played(name, policy, tuple(seeds), tuple(traces), tuple(measure(trace) for trace in traces))


def trace_of(
    env: gymnasium.Env[Any, Any], policy: Policy, *, seed: int, watch: Callable[[int], None] | None = None
) -> EpisodeTrace:
    """Play an episode, and keep what metrics need of it."""
    core = core_of(env)
    places, forces = [], []

    def look(step: int) -> None:
        places.append(np.array(core.state.object_pose[:3]))
        if step:
            forces.append(np.array(core.state.force_contact))
        if watch is not None:
            watch(step)

    trace = play(env, policy, seed=seed, watch=look)
    force_is_goal = isinstance(core, HoldForce)
    return EpisodeTrace(
        time=trace.time,
        reward=trace.reward,
        success=trace.success,
        goal=trace.goal,
        force=trace.force,
        force_contact=np.array(forces),
        in_contact=trace.in_contact,
        position=trace.position,
        object_position=np.array(places),
        goal_newtons=trace.goal / core.load_cell.units(1.0) if force_is_goal else None,
    )
