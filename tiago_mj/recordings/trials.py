"""Long recordings as several trials each: cut at its rests, or else into blocks with gaps between them.

Parts of one motion are no independent trials where one goes on as the other ends. A rest makes a robot forget; without
rests the gap must be longer than what is left of an error after it (its correlation time). What is not known yet is the
simulator's error, so that the servo's own stands for it: command less position.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.recordings.autocorrelation import integrated_time
from tiago_mj.recordings.recording import Array, Trial

#: Length of a part that is aimed at, and the shortest [s].
LENGTH: Final = 10.0
SHORTEST: Final = 2.0
#: Longest trial that is replayed [s], and its rows: hundreds of explanations at once fit into 1.5 GB.
LONGEST: Final = 60.0
MOST_ROWS: Final = 15_000
#: With fewer recordings nothing is left to choose by or to test on, unless they are cut. Those that are too short for
#: two parts of the length aimed at become this many parts together, three to train, one to choose by and one to test
#: on, unless these would be shorter than a part may be [s].
ENOUGH: Final = 3
PARTS: Final = 5
SHORTEST_PART: Final = 2.5
#: A rest is so long at least [s]; nothing is commanded anew and no joint leaves this share of its range.
REST: Final = 0.5
STILL: Final = 0.01
#: Commands were the same this long ago, too [s], and came at least so often.
LOOK_BACK: Final = 0.4
REPEATS: Final = 4
#: No more than this share of a recording is given up to gaps.
GIVEN_UP: Final = 0.25


def too_long(trial: Trial) -> bool:
    """Whether a trial is too long to be simulated many times."""
    return float(trial.time[-1] - trial.time[0]) > LONGEST or len(trial.time) > MOST_ROWS


def cut_long(trials: Sequence[Trial]) -> tuple[Trial, ...]:
    """Every trial that is too long to be replayed in parts that are not, the others as they are. Fewer than
    :data:`ENOUGH` are all cut, as :func:`cut` does, short ones into shorter parts."""
    found: list[Trial] = []
    together = sum(float(trial.time[-1] - trial.time[0]) for trial in trials)
    for trial in trials:
        seconds = float(trial.time[-1] - trial.time[0])
        if not too_long(trial):
            length = LENGTH if seconds > 2 * LENGTH else max(together / PARTS, SHORTEST_PART)
            found += cut(trial, length) if len(trials) < ENOUGH else (trial,)
            continue
        length = min(LENGTH, seconds * MOST_ROWS / len(trial.time) / 2)
        for piece in cut(trial, length):
            found += blocks(piece, length) if too_long(piece) else (piece,)
    return tuple(found)


def cut(trial: Trial, length: float = LENGTH) -> tuple[Trial, ...]:
    """Parts of a trial, each with its own start.

    Args:
        trial: one recording.
        length: of a part [s], about.

    Returns:
        The trial alone if it is shorter than two parts. Otherwise the parts in order; their times start at 0, and their
        sidecars say where each began: position, velocity (of what was measured) and set point (the command before).
    """
    time = trial.time
    if len(time) < 4 or time[-1] - time[0] < 2 * length:
        return (trial,)
    edges = _at_rests(time, _rests(trial), length)
    if len(edges) - 1 < (time[-1] - time[0]) / (2 * length):  # too few rests
        return blocks(trial, length)
    return _between(trial, edges, 0.0)


def blocks(trial: Trial, length: float) -> tuple[Trial, ...]:
    """Parts of equal length [s], with gaps between them that are longer than an error lasts; a trial that is shorter
    than two of them as it is."""
    time = trial.time
    gap = min(correlation_time(trial), GIVEN_UP * length)
    count = round((time[-1] - time[0]) / (length + gap))
    return _between(trial, np.linspace(time[0], time[-1], count + 1), gap) if count > 1 else (trial,)


def _between(trial: Trial, edges: Array, gap: float) -> tuple[Trial, ...]:
    """Parts from edge to edge, each ``gap`` [s] before the next one's beginning."""
    time = trial.time
    parts: list[Trial] = []
    for begin, end in itertools.pairwise(edges):
        first = int(np.searchsorted(time, begin))
        last = int(np.searchsorted(time, end - gap if end < time[-1] else end, side="right"))
        if last - first >= 4 and time[last - 1] - time[first] >= min(SHORTEST, 0.2 * (end - begin)):
            parts.append(part(trial, first, last, f"{trial.name}-{len(parts) + 1:02d}"))
    return tuple(parts)


