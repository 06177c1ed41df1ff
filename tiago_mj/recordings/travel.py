"""Range and speed of the joints in the training trials, compared with the test trials.

A fit to small motions that is tested on large ones extrapolates: friction that grows with speed, play, gravity and
limits appear only in the large ones. A gap that stays open may then be due to the recordings, not the explanation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from tiago_mj.recordings.recording import Array, Trial, sampled

#: A joint that went less than this share as far, or as fast, in training as in the test is said.
SMALL: Final = 0.5
#: Percentiles that stand for the ends of a motion, so that single bad readings do not.
ENDS: Final = (1.0, 99.0)
#: Speeds are means over so long [s]: shorter ones are the encoder's noise.
WINDOW: Final = 0.1
#: Joints that are named; of more the number is said.
NAMED: Final = 3


def notes(trials: Sequence[Trial], splits: Mapping[str, Sequence[str]], slides: Sequence[str] = ()) -> tuple[str, ...]:
    """A sentence on joints that went much less far, and one on those that went much slower; none where none did.

    Args:
        trials: all of them.
        splits: names of the ``train``, ``validation`` and ``test`` trials.
        slides: joints that slide, for the unit.
    """
    before, after = _parts(trials, splits)
    joints = dict.fromkeys(joint for trial in after for joint in trial.positions)
    found: list[str] = []
    for what, ends, per in (("far", _range, ""), ("fast", _speeds, "/s")):
        small = []
        for joint in joints:
            here, there = _span(before, joint, ends), _span(after, joint, ends)
            if here is not None and there is not None and here < SMALL * there:
                unit = ("m" if joint in slides else "rad") + per
                small.append(f"{joint} ({here:.2g} against {there:.2g} {unit})")
        if small and (what == "far" or not found):  # who goes less far goes slower, too
            more = f" and {len(small) - NAMED} more" if len(small) > NAMED else ""
            found.append(
                f"Joints went less {what} in the trials that were fitted than in the test: "
                f"{', '.join(small[:NAMED])}{more}. What is said of the larger motions is extrapolated: record motions "
                "of equal size, in any order."
            )
    return tuple(found)


def farther(trials: Sequence[Trial], splits: Mapping[str, Sequence[str]], slides: Sequence[str] = ()) -> list[str]:
    """Of joints that went much less far in the trials that were fitted, how far in these and in the test; arguments as
    of :func:`notes`."""
    before, after = _parts(trials, splits)
    found = []
    for joint in dict.fromkeys(joint for trial in after for joint in trial.positions):
        here, there = _span(before, joint, _range), _span(after, joint, _range)
        if here is not None and there is not None and here < SMALL * there:
            unit = "m" if joint in slides else "rad"
            found.append(f"fitted where {joint} moves over {here:.2g} {unit}, held out over {there:.2g} {unit}")
    return found


def _parts(trials: Sequence[Trial], splits: Mapping[str, Sequence[str]]) -> tuple[list[Trial], list[Trial]]:
    """Training trials, and test trials."""
    tested = set(splits.get("test", ()))
    fitted = {name for part in ("train", "validation") for name in splits.get(part, ())}
    return [trial for trial in trials if trial.name in fitted], [trial for trial in trials if trial.name in tested]


def _span(
    trials: Sequence[Trial], joint: str, ends: Callable[[Trial, str], Iterator[tuple[float, float]]]
) -> float | None:
    """Lowest and highest over all trials; None where the joint was not measured."""
    parts = [part for trial in trials for part in ends(trial, joint)]
    if not parts:
        return None
    return max(high for _, high in parts) - min(low for low, _ in parts)


def _range(trial: Trial, joint: str) -> Iterator[tuple[float, float]]:
    """Lowest and highest position."""
    if joint in trial.positions:
        values = sampled(trial, f"position.{joint}")[1]
        if len(values):
            yield _ends(values)


def _speeds(trial: Trial, joint: str) -> Iterator[tuple[float, float]]:
    """0 and the highest speed."""
    if joint not in trial.positions:
        return
    time, values = sampled(trial, f"position.{joint}")
    if len(time) < 3:
        return
    back = max(round(WINDOW / float(np.median(np.diff(time)))), 1)
    if len(time) > back:
        yield 0.0, _ends(np.abs(values[back:] - values[:-back]) / (time[back:] - time[:-back]))[1]


def _ends(values: Array) -> tuple[float, float]:
    low, high = np.percentile(values, ENDS)
    return float(low), float(high)
