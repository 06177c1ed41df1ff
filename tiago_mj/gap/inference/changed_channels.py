"""Log likelihood of many predictions that differ from one in few channels.

What :func:`tiago_mj.gap.inference.likelihood.log_likelihood` computes of all channels is computed here of those that
change; of the others the squares of what is left, as a function of the nuisances, are expanded to second order around
the nuisances of the one prediction. That is exact as long as none of them is beyond the softening limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.likelihood import SOFTENING_LIMIT, Frame
from tiago_mj.gap.inference.noise_model import Data, select_channel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class White:
    """Whitened residuals of a channel, (npredictions, nrows), and their projections on the nuisances' columns,
    (npredictions, p)."""

    residual: Array
    projection: Array


@dataclass(frozen=True)
class Around:
    """One prediction, and of each of its channels what depends on the nuisances.

    Attributes:
        frame: what explanations are scored with.
        data: of each channel alone.
        columns: of the nuisances, (C, nrows, p).
        projection: of the prediction's residuals on them, (C, p).
        shift: most probable change of the nuisances, (p,).
        cost, gradient, hessian: of the softened squares of what is left, around that: (C,), (C, p), (C, p, p).
        log_likelihood: of the prediction.
    """

    frame: Frame
    data: tuple[Data, ...]
    columns: Array
    projection: Array
    shift: Array
    cost: Array
    gradient: Array
    hessian: Array
    log_likelihood: float

    @classmethod
    def of(cls, frame: Frame, base: Array) -> Around:
        """Around a prediction, (ntrials, T, C)."""
        count = base.shape[-1]
        columns = np.moveaxis(frame.columns.reshape(base[..., 0].size, count, frame.columns.shape[1]), 1, 0)
        data = tuple(select_channel(frame.data, c) for c in range(count))
        white = [_white(one, frame.weight[c], base[..., c]) for c, one in enumerate(data)]
        projection = np.stack([r @ a for r, a in zip(white, columns, strict=True)])
        nuisance = likelihood.most_probable(frame, projection.sum(axis=0))
        shift = nuisance - frame.at
        cost, gradient, hessian = [], [], []
        for r, a in zip(white, columns, strict=True):
            left = r - a @ shift
            soft = likelihood.soften(left)
            size = np.maximum(np.abs(left), SOFTENING_LIMIT)
            slope = SOFTENING_LIMIT / size  # of the softened residual
            cost.append(float(soft @ soft))
            gradient.append(-2 * a.T @ (soft * slope))
            hessian.append((a * (slope**2)[:, None]).T @ a)
        total = -0.5 * (sum(cost) + float(nuisance @ nuisance)) - 0.5 * frame.logdet
        return cls(
            frame, data, columns, projection, shift, np.array(cost), np.array(gradient), np.array(hessian), total
        )

    def white(self, c: int, predicted: Array) -> White:
        """Residuals of other predictions of a channel, (npredictions, ntrials, T)."""
        r = _white(self.data[c], self.frame.weight[c], predicted)
        return White(r, r @ self.columns[c])

    def log_likelihoods(self, changed: Mapping[int, White]) -> Array:
        """log p where the channels of ``changed`` are predicted otherwise, (npredictions,)."""
        mine = list(changed)
        others = np.setdiff1d(np.arange(len(self.data)), mine)
        projection = self.projection[others].sum(axis=0) + sum(changed[c].projection for c in mine)
        nuisance = likelihood.most_probable(self.frame, projection)
        shift = nuisance - self.frame.at
        cost = np.zeros(len(nuisance))
        for c in mine:
            left = likelihood.soften(changed[c].residual - shift @ self.columns[c].T)
            cost += np.einsum("ij,ij->i", left, left)
        off = shift - self.shift
        cost += self.cost[others].sum() + off @ self.gradient[others].sum(axis=0)
        cost += np.einsum("ij,ij->i", off @ self.hessian[others].sum(axis=0), off)
        return np.asarray(-0.5 * (cost + np.einsum("ij,ij->i", nuisance, nuisance)) - 0.5 * self.frame.logdet)


def _white(data: Data, weight: float, predicted: Array) -> Array:
    """Whitened residuals of one channel, (..., ntrials, T) to (..., nrows)."""
    white = likelihood.whiten(data, likelihood.residual(data, predicted[..., None]), np.array([weight]))
    return white.reshape(*white.shape[:-3], -1)
