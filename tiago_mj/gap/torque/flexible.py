"""How small the residual of efforts gets with everything in the model: what a model of rigid joints can do at best.

A real robot's efforts are known to its sensors' noise; to the motion they are known worse, by flexible links, gears and
cables that no effect of the library has. How much worse is taken from the recording: it is the noise that is probable
beside a linear model of the gap with every uncertain number, and with every effect, with smooth functions of a joint's
own position, speed and of time, with both or with neither. Explanations are sought and weighed by that. Whether one
explains as much as can be expected is asked of trials that it has not seen, and there such a model, fitted to the other
trials, leaves more. What a named effect leaves and these functions explain is
a gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tiago_mj.gap.inference.hypotheses import Candidate, terms
from tiago_mj.gap.inference.points import NUISANCE_STEP
from tiago_mj.gap.torque.measured import Array, clear, known_at_best
from tiago_mj.gap.torque.predictor import EffortPredictor
from tiago_mj.recordings.autocorrelation import integrated_time

#: Half waves over a joint's range that a function of its position may have.
WAVES: Final = 6
#: Prior deviation of all functions together, in units of the gap's own. Were it that of each of twenty, twenty rows
#: would never be explained by them.
SIZE: Final = 1.0
#: Deviations of the noise that are tried, as shares of the gap's size: 4 % apart.
NOISES: Final = np.geomspace(1e-3, 1.2, 180)


@dataclass(frozen=True)
class Left:
    """What the flexible model leaves, by channel, (C,) each.

    Attributes:
        spread: standard deviation, of noise and of what the model cannot have [N, N·m].
        unseen: root mean square of what a fit to the other trials leaves of one, at least ``spread`` [N, N·m].
        rows: integrated autocorrelation time of what is left [rows].
    """

    spread: Array
    unseen: Array
    rows: Array


def left(predict: EffortPredictor, trials: Sequence[int], pool: Sequence[Candidate]) -> Left:
    """What is left by the nominal model with its uncertain numbers, alone, with the functions, with every effect, and
    with both, each of these as probable as the recording makes it.

    Args:
        predict: nominal predictions, and what was measured.
        trials: indices of those that may be looked at.
        pool: effects.
    """
    data, some = predict.data, list(trials)
    base = predict.all_trials([()], some, keep=True)[0]
    known = [term for term in terms(predict.plant) if not term.per_trial]
    numbers = predict.all_trials([(term.entry(NUISANCE_STEP),) for term in known], some) - base
    effects = predict.all_trials([(one.entry(_middle(one)),) for one in pool], some) - base
    gap = data.value[some] - base
    spread, unseen, rows = np.zeros(len(data.channels)), np.zeros(len(data.channels)), np.ones(len(data.channels))
    for c in range(len(data.channels)):
        seen = np.isfinite(gap[..., c])
        size = float(np.sqrt(np.mean(gap[..., c][seen] ** 2))) if seen.any() else 0.0
        if size == 0:
            continue
        free, own = functions(predict, some, c), numbers[..., c] / NUISANCE_STEP
        changes = effects[..., c]
        largest = np.abs(changes).max(axis=(1, 2), initial=0.0)
        changes = changes[largest > 0] / largest[largest > 0, None, None]
        models, aside = [own], []
        for more in (free, changes, np.concatenate([free, changes])):
            models.append(np.concatenate([own, SIZE * size / np.sqrt(max(len(more), 1)) * more]))
        # First of all rows, which says in which of them the filter's share of a rest is less than that.
        spread[c], _ = noise_beside(gap[..., c][seen], [columns[:, seen] for columns in models])
        seen = clear(known_at_best(data, spread))[some][..., c]
        whole = np.where(seen, gap[..., c], np.nan)
        for more in (free[:0], free, changes, np.concatenate([free, changes])):
            aside.append(float(np.nanmean(_left_out(whole, np.concatenate([own, more]), len(own)) ** 2)))
        spread[c], whole[seen] = noise_beside(whole[seen], [columns[:, seen] for columns in models])
        unseen[c] = max(np.sqrt(min(aside)), spread[c])
        rows[c] = integrated(whole)
    return Left(spread, unseen, rows)


def noise_beside(gap: Array, models: Sequence[Array]) -> tuple[float, Array]:
    """Noise of a gap, whichever of several linear models it has (Bayesian linear regression; Bishop 2006, section 3.5).

    The logarithm of its deviation and the models have flat priors; what many columns fit of few rows by chance counts
    as little as it tells, so that few rows leave a noise too large and not none.

    Args:
        gap: (n,).
        models: columns of each, (k, n), in prior deviations.

    Returns:
        Root mean square of the noise's deviation over its posterior, and the residual of the mean weights of the most
        probable model and noise, (n,).
    """
    tried = np.sqrt(np.mean(gap**2)) * NOISES
    each = [regression(gap, columns, tried) for columns in models]
    evidence = np.stack([one for one, _ in each])
    weight = np.exp(evidence - evidence.max())
    likeliest = int(np.argmax(evidence.max(axis=1)))
    return float(np.sqrt((weight * tried**2).sum() / weight.sum())), each[likeliest][1]


def regression(gap: Array, columns: Array, tried: Array, counts: float = 1.0) -> tuple[Array, Array]:
    """Log evidence of a linear model whose weights have normal priors of deviation 1, by its noise.

    Args:
        gap: (n,).
        columns: (k, n).
        tried: deviations of the noise, (m,).
        counts: as how many independent rows each counts.

    Returns:
        The evidence up to a constant, (m,), and the residual of the mean weights at the likeliest noise, (n,).
    """
    axes, stretch, _ = np.linalg.svd(columns.T, full_matrices=False)
    along, power = axes.T @ gap, counts * stretch**2
    rest = max(float(gap @ gap - along @ along), 0.0)
    total = power + tried[:, None] ** 2
    fitted = np.log(total) + counts * along**2 / total
    left = (counts * len(gap) - len(power)) * 2 * np.log(tried) + counts * rest / tried**2
    evidence = -0.5 * (fitted.sum(axis=1) + left)
    return evidence, gap - axes @ (along * power / total[int(np.argmax(evidence))])


def integrated(residual: Array) -> float:
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
    scale = np.concatenate([np.ones(count), np.full(len(columns) - count, size)])
    for t in range(len(gap)):
        others = [k for k in range(len(gap)) if k != t] or [t]
        gram = grams[others].sum(axis=0) * np.outer(scale, scale) / size**2 + np.eye(len(columns))
        weights = scale * np.linalg.solve(gram, rights[others].sum(axis=0) * scale / size**2)
        out[t] -= weights @ columns[:, t]
    return out


def functions(predict: EffortPredictor, trials: Sequence[int], channel: int) -> Array:
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
