"""Bags of robots that ``ros2_control`` drives, without a map file: which topics hold states and commands.

States are a ``sensor_msgs/JointState``. Commands are, best first, the reference that a trajectory controller publishes
in its state; numbers of a forward command controller (``*/commands``), whose joints no message names, so that each is
given to the joint that follows it; and trajectories (``*/joint_trajectory``), between whose points the controller
interpolates, as is done here at the stamps of the states. What was taken for what is told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import linear_sum_assignment

from tiago_mj.recordings.recording import Array, Finding, RecordingError

Stamps = NDArray[np.int64]
Streams = dict[str, tuple[Stamps, Array]]
STATES: Final = "sensor_msgs/msg/JointState"
TRAJECTORY: Final = "trajectory_msgs/msg/JointTrajectory"
NUMBERS: Final = "std_msgs/msg/Float64MultiArray"
REFERENCE: Final = "/JointTrajectoryControllerState"
#: What follows a command best must do so so many times better than what does second best.
CLEARLY: Final = 3.0
#: Of a command's travel, how far a joint may stay from it, root mean square, and the least travel that counts.
FOLLOWS: Final = 0.3
MIN_TRAVEL: Final = 0.1
_AS_SAID: Final = "name the topics in a map file (--map)"
_SECOND: Final = 1e-9


@dataclass(frozen=True)
class Topics:
    """Topics of states and commands in one bag.

    Attributes:
        states: the topic of the joint states.
        references: of controllers' states.
        numbers: of forward commands.
        trajectories: of trajectories.
        skipped: that hold commands in a type that the bag does not describe.
    """

    states: str
    references: tuple[str, ...]
    numbers: tuple[str, ...]
    trajectories: tuple[str, ...]
    skipped: tuple[str, ...] = ()


@dataclass(frozen=True)
class Piece:
    """One joint's part of a trajectory.

    Attributes:
        start: when it begins [ns].
        time: of its points, from the start [s], increasing.
        position: of its points.
        velocity: of its points; empty where none is given.
    """

    start: int
    time: Array
    position: Array
    velocity: Array


def topics(types: Mapping[str, str], known: Iterable[str], file: str) -> Topics | None:
    """State and command topics of a bag; None where it has no such commands.

    Args:
        types: message type by topic.
        known: types that can be read.
        file: for messages.

    Raises:
        RecordingError: commands are there, and it cannot be told which states belong to them.
    """
    known = set(known)

    def of(wanted: Callable[[str, str], bool]) -> tuple[str, ...]:
        return tuple(sorted(topic for topic, kind in types.items() if wanted(topic, kind)))

    stated = of(lambda topic, kind: kind.endswith(REFERENCE))
    numbers = of(lambda topic, kind: kind == NUMBERS and topic.endswith("/commands"))
    trajectories = of(lambda topic, kind: kind == TRAJECTORY and topic.endswith("/joint_trajectory"))
    if not (stated or numbers or trajectories):
        return None
    states = of(lambda topic, kind: kind == STATES)
    best = [topic for topic in states if topic == "/joint_states"] or list(states)
    if len(best) != 1:
        said = ", ".join(states) or "none"
        raise RecordingError(f"{file}: one topic of joint states is needed, the bag has {said}: {_AS_SAID}")
    readable = tuple(topic for topic in stated if types[topic] in known)
    return Topics(best[0], readable, numbers, trajectories, tuple(t for t in stated if t not in readable))


def interface_of(topic: str) -> str:
    """Interface of a forward command controller, from its name."""
    name = topic.lower()
    if "velocit" in name:
        return "velocity"
    return "effort" if "effort" in name or "torque" in name else "position"


def reference(file: str, topic: str, message: Any) -> dict[str, float]:
    """Commands in a controller's state, by joint; empty where it has none.

    Raises:
        RecordingError: names and numbers do not match.
    """
    point = getattr(message, "reference", None)
    if point is None or not len(point.positions):
        point = getattr(message, "desired", point)
    if point is None or not len(point.positions):
        return {}
    if len(point.positions) != len(message.joint_names):
        raise RecordingError(
            f"{file}: topic {topic}: {len(point.positions)} positions of {len(message.joint_names)} joints: {_AS_SAID}"
        )
    return dict(zip(message.joint_names, map(float, point.positions), strict=True))


def pieces(file: str, topic: str, received: int, header: int, message: Any) -> dict[str, Piece]:
    """A trajectory by joint.

    Raises:
        RecordingError: its points' times do not increase, or their numbers are not those of the joints.
    """
    time: Array = np.array([p.time_from_start.sec + _SECOND * p.time_from_start.nanosec for p in message.points])
    joints = list(message.joint_names)
    places = [np.asarray(p.positions, dtype=np.float64) for p in message.points]
    speeds = [np.asarray(p.velocities, dtype=np.float64) for p in message.points]
    if not len(time):
        return {}
    if (np.diff(time) <= 0).any() or any(len(place) != len(joints) for place in places):
        raise RecordingError(
            f"{file}: topic {topic}: a trajectory's points do not follow each other in time, or do not have a position "
            f"for each of its {len(joints)} joints: leave the topic out, {_AS_SAID}"
        )
    fast = all(len(speed) == len(joints) for speed in speeds)
    start = max(header, received)  # a header of 0 means at once
    return {
        joint: Piece(
            start,
            time,
            np.array([place[k] for place in places], dtype=np.float64),
            np.array([speed[k] for speed in speeds], dtype=np.float64) if fast else np.zeros(0),
        )
        for k, joint in enumerate(joints)
    }


def sampled(parts: list[Piece], stamps: Stamps, measured: Array) -> tuple[Stamps, Array]:
    """What a controller tracks, at the stamps of the states from the first trajectory on.

    Args:
        parts: of one joint.
        stamps: of its states [ns], increasing.
        measured: its position then: where the first trajectory begins.
    """
    parts = sorted(parts, key=lambda part: part.start)
    out = np.full(len(stamps), np.nan)
    before: Callable[[Array], Array] | None = None
    begun = 0
    for part, following in zip(parts, [*parts[1:], None], strict=True):
        if before is None:
            here = float(np.interp(part.start, stamps, measured))
        else:
            here = float(before(np.full(1, (part.start - begun) * _SECOND))[0])
        track, begun = _track(part, here), part.start
        rows = (stamps >= part.start) & (stamps < (following.start if following else np.iinfo(np.int64).max))
        out[rows] = track(np.asarray((stamps[rows] - part.start) * _SECOND, dtype=np.float64))
        before = track
    there = ~np.isnan(out)
    return stamps[there], out[there]


def _track(part: Piece, here: float) -> Callable[[Array], Array]:
    time, place, speed = part.time, part.position, part.velocity
    if time[0] > 0:
        time, place = np.append(0.0, time), np.append(here, place)
        speed = np.append(0.0, speed) if len(speed) else speed
    if not len(speed) or len(time) < 2:
        return lambda t: np.interp(t, time, place)
    spline = CubicHermiteSpline(time, place, speed)
    return lambda t: np.asarray(spline(np.clip(t, time[0], time[-1])))


def followers(file: str, topic: str, numbers: list[tuple[Stamps, Array]], states: Streams, kind: str) -> list[str]:
    """The joint that follows each of a forward command controller's numbers.

    Args:
        file, topic: for messages.
        numbers: stamps and values, in the order of the message.
        states: streams by column.
        kind: ``position``, ``velocity`` or ``effort``: what the numbers are.

    Raises:
        RecordingError: it is not clear which joint follows which number.
    """
    candidates = [name.partition(".")[2] for name in states if name.startswith(f"{kind}.")]
    if len(candidates) < len(numbers):
        raise RecordingError(
            f"{file}: topic {topic} has {len(numbers)} numbers, and {len(candidates)} joints have a {kind}: {_AS_SAID}"
        )
    apart = np.array([[_apart(number, states[f"{kind}.{joint}"]) for joint in candidates] for number in numbers])
    rows, columns = linear_sum_assignment(apart)
    owner = {int(column): int(row) for row, column in zip(rows, columns, strict=True)}
    for row, column in zip(rows, columns, strict=True):
        own, values = apart[row, column], numbers[row][1]
        rivals = [c for c in range(len(candidates)) if c != column and apart[row, c] <= CLEARLY * own]
        # Joints that are told the same may be exchanged: so are those that rest at the same place.
        unclear = [c for c in rivals if c not in owner or not np.allclose(numbers[owner[c]][1], values)]
        far = len(candidates) > 1 and own > FOLLOWS * max(float(np.ptp(values)), MIN_TRAVEL)
        if unclear or far:
            raise RecordingError(
                f"{file}: topic {topic}: no message says which joints its {len(numbers)} numbers command, and no joint "
                f"clearly follows number {row + 1}: {_AS_SAID}"
            )
    return [candidates[column] for column in columns]


def _apart(number: tuple[Stamps, Array], state: tuple[Stamps, Array]) -> float:
    """Root mean square distance of a state from a command that is held."""
    rows = np.searchsorted(number[0], state[0], side="right") - 1
    there = rows >= 0
    if not there.any():
        return 1e6
    return float(np.sqrt(np.mean((state[1][there] - number[1][np.maximum(rows, 0)][there]) ** 2)))


def told(file: str, said: Mapping[str, str], states: str, skipped: Iterable[str]) -> Finding:
    """One line on which topics were taken for states and commands."""
    parts = [f"{states} for the joints' states", *(f"{topic} for {what}" for topic, what in said.items())]
    unread = [f"{topic} was not read, the bag does not describe its messages" for topic in skipped]
    return Finding(
        "missing_column",
        file,
        "",
        f"no map says what its topics are: taken are {'; '.join([*parts, *unread])}; --map says it otherwise",
        repaired=True,
    )
