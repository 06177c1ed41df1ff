"""One episode: played, traced, summarised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: The final force is the mean over this last share of the episode: a single reading is mostly noise.
FINAL_SHARE: Final = 0.1


class Policy(Protocol):
    """What commands an environment."""

    def reset(self) -> None:
        """Forget the episode before."""

    def __call__(self, observation: Any, info: dict[str, Any]) -> Any:
        """The action for what was last seen."""


@dataclass(frozen=True)
class Trace:
    """What happened in an episode; row t is after control step t + 1.

    Attributes:
        time: from the start of the episode, (T,) [s].
        reward: (T,).
        success: (T,) bool.
        force: load-cell readings, (T, 2) right and left [sensor units]; (T, 0) where there are no load cells.
        in_contact: whether pad and object press on each other: the simulator's truth, (T, 2), or (T, 0) as ``force``.
        position: of the commanded joints, (T, N) [m, rad].
        goal: of the last step, (g,).
        threshold: above which a reading counts as touch, as ``force`` without T [sensor units].
    """

    time: Array
    reward: Array
    success: NDArray[np.bool_]
    force: Array
    in_contact: NDArray[np.bool_]
    position: Array
    goal: Array
    threshold: Array

    def contact_times(self) -> tuple[float | None, ...]:
        """When each finger first touched the object, right and left [s]; None where it never did."""
        return tuple(
            float(self.time[np.argmax(column)]) if column.any() else None for column in np.transpose(self.in_contact)
        )


@dataclass(frozen=True)
class Episode:
    """An episode in a line.

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
    core: Any = env.unwrapped
    observation, info = env.reset(seed=seed)
    policy.reset()
    rows: list[tuple[float, float, bool, Array, Array, Array]] = []
    over = False
    if watch is not None:
        watch(0)
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(observation, info))
        over = terminated or truncated
        rows.append(
            (
                (len(rows) + 1) * core.dt,
                float(reward),
                bool(info["is_success"]),
                np.array(info.get("force_raw", ())),
                np.array(info.get("in_contact", ())),
                np.array(core.state.position),
            )
        )
        if watch is not None:
            watch(len(rows))
    time, rewards, success, force, contact, position = (np.array(column) for column in zip(*rows, strict=True))
    cells = force.shape[1]
    threshold = core.load_cell.thresholds[:cells] if cells else np.zeros(0)
    return Trace(time, rewards, success, force, contact.astype(bool), position, np.array(info["goal"]), threshold)


def summarise(trace: Trace, seed: int) -> Episode:
    """An episode's line."""
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
