"""Metrics of an episode, computed from its trace.

Contact is the simulator's own: a pad and the object press on each other at the end of a control step. A threshold on
the readings would take noise for contact, and a light touch for none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.rollout.episode import FINAL_SHARE, Trace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Metrics:
    """An episode in numbers; None where a metric has no meaning: no force is asked, or nothing was touched.

    Attributes:
        reward: sum of the environment's rewards.
        paper_reward: sum of −Σ_i |f_i − goal|, the paper's reward [sensor units].
        rest_error: distance of the mean reading of the episode's last tenth from the goal, mean of the fingers
            [sensor units].
        overshoot: greatest contact force of either finger beyond the goal, over the goal; 0 where it is never exceeded.
        both_contacts: when both pads were on the object at once for the first time [s].
        bounces: how often a pad lost contact after its first, both fingers together.
        contact_share: share of steps with both pads on the object, from the step by which each has touched it on.
        object_path: length of the way of the object's middle over the table [m]; it sinks into the table by 0.1 mm
            when an episode begins, which is not counted.
        object_shift: distance of the object's middle at the end from where it was, over the table [m].
        peak_force: greatest contact force of either finger [N].
        success: at the end, 0 or 1.
    """

    reward: float
    paper_reward: float | None
    rest_error: float | None
    overshoot: float | None
    both_contacts: float | None
    bounces: float | None
    contact_share: float | None
    object_path: float | None
    object_shift: float | None
    peak_force: float | None
    success: float


#: Name, unit and digits of each metric as tables show it, and what it is multiplied by for that.
SHOWN: Final = MappingProxyType(
    {
        "reward": ("reward", "", 1.0, 2),
        "paper_reward": ("paper's reward", "", 1.0, 2),
        "rest_error": ("error at rest", "sensor u.", 1.0, 4),
        "overshoot": ("overshoot", "%", 100.0, 1),
        "both_contacts": ("both contacts", "s", 1.0, 3),
        "bounces": ("bounces", "", 1.0, 1),
        "contact_share": ("in contact", "%", 100.0, 1),
        "object_path": ("object's way", "mm", 1e3, 2),
        "object_shift": ("object's shift", "mm", 1e3, 2),
        "peak_force": ("peak force", "N", 1.0, 2),
        "success": ("success", "%", 100.0, 0),
    }
)


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation (of a sample, n − 1) over the episodes that have a metric.

    Attributes:
        mean: None where no episode has it.
        sd: None with fewer than two.
        count: episodes that have it.
    """

    mean: float | None
    sd: float | None
    count: int


def measure(trace: Trace) -> Metrics:
    """The metrics of an episode."""
    contact = trace.in_contact
    touched = contact.shape[1] > 0
    way = _way(trace.object_position)
    return Metrics(
        reward=float(trace.reward.sum()),
        paper_reward=paper_reward(trace),
        rest_error=_rest_error(trace),
        overshoot=_overshoot(trace),
        both_contacts=_first(trace.time, np.logical_and.reduce(contact, axis=1)) if touched else None,
        bounces=float(bounces(contact)) if touched and contact.any() else None,
        contact_share=contact_share(contact) if touched else None,
        object_path=None if way is None else way[0],
        object_shift=None if way is None else way[1],
        peak_force=float(trace.force_contact.max()) if touched else None,
        success=float(trace.success[-1]),
    )


def paper_reward(trace: Trace) -> float | None:
    """Sum of −Σ_i |f_i − goal| over the episode [sensor units] (paper, section III-D)."""
    if trace.goal_newtons is None or not trace.force.shape[1]:
        return None
    return -float(np.abs(trace.force - trace.goal).sum())


def bounces(in_contact: NDArray[np.bool_]) -> int:
    """Number of times that contact was lost, summed over fingers, from contact (T, fingers) bool."""
    return int((in_contact[:-1] & ~in_contact[1:]).sum())


def contact_share(in_contact: NDArray[np.bool_]) -> float | None:
    """Share of steps with all fingers in contact, from the step at which the last one touched; None where one never
    does."""
    since = np.logical_or.accumulate(in_contact, axis=0).all(axis=1)
    return float(in_contact[since].all(axis=1).mean()) if since.any() else None


def summarise(episodes: Sequence[Metrics]) -> dict[str, Spread]:
    """Mean and standard deviation of every metric, by its name."""
    return {field.name: _spread([getattr(episode, field.name) for episode in episodes]) for field in fields(Metrics)}


def _spread(values: Sequence[float | None]) -> Spread:
    there = np.array([value for value in values if value is not None], dtype=float)
    return Spread(
        mean=float(there.mean()) if len(there) else None,
        sd=float(there.std(ddof=1)) if len(there) > 1 else None,
        count=len(there),
    )


def _rest_error(trace: Trace) -> float | None:
    if trace.goal_newtons is None or not trace.force.shape[1]:
        return None
    last = max(1, round(FINAL_SHARE * len(trace.time)))
    return float(np.abs(trace.force[-last:].mean(axis=0) - trace.goal).mean())


def _overshoot(trace: Trace) -> float | None:
    if trace.goal_newtons is None or not trace.in_contact.any():
        return None
    return max(0.0, float((trace.force_contact / trace.goal_newtons).max()) - 1.0)


def _first(time: Array, when: NDArray[np.bool_]) -> float | None:
    return float(time[np.argmax(when)]) if when.any() else None


def _way(position: Array) -> tuple[float, float] | None:
    if not position.shape[1]:
        return None
    place = position[:, :2]
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    return float(steps.sum()), float(np.linalg.norm(place[-1] - place[0]))
