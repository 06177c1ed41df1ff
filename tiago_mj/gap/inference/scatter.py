"""Responses where predictions scatter: how far to move for them, and what the scatter adds to them.

Where something is touched, a simulation is uneven: after the smallest move of a number a contact begins a physics
step later, an object sticks where it slipped, and the prediction is another one by more than the sensors' noise. A
difference over a small move is made of that. It shows nothing of the number, yet it counts as information: steps of a
fit become too short and intervals too narrow. Of grasps whose finger is damped, the magnitude was known to 0.4 by moves
of 0.3 deviations, to 0.9 by moves of 2, and with what the scatter adds taken off to 1.3; it was wrong by 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.linearized import Linearized
from tiago_mj.gap.inference.points import NUISANCE_STEP, Point
from tiago_mj.gap.inference.whitening import Whitening

Array = NDArray[np.float64]

#: Size of random nuisance moves that change nothing physical [deviations], and number of draws: their predictions show
#: the simulator's own sensitivity. The size does not matter where contacts are rough: moves of 1e-5, 1e-4, 1e-3 and
#: 0.01 scattered the evidence of one contact case (9:8) by 3.3, 2.4, 5.1 and 4.2 nats beside the nominal model and by
#: 46, 50, 47 and 34 beside the truth (benchmarks/results/experiments/roughness.json). Six draws tell a standard
#: deviation to 1/√(2 · 5) = 32 %.
SENSITIVITY_DEVIATION: Final = 1e-5
SENSITIVITY_DRAWS: Final = 6
#: Moves are so long that scatter adds no more than this share to the curvature of a number: with the longest for every
#: number five steps of one grasp (seed 71, case 34) ended 130 nats above four of these.
MAX_SHARE: Final = 0.01
#: The longest: of a nuisance [deviations], and of a magnitude in units of its usual one. By moves of 0.3 deviations and
#: of 1 and 2.5 units a step of that grasp gained 181 and 427 nats, by these 601.
MAX_NUDGE: Final = 2.0
MAX_WIDENING: Final = 5.0


def alike(at: Point, seed: int) -> list[Point]:
    """A point and others whose nuisances are negligibly different."""
    rng = np.random.default_rng(seed)
    moved = at.nuisance + SENSITIVITY_DEVIATION * rng.standard_normal((SENSITIVITY_DRAWS, len(at.nuisance)))
    return [at, *(replace(at, nuisance=one) for one in moved)]


def of(on: Whitening, alike: Array) -> float:
    """Expected sum of squares, whitened, by which one prediction scatters.

    Args:
        on: whitening of the residuals.
        alike: predictions with negligibly different numbers, (m, ntrials, T, C); of one there is no scatter.
    """
    white = on.white(alike - alike.mean(axis=0))
    return float(np.square(white).sum() / max(len(alike) - 1, 1))


def is_uneven(scatter: float) -> bool:
    """Whether responses need longer moves than usual."""
    return nudge(scatter) > NUISANCE_STEP


def nudge(scatter: float) -> float:
    """Move of a nuisance by which scatter adds no more curvature than its prior has, where that is not longer than the
    longest [deviations]."""
    return float(np.clip((scatter / 2) ** 0.5, NUISANCE_STEP, MAX_NUDGE))


def moves(usual: Array, longest: Array, information: Array, scatter: float) -> Array:
    """How far to move each number for its response by central differences, (n,).

    Args:
        usual, longest: moves, (n,).
        information: what is known of the curvature of each number, that of its prior included, (n,).
        scatter: of one prediction, see :func:`of`.
    """
    needed = np.sqrt(scatter / (2 * MAX_SHARE * information))
    return np.clip(needed, usual, longest) if is_uneven(scatter) else usual


def told(fitter: Linearized, count: int, columns: Array, added: Array) -> Array:
    """Curvature of each of ``count`` magnitudes and of each term beyond what scatter added, (k + nterms,).

    Args:
        fitter: whose nuisances they are.
        count: of the magnitudes.
        columns: whitened response to each magnitude and nuisance, (n, k + p).
        added: what scatter added to the curvature of each, (k + p,).
    """
    each = np.maximum(np.square(columns).sum(axis=0) - added, 0.0)
    first = count + len(fitter.shared)
    return np.concatenate([each[:first], each[first:].reshape(len(fitter.trials), -1).sum(axis=0)])


def priors(fitter: Linearized, parts: Sequence[Candidate]) -> Array:
    """Curvature of the priors of magnitudes and terms, (k + nterms,); each trial has its own number of some terms."""
    count, shared = len(parts), len(fitter.shared)
    out = np.ones(count + len(fitter.terms))
    out[:count] = [12 / (part.high - part.low) ** 2 for part in parts]
    out[count + shared :] = len(fitter.trials)
    return out


def added_curvature(
    fitter: Linearized, moved: Array, scatter: float, seconds: Sequence[float] = (), sides: int = 2
) -> Array:
    """What scatter adds to the curvature of each magnitude, nuisance and second number, (k + p + s,).

    Args:
        fitter: whose nuisances they are.
        moved: how far each magnitude and each term was moved, terms in order, (k + nterms,); by 0 adds nothing.
        scatter: of one prediction, see :func:`of`.
        seconds: how far the logarithm of each second number was moved, (s,).
        sides: moved to: 2 for central differences, 1 for forward ones.
    """
    if not is_uneven(scatter):
        return np.zeros(len(moved) - len(fitter.terms) + fitter.size + len(seconds))
    each, last = (_added(scatter, sides * np.asarray(one, dtype=float)) for one in (moved, seconds))
    first = len(moved) - len(fitter.terms) + len(fitter.shared)
    own = each[first:] / len(fitter.trials)  # each of these moves one trial
    return np.concatenate([each[:first], np.tile(own, len(fitter.trials)), last])


def _added(scatter: float, distance: Array) -> Array:
    return np.divide(2 * scatter, np.square(distance), out=np.zeros(len(distance)), where=distance != 0)


def taken_off(curvature: Array, added: Array) -> Array:
    """Curvature of the likelihood, (n, n), without what scatter added to it; never negative along any direction.

    Args:
        curvature: JᵀJ of the whitened responses.
        added: to its diagonal, (n,).
    """
    if not added.any():
        return curvature
    unit = np.sqrt(np.maximum(np.diag(curvature), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(
        (curvature - np.diag(np.minimum(added, np.diag(curvature)))) / np.outer(unit, unit)
    )
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(unit, unit))
