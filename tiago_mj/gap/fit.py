"""Fit an explanation: its magnitudes jointly with the nominal model's own numbers, and the evidence for it.

Gauss-Newton on whitened residuals with a normal prior on the nuisance parameters, then Laplace's approximation: the
evidence integrates over magnitudes (uniform within their bounds) and nuisances, so that an effect pays for its
freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap import score
from tiago_mj.gap.effects.spec import Entry
from tiago_mj.gap.floor import Data
from tiago_mj.gap.hypotheses import Candidate, Term
from tiago_mj.gap.predict import Predictor

Array = NDArray[np.float64]

#: Shares of a Gauss-Newton step that are tried at once.
STEPS: Final = (1.0, 0.4, 0.1)
#: A drop of the cost below this is no progress [nats].
SETTLED: Final = 0.1
ITERATIONS: Final = 5


@dataclass(frozen=True)
class Fitted:
    """An explanation at its best.

    Attributes:
        parts: candidates, none for the nominal model.
        values: fitted magnitudes, (k,).
        deviations: of the magnitudes, (k,), one standard deviation.
        nuisance: deviations of the global terms, then of the per-trial terms trial by trial.
        evidence: log of the probability of the recordings under the explanation.
        misfit: mean squared residual of the worst channel, in units of floor and tolerance.
    """

    parts: tuple[Candidate, ...]
    values: Array
    deviations: Array
    nuisance: Array
    evidence: float
    misfit: float

    def effects(self) -> tuple[Entry, ...]:
        """The effects at their magnitudes, without the nuisances."""
        return tuple(part.entry(float(v)) for part, v in zip(self.parts, self.values, strict=True))


@dataclass
class Fitter:
    """Fits explanations to one set of trials.

    Attributes:
        predict: simulations.
        trials: indices of the trials.
        data: measured, of these trials.
        weight: (C,), see :func:`score.independence`.
        terms: nuisance parameters.
    """

    predict: Predictor
    trials: tuple[int, ...]
    data: Data
    weight: Array
    terms: tuple[Term, ...]

    def __post_init__(self) -> None:
        self.shared = [k for k, term in enumerate(self.terms) if not term.per_trial]
        self._own = [k for k, term in enumerate(self.terms) if term.per_trial]
        self._columns: Array | None = None

    @property
    def size(self) -> int:
        """Number of nuisance parameters."""
        return len(self.shared) + len(self._own) * len(self.trials)

    def effects(self, parts: Sequence[Candidate], values: Array, nuisance: Array, trial: int) -> tuple[Entry, ...]:
        """What is simulated for a trial (by its position among the trials)."""
        chosen = [part.entry(float(v)) for part, v in zip(parts, values, strict=True)]
        for k, term in enumerate(self.shared):
            if nuisance[k]:
                chosen.append(self.terms[term].entry(float(nuisance[k])))
        base = len(self.shared) + trial * len(self._own)
        for k, term in enumerate(self._own):
            if nuisance[base + k]:
                chosen.append(self.terms[term].entry(float(nuisance[base + k])))
        return tuple(chosen)

    def predictions(self, points: Sequence[tuple[Sequence[Candidate], Array, Array]]) -> Array:
        """(npoints, ntrials, T, C) at (parts, values, nuisance)."""
        wanted = [(t, self.effects(p, v, n, k)) for p, v, n in points for k, t in enumerate(self.trials)]
        out = self.predict(wanted)
        return out.reshape(len(points), len(self.trials), *out.shape[1:])

    def white(self, difference: Array) -> Array:
        """Whitened, (..., n)."""
        w = score.whiten(self.data, difference, self.weight)
        return w.reshape(*w.shape[:-3], -1)

    def residual(self, predicted: Array) -> Array:
        """Whitened, softened residual, (..., n)."""
        w = score.soften(score.whiten(self.data, self.data.value - predicted, self.weight))
        return w.reshape(*w.shape[:-3], -1)

    def nuisance_columns(self, parts: Sequence[Candidate], values: Array, nuisance: Array, base: Array) -> Array:
        """Whitened response to one deviation of every nuisance parameter around a point, (n, size)."""
        points = []
        for k in range(len(self.shared)):
            points.append((parts, values, _moved(nuisance, k)))
        for k in range(len(self._own)):
            moved = nuisance.copy()
            moved[len(self.shared) + k :: len(self._own)] += 1.0
            points.append((parts, values, moved))
        if not points:
            return np.zeros((self.data.value.size, 0))
        response = self.predictions(points) - base
        columns = list(self.white(response[: len(self.shared)]))
        for t in range(len(self.trials)):
            for k in range(len(self._own)):
                alone = np.zeros_like(response[0])
                alone[t] = response[len(self.shared) + k, t]
                columns.append(self.white(alone))
        return np.stack(columns, axis=1)

    def fit(
        self, parts: Sequence[Candidate], start: Array, nuisance: Array | None = None, *, thorough: bool = True
    ) -> Fitted:
        """Fit magnitudes and nuisances.

        Args:
            parts: candidates.
            start: their magnitudes, (k,).
            nuisance: where to start, (size,); 0 if None.
            thorough: recompute the nuisances' responses at the end, around what was found.
        """
        parts = tuple(parts)
        values = np.array(start, dtype=float)
        nu = np.zeros(self.size) if nuisance is None else nuisance.copy()
        base = self.predictions([(parts, values, nu)])[0]
        columns = self._columns
        if columns is None:
            columns = self._columns = self.nuisance_columns((), np.zeros(0), np.zeros(self.size), self._nominal())
        renewed = False
        for iteration in range(ITERATIONS):
            if thorough and not renewed and iteration == 2:
                columns = self.nuisance_columns(parts, values, nu, base)
                renewed = True
            jacobian = self._value_columns(parts, values, nu, base)
            r, everything = self._weighted(base, np.concatenate([jacobian, columns], axis=1))
            prior = np.concatenate([np.zeros(len(parts)), np.ones(self.size)])
            scale = np.concatenate([[part.high - part.low for part in parts], np.ones(self.size)])
            everything = everything * scale  # magnitudes in units of their bounds: well conditioned
            curvature = everything.T @ everything + np.diag(prior + 1e-6)
            gradient = everything.T @ r - prior * np.concatenate([values * 0, nu])
            step = scale * np.linalg.solve(curvature, gradient)
            points = []
            for share in STEPS:
                moved = np.array([_inside(p, v + share * s) for p, v, s in zip(parts, values, step, strict=False)])
                bound = score.NUISANCE_BOUND
                points.append((parts, moved, np.clip(nu + share * step[len(parts) :], -bound, bound)))
                if parts:
                    points.append((parts, moved, nu))  # the nuisances' responses may be those of another point
            tried = self.predictions(points)
            costs = [self._cost(tried[k], points[k][2]) for k in range(len(points))]
            best = int(np.argmin(costs))
            before = self._cost(base, nu)
            if costs[best] >= before:
                if thorough and not renewed:
                    columns = self.nuisance_columns(parts, values, nu, base)
                    renewed = True
                    continue
                break
            improved = before - costs[best]
            values, nu, base = points[best][1], points[best][2], tried[best]
            if improved < SETTLED and iteration > 1:
                break
        return self._finished(parts, values, nu, base, columns)

    def _nominal(self) -> Array:
        return self.predictions([((), np.zeros(0), np.zeros(self.size))])[0]

    def _value_columns(self, parts: tuple[Candidate, ...], values: Array, nu: Array, base: Array) -> Array:
        if not parts:
            return np.zeros((self.data.value.size, 0))
        points, steps = [], []
        for k, part in enumerate(parts):
            step = 0.02 * (abs(values[k] - part.identity) if np.isfinite(part.identity) else abs(values[k]))
            step = max(step, 1e-4 * (part.high - part.low))
            if values[k] + step > part.high:
                step = -step
            moved = values.copy()
            moved[k] += step
            points.append((parts, moved, nu))
            steps.append(step)
        response = (self.predictions(points) - base) / np.array(steps)[:, None, None, None]
        return np.asarray(self.white(response).T)

    def _weighted(self, base: Array, columns: Array) -> tuple[Array, Array]:
        """Residual and responses, both scaled down where the residual is softened."""
        white = self.white(self.data.value - base)
        soft = score.soften(white)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(white == 0, 1.0, soft / white)
        return soft, columns * share[:, None]

    def _cost(self, predicted: Array, nu: Array) -> float:
        r = self.residual(predicted)
        return float(0.5 * r @ r + 0.5 * nu @ nu)

    def _finished(self, parts: tuple[Candidate, ...], values: Array, nu: Array, base: Array, columns: Array) -> Fitted:
        jacobian = self._value_columns(parts, values, nu, base)
        _, everything = self._weighted(base, np.concatenate([jacobian, columns], axis=1))
        prior = np.concatenate([np.full(len(parts), 1e-9), np.ones(self.size)])
        curvature = everything.T @ everything + np.diag(prior)
        # A magnitude that the data do not bind is bound by its bounds.
        for k, part in enumerate(parts):
            curvature[k, k] += 12 / (part.high - part.low) ** 2
        _, logdet = np.linalg.slogdet(curvature)
        evidence = -self._cost(base, nu) - 0.5 * logdet
        for part in parts:
            evidence += 0.5 * np.log(2 * np.pi) - np.log(part.high - part.low)
        covariance = np.linalg.inv(curvature)
        return Fitted(
            parts,
            values,
            np.sqrt(np.diag(covariance)[: len(parts)]),
            nu,
            float(evidence),
            float(self._misfit(base).max(initial=0.0)),
        )

    def _misfit(self, predicted: Array) -> Array:
        """Mean squared residual of every channel in units of floor and tolerance, (C,)."""
        white = score.whiten(self.data, self.data.value - predicted, np.ones(len(self.data.channels)))
        known = np.isfinite(self.data.value).sum(axis=(0, 1))
        mean: Array = np.sum(white**2, axis=(0, 1)) / np.maximum(known, 1)
        return mean


def _moved(nuisance: Array, index: int) -> Array:
    moved = nuisance.copy()
    moved[index] += 1.0
    return moved


def _inside(part: Candidate, value: float) -> float:
    return float(np.clip(value, part.low, part.high))
