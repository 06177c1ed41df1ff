"""Second numbers of effects at which a motion can show them: speeds at which it moves, periods of a ripple on efforts.

A library's own values fit no robot in particular: breakaway friction that fades at 0.2 rad/s, tried at 0.07, is half as
likely and counts as noise of the efforts, and a ripple at another period counts as noise altogether.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.command import SPEED
from tiago_mj.gap.detectors.ripples import Trace, peaks
from tiago_mj.gap.inference.hypotheses import Candidate, Label
from tiago_mj.gap.torque.predictor import EffortPredictor

#: From one speed that is tried to the next. The true one is within 1.41 of one that is tried, which leaves 6 % of what
#: exp(-(v / speed)²) changes then (1 - 1.41 / 1.5, the motion having all speeds alike).
RATIO: Final = 2.0


def with_second_numbers(
    pool: Sequence[Candidate], predict: EffortPredictor, trials: Sequence[int]
) -> tuple[Candidate, ...]:
    """The pool, effects with a second number at the values that the motion can show.

    Args:
        pool: candidates.
        predict: nominal predictions, and what was measured.
        trials: indices of those that may be looked at.
    """
    out: list[Candidate] = []
    done: set[Label] = set()
    for candidate in pool:
        name = _second(candidate)
        if name is None:
            out.append(candidate)
        elif candidate.label not in done:
            done.add(candidate.label)
            seen = _values(candidate, name, predict, trials)
            out += [replace(candidate, fixed=((name, value),)) for value in seen] or [
                other for other in pool if other.label == candidate.label
            ]
    return tuple(out)


def _second(candidate: Candidate) -> str | None:
    """Name of the speed or the period that is fixed while the magnitude is fitted; None where there is none."""
    declared = EFFECTS[candidate.effect]
    names = [
        name
        for name in candidate.second_numbers
        if name == declared.ripple_period or declared.parameters[name].unit == SPEED
    ]
    return names[0] if names and len(candidate.fixed) == 1 else None


def _values(candidate: Candidate, name: str, predict: EffortPredictor, trials: Sequence[int]) -> list[float]:
    """Speeds from the fastest down to rest, or periods of the strongest ripples, strongest first."""
    targets, course = predict.plant.wiring.targets, predict.torques[0].course
    columns = {course.channels[c]: c for c in range(len(course.channels))}
    joints = [name for name in candidate.target or targets.names("joint") if name in columns]
    if not joints:
        return []
    declared = EFFECTS[candidate.effect]
    low, high = declared.parameters[name].bounds[targets.side("joint", targets.first("joint", candidate.target))]
    at = [course.joints.index(joint) for joint in joints]
    if declared.ripple_period != name:
        fastest = max(float(np.abs(predict.torques[t].course.stack("velocity")[:, at]).max()) for t in trials)
        slowest = max(float(course.rest_speed[at].min()), low)
        first, last = (math.floor(math.log(speed, RATIO)) for speed in (min(fastest, high), slowest))
        return [RATIO**k for k in range(first, last, -1)]  # the same on all joints, which may share one
    base = predict.all_trials([()], trials, keep=True)[0]
    traces = [_trace(predict, t, joint, columns[joint], base[k]) for k, t in enumerate(trials) for joint in joints]
    return peaks(traces, low, high)


def _trace(predict: EffortPredictor, trial: int, joint: str, channel: int, base: np.ndarray) -> Trace:
    """Position and effort's error of a joint in a trial."""
    course = predict.torques[trial].course
    position = course.stack("position")[:: predict.every, course.joints.index(joint)]
    error = (predict.data.value[trial] - base)[: len(position), channel]
    return Trace(position, error, np.isfinite(error))
