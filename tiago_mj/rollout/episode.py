"""One episode: played, traced and summarised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj.envs.flat import core_of
from tiago_mj.envs.hold_force import HoldForce
from tiago_mj.envs.state import State

Array = NDArray[np.float64]

#: The final force is the mean over this last share of the episode: a single reading is mostly noise.
FINAL_SHARE: Final = 0.1


class Policy(Protocol):
    """Policy: maps the last observation to an action."""

    def reset(self) -> None:
        """Forget the episode before."""

    def __call__(self, observation: Any, info: dict[str, Any]) -> Any:
        """The action for the last observation."""


@dataclass(frozen=True)
class Trace:
    """What happened in an episode; row t is after control step t + 1.

    Attributes:
        time: from the start of the episode, (T,) [s].
        reward: (T,).
        success: (T,) bool.
        goal: of the last step, (g,).
        force: load-cell readings, (T, 2) right and left [sensor units]; (T, 0) where there are no load cells.
        force_contact: the simulator's truth, (T, 2) [N]; or (T, 0).
        in_contact: whether pad and object press on each other: the truth, too, (T, 2) bool; or (T, 0).
        position: of the commanded joints, (T, N) [m, rad].
        object_position: of the object's middle, its place at the start first, (T + 1, 3) [m]; or (T + 1, 0).
        goal_newtons: force that the goal asks of each finger, (2,) [N]; None where the goal is no force.
        threshold: above which a reading counts as touch, as ``force`` without T [sensor units].
    """

    time: Array
    reward: Array
    success: NDArray[np.bool_]
    goal: Array
    force: Array
    force_contact: Array
    in_contact: NDArray[np.bool_]
    position: Array
    object_position: Array
    goal_newtons: Array | None
    threshold: Array

    def contact_times(self) -> tuple[float | None, ...]:
        """When each finger first touched the object, right and left [s]; None where it never did."""
        return tuple(
            float(self.time[np.argmax(column)]) if column.any() else None for column in np.transpose(self.in_contact)
        )


@dataclass(frozen=True)
class Episode:
    """Summary of an episode.

    Attributes:
        seed: of its reset.
        steps: played.
        episode_return: sum of rewards.
        success: at its end.
        both_contacts: when both fingers touched the object at once for the first time [s]; None: never.
        final_force: mean of the last tenth, right and left [sensor units]; empty without load cells.
        peak_force: greatest reading of either finger [sensor units]; None without load cells.
    """

    seed: int
    steps: int
    episode_return: float
    success: bool
    both_contacts: float | None
    final_force: tuple[float, ...]
    peak_force: float | None


def play(
    env: gymnasium.Env[Any, Any], policy: Policy, *, seed: int, watch: Callable[[int], None] | None = None
) -> Trace:
    """Play an episode to its end.

    Args:
        env: one that ends, as those of ``gymnasium.make`` do.
        policy: commands it.
        seed: of the reset.
        watch: called with 0 after the reset and with t after control step t; takes the film.
    """
    core = core_of(env)
    observation, info = env.reset(seed=seed)
    policy.reset()
    states: list[State] = [core.state]
    rewards: list[float] = []
    success: list[bool] = []
    over = False
    if watch is not None:
        watch(0)
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(observation, info))
        over = terminated or truncated
        states.append(core.state)
        rewards.append(float(reward))
        success.append(bool(info["is_success"]))
        if watch is not None:
            watch(len(rewards))
    goal, contact = np.array(info["goal"]), np.array([state.force_contact for state in states[1:]])
    return Trace(
        time=core.dt * np.arange(1, len(states)),
        reward=np.array(rewards),
        success=np.array(success),
        goal=goal,
        force=np.array([state.force_raw for state in states[1:]]),
        force_contact=contact,
        in_contact=contact > 0,
        position=np.array([state.position for state in states[1:]]),
        object_position=np.array([state.object_pose[:3] for state in states]),
        goal_newtons=goal / core.load_cell.units(1.0) if isinstance(core, HoldForce) else None,
        threshold=core.load_cell.thresholds[: contact.shape[1]],
    )


def summarise(trace: Trace, seed: int) -> Episode:
    """Return, length, success and contact times of a trace."""
    has_cells, has_contacts = trace.force.shape[1] > 0, trace.in_contact.shape[1] > 0
    last = max(1, round(FINAL_SHARE * len(trace.time)))
    both = trace.in_contact.all(axis=1) if has_contacts else np.zeros(len(trace.time), dtype=bool)
    return Episode(
        seed=seed,
        steps=len(trace.time),
        episode_return=float(trace.reward.sum()),
        success=bool(trace.success[-1]),
        both_contacts=float(trace.time[np.argmax(both)]) if both.any() else None,
        final_force=tuple(float(f) for f in trace.force[-last:].mean(axis=0)) if has_cells else (),
        peak_force=float(trace.force.max()) if has_cells else None,
    )
