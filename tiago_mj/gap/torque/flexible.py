"""How small the residual of efforts gets with everything in the model: what a model of rigid joints can do at best.

A real robot's efforts are known to its sensors' noise; to the motion they are known worse, by flexible links, gears and
cables that no effect of the library has. How much worse is taken from the recording: a linear model of the gap, with
smooth functions of a joint's own position, speed and of time beside every effect and every uncertain number, is
fitted to all trials but one, and what it leaves of that one is what an explanation is measured
against. What a named effect leaves and these functions explain is a gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tiago_mj.gap.inference.hypotheses import Candidate, terms
from tiago_mj.gap.inference.points import NUISANCE_STEP
from tiago_mj.gap.torque.measured import Array
from tiago_mj.gap.torque.predictor import EffortPredictor
from tiago_mj.recordings.autocorrelation import integrated_time

#: Half waves over a joint's range that a function of its position may have.
WAVES: Final = 6
#: Prior deviation of each function's size, in units of the gap's own: a fit that swings between functions that are
#: alike would leave more of the trial that it has not seen.
SIZE: Final = 1.0


@dataclass(frozen=True)
class Left:
    """What the flexible model leaves of trials that it was not fitted to, by channel, (C,) each.

    Attributes:
        spread: root mean square [N, N·m].
        rows: integrated autocorrelation time [rows].
    """

    spread: Array
    rows: Array


def left(predict: EffortPredictor, trials: Sequence[int], pool: Sequence[Candidate]) -> Left:
    """What is left by the nominal model with its uncertain numbers, alone, with the functions, with every effect, and
    with both: where that is least.

    Args:
        predict: nominal predictions, and what was measured.
        trials: indices of those that may be looked at.
        pool: effects.
    """
    data, some = predict.data, list(trials)
    base = predict.all_trials([()], some, keep=True)[0]
    known = [term for term in terms(predict.plant) if not term.per_trial]
    numbers = predict.all_trials([(term.entry(NUISANCE_STEP),) for term in known], some) - base
    each = {candidate.label: candidate for candidate in reversed(pool)}.values()
    effects = predict.all_trials([(one.entry(_middle(one)),) for one in each], some) - base
    gap = data.value[some] - base
    out, rows = np.full(len(data.channels), np.inf), np.ones(len(data.channels))
    for c in range(len(data.channels)):
        functions, own = _functions(predict, some, c), numbers[..., c] / NUISANCE_STEP
        changes = effects[..., c]
        size = np.abs(changes).max(axis=(1, 2), initial=0.0)
        changes = changes[size > 0] / size[size > 0, None, None]
        for more in ((), (functions,), (changes,), (functions, changes)):
            residual = _left_out(gap[..., c], np.concatenate([own, *more]), len(known))
            size = float(np.sqrt(np.nanmean(residual**2)))
            if size < out[c]:
                out[c], rows[c] = size, _integrated(residual)
    return Left(out, rows)


def _integrated(residual: Array) -> float:
    """Integrated autocorrelation time of a residual, (ntrials, T), all trials being one process [rows]."""
    return float(integrated_time(list(residual - np.nanmean(residual))))


def _middle(candidate: Candidate) -> float:
    """A magnitude at which an effect is clear: in the middle of those that are tried above its identity."""
    above = [value for value in candidate.grid if value > candidate.identity] or list(candidate.grid)
    return above[len(above) // 2]


def _left_out(gap: Array, columns: Array, count: int) -> Array:
    """What a fit to the other trials leaves of each, (ntrials, T).

    Args:
        gap: (ntrials, T), NaN where nothing was measured.
        columns: (k, ntrials, T); the first ``count`` in deviations of what they stand for.
        count: of columns.
    """
    seen = np.isfinite(gap)
    size = float(np.sqrt(np.mean(gap[seen] ** 2))) if seen.any() else 0.0
    out = gap.copy()
    if size == 0:
        return out
    grams = np.stack([columns[:, t][:, seen[t]] @ columns[:, t][:, seen[t]].T for t in range(len(gap))])
    rights = np.stack([columns[:, t][:, seen[t]] @ gap[t, seen[t]] for t in range(len(gap))])
    scale = np.concatenate([np.ones(count), np.full(len(columns) - count, SIZE * size)])
    for t in range(len(gap)):
        others = [k for k in range(len(gap)) if k != t] or [t]
        gram = grams[others].sum(axis=0) * np.outer(scale, scale) / size**2 + np.eye(len(columns))
        weights = scale * np.linalg.solve(gram, rights[others].sum(axis=0) * scale / size**2)
        out[t] -= weights @ columns[:, t]
    return out


def _functions(predict: EffortPredictor, trials: Sequence[int], channel: int) -> Array:
    """Functions of a channel's joint, filtered as its effort is, each of unit size, (k, ntrials, T)."""
    joint = int(predict.data.part[channel])
    courses = [predict.torques[t].course for t in trials]
    position = np.concatenate([course.stack("position")[:, joint] for course in courses])
    velocity = np.concatenate([course.stack("velocity")[:, joint] for course in courses])
    low, reach = position.min(), max(float(np.ptp(position)), 1e-12)
    fastest = max(float(np.abs(velocity).max()), 1e-12)
    accelerated = max(max(float(np.abs(c.stack("acceleration")[:, joint]).max()) for c in courses), 1e-12)
    rows = predict.data.value.shape[1]
    found = []
    for k, course in enumerate(courses):
        q, v, a = (course.stack(name)[:, joint] for name in ("position", "velocity", "acceleration"))
        along, speed = (q - low) / reach, v / fastest
        direction = np.clip(v / course.rest_speed[joint], -1, 1)
        waves = [np.cos(np.pi * wave * along) for wave in range(WAVES + 1)]
        time = np.full(len(q), k / max(len(courses) - 1, 1)) - 0.5
        columns = [*waves, direction, *(direction * wave for wave in waves[1:3]), speed, speed * np.abs(speed)]
        columns += [speed**3, a / accelerated, time]
        kept = course.filtered(np.stack(columns, axis=1))[:: predict.every].T
        found.append(np.pad(kept, ((0, 0), (0, rows - kept.shape[1]))))
    return np.stack(found, axis=1)