def repeatability(trials: Sequence[Trial], joint: str) -> float:
    """Scatter of a joint's position where the same commands came again, one standard deviation [m, rad].

    Commands are the same if they are now, and were :data:`LOOK_BACK` and twice that before. The median of the trials
    that repeat themselves; 0 where none does.
    """
    found = []
    for trial in trials:
        command, position = _filled(trial.commands[joint]), _filled(trial.positions[joint])
        back = max(round(LOOK_BACK / float(np.median(np.diff(trial.time)))), 1)
        if len(command) < 10 * back or np.ptp(command) == 0:
            continue
        past = np.stack([command[2 * back :], command[back:-back], command[: -2 * back]], axis=1)
        moved = np.ptp(past, axis=1) > 0
        _, same, count = np.unique(np.round(past, 6), axis=0, return_inverse=True, return_counts=True)
        same = same.ravel()
        here = position[2 * back :]
        often = (count[same] >= REPEATS) & moved
        if often.sum() < 0.2 * len(here):
            continue
        scatter = here - (np.bincount(same, here) / count)[same]
        spread = scatter**2 * count[same] / np.maximum(count[same] - 1, 1)
        found.append(float(np.sqrt(np.mean(spread[often]))))
    return float(np.median(found)) if found else 0.0


def correlation_time(trial: Trial) -> float:
    """Integrated autocorrelation time of command less position, the longest of all joints [s]: parts must lie so far
    apart for the slowest; 0 where no joint has both."""
    step = float(np.median(np.diff(trial.time)))
    longest = 0.0
    for joint, command in trial.commands.items():
        if joint not in trial.positions or trial.sidecar.interface != "position":
            continue
        error = _filled(command) - _filled(trial.positions[joint])
        error = error - error.mean()
        if error.any():
            longest = max(longest, integrated_time(error) * step)
    return longest


def _rests(trial: Trial) -> NDArray[np.bool_]:
    """Mask of the rows at rest, (n,)."""
    time = trial.time
    step = float(np.median(np.diff(time)))
    half = max(round(REST / step / 2), 1)
    still = np.ones(len(time), dtype=bool)
    for values in (*trial.commands.values(), *trial.positions.values()):
        known = _filled(values)
        padded = np.pad(known, half, mode="edge")
        around = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
        still &= np.ptp(around, axis=1) <= STILL * max(float(np.ptp(known)), 1e-12)
    return still


def _at_rests(time: Array, rests: NDArray[np.bool_], length: float) -> Array:
    """Edges at the ends of rests, just before the robot moves again, parts no shorter than ``length``."""
    ends = np.flatnonzero(rests[:-1] & ~rests[1:])
    edges = [float(time[0])]
    for k in ends:
        if time[k] - edges[-1] >= length and time[-1] - time[k] >= SHORTEST:
            edges.append(float(time[k]))
    return np.array([*edges, float(time[-1])])


def part(trial: Trial, first: int, last: int, name: str) -> Trial:
    """Rows ``first`` to ``last`` (exclusive) as a trial of its own, with what is known of how it began."""
    rows = slice(first, last)

    def of(channels: object) -> dict[str, Array]:
        return {name: values[rows].copy() for name, values in channels.items()}  # type: ignore[attr-defined]

    side = trial.sidecar
    initial: dict[str, dict[str, float]] = {"position": {}, "velocity": {}, "set_point": {}}
    for joint, values in trial.positions.items():
        known = values[first:last][np.isfinite(values[first:last])]
        if len(known):
            initial["position"][joint] = float(known[0])
        if first:
            initial["velocity"][joint] = _slope(trial.time, values, first)
    for joint, values in trial.commands.items():
        before = values[: first + 1][np.isfinite(values[: first + 1])]
        if side.interface == "position" and len(before):
            initial["set_point"][joint] = float(before[-1])
    if not first:  # what is known of the recording's own start
        initial = {key: {**initial[key], **(side.initial or {}).get(key, {})} for key in initial}
    since = _cut_from(trial)
    raw = {**side.raw, "cut_from_s": [since + float(trial.time[first]), since + float(trial.time[last - 1])]}
    return replace(
        trial,
        name=name,
        time=trial.time[rows] - trial.time[first],
        commands=of(trial.commands),
        positions=of(trial.positions),
        velocities=of(trial.velocities),
        efforts=of(trial.efforts),
        forces=of(trial.forces),
        extras=of(trial.extras),
        sidecar=replace(side, trial=name, initial=initial, raw=raw),
        source=f"{name}.parquet" if trial.source == f"{trial.name}.parquet" else trial.source,
        part_of=(trial.source, *trial.part_of),
    )


def _cut_from(trial: Trial) -> float:
    """When a part that is cut again began in its recording [s]; 0 for a whole one."""
    said = trial.sidecar.raw.get("cut_from_s")
    return float(said[0]) if isinstance(said, list) and said and isinstance(said[0], (int, float)) else 0.0


def _slope(time: Array, values: Array, row: int) -> float:
    """Speed at a row, by linear regression over five rows."""
    near = slice(max(row - 2, 0), row + 3)
    known = np.isfinite(values[near])
    if known.sum() < 2:
        return 0.0
    return float(np.polyfit(time[near][known] - time[row], values[near][known], 1)[0])


def _filled(values: Array) -> Array:
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    rows = np.arange(len(values))
    return np.interp(rows, rows[known], values[known])
