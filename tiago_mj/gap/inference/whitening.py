"""Whitening of residuals, and the normal equations of a Gauss-Newton step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.noise_model import Data

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Whitening:
    """What residuals are measured by.

    Attributes:
        data: measured, with floor and tolerance.
        weight: square root of what a sample of each channel counts for, (C,).
        tolerance_cost: half the log-determinant by which the tolerance is wider than the nominal model's [nats].
        exact: the same without a tolerance for the form of effects; None: this one has none.
    """

    data: Data
    weight: Array
    tolerance_cost: float = 0.0
    exact: Whitening | None = None

    def with_form_tolerance(self, missed: Array) -> Whitening:
        """This whitening with a tolerance for the form of effects: ``missed`` is its deviation, (ntrials, T, C)."""
        own = self.data.sigma**2 - self.data.common**2
        form = missed**2
        cost = np.where(np.isfinite(self.data.value), 0.5 * np.log1p(form / own), 0.0) * self.weight**2
        wider = replace(self.data, sigma=np.sqrt(self.data.sigma**2 + form))
        return Whitening(wider, self.weight, float(cost.sum()), self.exact or self)

    def white(self, difference: Array) -> Array:
        """Whitened, (..., n)."""
        w = likelihood.whiten(self.data, difference, self.weight)
        return w.reshape(*w.shape[:-3], self.data.value.size)

    def columns(self, responses: Array, per_trial: NDArray[np.bool_]) -> Array:
        """Whitened responses, (nterms, ntrials, T, C) to (n, size), see :func:`likelihood.columns`."""
        return likelihood.columns(likelihood.whiten(self.data, responses, self.weight), per_trial)

    def weighted(self, predicted: Array, columns: Array) -> tuple[Array, Array]:
        """Residual (n,) and responses (n, k), both scaled down where the residual is softened, responses also where a
        reading on a grid does not show them."""
        white = self.white(likelihood.residual(self.data, predicted))
        soft = likelihood.soften(white)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(white == 0, 1.0, soft / white)
        on_grids = likelihood.slope(self.data, predicted)
        if on_grids is not None:
            share = share * on_grids.ravel()
        return soft, columns * share[:, None]

    def cost(self, predicted: Array, nuisance: Array) -> float:
        """Half the sum of squares of residual and nuisances [nats]."""
        r = likelihood.soften(self.white(likelihood.residual(self.data, predicted)))
        return float(0.5 * r @ r + 0.5 * nuisance @ nuisance)

    def misfit(self, predicted: Array) -> Array:
        """Mean squared residual of every channel in units of floor and tolerance, (C,)."""
        white = likelihood.scaled(self.data, likelihood.residual(self.data, predicted))
        known = np.isfinite(self.data.value).sum(axis=(0, 1))
        mean: Array = np.sum(white**2, axis=(0, 1)) / np.maximum(known, 1)
        return mean


@dataclass(frozen=True)
class Normal:
    """Normal equations of a Gauss-Newton step, in units of ``scale``.

    Attributes:
        curvature: (k, k), of magnitudes and nuisances.
        gradient: (k,).
        scale: (k,).
        room: how far each may go down and up, (2, k), in its own unit; None: as far as it likes.
    """

    curvature: Array
    gradient: Array
    scale: Array
    room: Array | None = None

    def step(self, damping: float = 0.0) -> Array:
        """(k,), the lowest point within the room; where two unknowns do the same, to within rounding, the shortest of
        the steps that fit alike."""
        damped = self.curvature + damping * np.diag(np.diag(self.curvature))
        try:
            step = np.linalg.solve(damped, self.gradient)
        except np.linalg.LinAlgError:
            step = np.linalg.lstsq(damped, self.gradient, rcond=None)[0]
        if self.room is not None:
            low, high = self.room / self.scale
            if (step < low).any() or (step > high).any():
                step = _within(damped, self.gradient, low, high)
        return self.scale * step

    def variances(self) -> Array:
        """Of the unknowns, (k,); where two do the same, of what both determine."""
        try:
            inverse = np.linalg.inv(self.curvature)
        except np.linalg.LinAlgError:
            inverse = np.linalg.pinv(self.curvature, hermitian=True)
        return np.square(self.scale) * np.diag(inverse)

    def first(self, count: int) -> Normal:
        """Of the first unknowns alone, the others where they are."""
        room = None if self.room is None else self.room[:, :count]
        return Normal(self.curvature[:count, :count], self.gradient[:count], self.scale[:count], room)

    @property
    def predicted_drop(self) -> float:
        """Drop of the cost by the full step if responses are linear [nats]."""
        step = self.step() / self.scale
        return float(self.gradient @ step - 0.5 * step @ self.curvature @ step)


def _within(curvature: Array, gradient: Array, low: Array, high: Array) -> Array:
    """The lowest point of a quadratic cost within bounds. A step that is cut off at its bounds is not: where unknowns
    make up for each other, the others have to go another way when one of them can go no further.

    Args:
        curvature, gradient: of the cost, (k, k), (k,).
        low, high: bounds, (k,), 0 within them.
    """
    unit = 1 / np.sqrt(np.diag(curvature))
    values, vectors = np.linalg.eigh(curvature * unit * unit[:, None])
    root = np.sqrt(np.maximum(values, np.finfo(float).eps * values[-1]))
    found = optimize.lsq_linear(
        root[:, None] * vectors.T,
        vectors.T @ (gradient * unit) / root,
        (np.minimum(low, 0.0) / unit, np.maximum(high, 0.0) / unit),
        method="bvls",
    )
    return np.asarray(found.x * unit)
