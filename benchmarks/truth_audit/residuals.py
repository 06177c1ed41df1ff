"""What a prediction leaves of recordings, in variances of the sensors' noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.blind.cases import Made

Array = NDArray[np.float64]

#: A case passes where every channel, pooled over its trials, leaves no more than this many noise variances ...
POOLED: Final = 1.3
#: ... and no single trial of a channel more than chance does in one case of a thousand, corrected for their number.
CHANCE: Final = 1e-3
#: A load cell reads more than noise beyond this many deviations of it.
TOUCHING: Final = 5.0


@dataclass(frozen=True)
class Left:
    """What one prediction leaves of a case, in variances of the noise.

    Attributes:
        channels: names, C.
        trial: mean square by trial and channel, (ntrials, C); NaN where nothing was measured.
        count: samples that it is of, (ntrials, C).
        onsets: rows at which a touch begins or ends, which are left out, and the largest residual there [deviations].
    """

    channels: tuple[str, ...]
    trial: Array
    count: NDArray[np.int_]
    onsets: tuple[int, float] = (0, 0.0)

    @property
    def pooled(self) -> Array:
        """By channel, over all trials, (C,)."""
        whole = np.nansum(self.trial * self.count, axis=0)
        return whole / np.maximum(self.count.sum(axis=0), 1)

    @property
    def beyond_chance(self) -> int:
        """Trials of a channel whose sum of squares exceeds its bound."""
        cells = max(int((self.count > 0).sum()), 1)
        bound = stats.chi2.isf(CHANCE / cells, np.maximum(self.count, 1)) / np.maximum(self.count, 1)
        return int((np.nan_to_num(self.trial) > bound).sum())

    @property
    def passes(self) -> bool:
        """Whether nothing but noise is left."""
        return bool((self.pooled <= POOLED).all() and not self.beyond_chance)


def noise_of(made: Made, channels: Sequence[str]) -> tuple[Array, Array]:
    """Standard deviation of the noise of each channel, and step of the grid that its readings lie on; (C,) each, and 0
    for none."""
    robot, case = made.robot, made.case
    by = {
        **{f"position.{j}": robot.noise[0, k] for k, j in enumerate(robot.joints)},
        **{f"velocity.{j}": robot.noise[1, k] for k, j in enumerate(robot.joints)},
        "force.right": robot.force_noise, "force.left": robot.force_noise,
    }  # fmt: skip
    sigma, grid = np.array([float(by[name]) for name in channels]), np.zeros(len(channels))
    for choice in case.effects:
        for c, name in enumerate(channels):
            kind, _, part = name.partition(".")
            if choice.target != "all" and part not in choice.target:
                continue
            factor = {"force_noise": kind == "force", "encoder_scale": kind != "force"}.get(choice.name, False)
            step = {"encoder_quantization": "position", "force_quantization": "force"}.get(choice.name) == kind
            sigma[c] *= choice.parameters["factor"] if factor else 1.0
            grid[c] = choice.parameters["step"] if step else grid[c]
    return sigma, grid


def at_onsets(value: Array, predicted: Array, sigma: Array, channels: Sequence[str]) -> NDArray[np.bool_]:
    """Rows at which a touch begins or ends in what was measured or predicted, (ntrials, T).

    The pads' dampers make a force jump by up to a newton within one physics step: which of two rows is the first to
    show it is decided by a fraction of reality's own step, so that these rows say nothing of a form.
    """
    out = np.zeros(value.shape[:2], dtype=bool)
    for c, name in enumerate(channels):
        if name.startswith("force."):
            for readings in (value[..., c], predicted[..., c]):
                touching = np.nan_to_num(np.abs(readings)) > TOUCHING * sigma[c]
                out[:, 1:] |= touching[:, 1:] != touching[:, :-1]
    return out


def left(
    value: Array, predicted: Array, sigma: Array, grid: Array, channels: tuple[str, ...], *, onsets: bool = False
) -> Left:
    """What a prediction leaves of the measured, (ntrials, T, C); with ``onsets`` those rows count as well."""
    apart = (value - predicted) / sigma
    rng = np.random.default_rng(0)
    for c in np.flatnonzero(grid):
        low = stats.norm.cdf(apart[..., c] - grid[c] / 2 / sigma[c])
        high = stats.norm.cdf(apart[..., c] + grid[c] / 2 / sigma[c])
        drawn = stats.norm.ppf(low + rng.random(low.shape) * (high - low))
        # Many deviations away both are 0 or 1: what is left is how far beyond the cell it lies.
        far = np.sign(apart[..., c]) * np.maximum(np.abs(apart[..., c]) - grid[c] / 2 / sigma[c], 0.0)
        apart[..., c] = np.where(np.isfinite(drawn), drawn, far)
        apart[..., c] = np.where(np.isfinite(value[..., c]), apart[..., c], np.nan)
    at = np.zeros(apart.shape[:2], dtype=bool) if onsets else at_onsets(value, predicted, sigma, channels)
    largest = float(np.nanmax(np.abs(apart[at]), initial=0.0)) if at.any() else 0.0
    apart[at] = np.nan
    known = np.isfinite(apart)
    count = known.sum(axis=1)
    square = np.where(known, apart, 0.0) ** 2
    trial = np.where(count > 0, square.sum(axis=1) / np.maximum(count, 1), np.nan)
    return Left(channels, trial, count, (int(at.sum()), largest))
