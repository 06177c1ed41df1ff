"""What is not known beside a prediction: the error of the physics step, and the simulator's own sensitivity."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import sensor_noise
from tiago_mj.gap.inference.noise_model import (
    CONTACT_DEVIATIONS,
    EVENT_ROWS,
    Data,
    dilated,
    repeat_over_blocks,
    sum_by_block,
)
from tiago_mj.gap.simulation.replay import Signals

Array = NDArray[np.float64]

#: Share of the step's error that is still wrong once it was put right beside the very explanation. Halved and
#: doubled, none of 16 answers about hinges changes (varied.json).
STEP_ERROR_KNOWN_TO: Final = 0.2
#: Share of what is assumed for any two simulators that is left beside an explanation whose step error is put right:
#: the right explanation of one hinge (931:13) then left 1.02 and 1.06 deviations of the noise. Halved and doubled,
#: none of 15 answers about hinges changes (varied.json).
BESIDE: Final = 1 / 4
#: The nominal simulator is run once more with a physics step this many times shorter.
STEP_REFINEMENT: Final = 4


def with_step_tolerance(data: Data, predicted: Array, finer: Array) -> Data:
    """With a tolerance of what the nominal simulator itself gets wrong by its physics step: put right in the nominal
    model (:func:`step_errors`), it is as wrong in an explanation in which everything happens at another time.

    Args:
        data: measured.
        predicted, finer: nominal predictions at the step that is used and at one :data:`STEP_REFINEMENT` times shorter,
            (ntrials, T, C). Integrators of first order are off by FINER / (FINER - 1) of the difference. The mean
            over a block is an error that its rows share; the rest is independent between rows: a joint may chatter.
    """
    off = (predicted - finer) * STEP_REFINEMENT / (STEP_REFINEMENT - 1)
    alike = _block_means(off, data.block)
    apart, alike = (dilated(np.abs(one), EVENT_ROWS) for one in (off - alike, alike))
    return replace(
        data,
        sigma=np.sqrt(data.sigma**2 + alike**2 + apart**2),
        common=np.hypot(data.common, alike),
        stepless=data.stepless or (data.sigma, data.common),
    )


def beside(data: Data, predicted: Array, step_error: Array, *, in_contact: bool = True) -> Data:
    """With what is not known beside a prediction that explains what was measured: the noise of what that leaves, in
    which no motion hides the sensor's, and a small share of the step's error there, which is put right.

    Args:
        data: measured.
        predicted: the prediction, its step's error put right, (ntrials, T, C).
        step_error: what was put right, (ntrials, T, C).
        in_contact: whether in contacts, too, less is left than what is assumed for any two simulators.
    """
    sigma, common = data.stepless or (data.sigma, data.common)
    own = data.own.copy()
    for c in range(len(own)):
        if data.step is None or not data.step[c]:  # of what lies on a grid, the grid tells
            left = np.where(
                np.isfinite(sensor_noise.without_extremes(data.value[:, :, c])),
                (data.value - predicted)[:, :, c],
                np.nan,
            )
            own[c] = np.clip(
                sensor_noise.by_differences(left), own[c] if data.least is None else min(data.least[c], own[c]), own[c]
            )
    grid = 0.0 if data.step is None else data.step**2 / 12
    assumed = data.assumed or (np.zeros(1), np.zeros(1))
    kept = np.zeros(1, dtype=bool) if in_contact else touched(data, predicted)
    apart, alike = ((1 - BESIDE**2) * np.where(kept, 0.0, one) for one in assumed)
    there = replace(
        data,
        noise=np.sqrt(own**2 + grid),
        sigma=np.sqrt(np.maximum(sigma**2 - data.own**2 - apart - alike, 0.0) + own**2),
        common=np.sqrt(np.maximum(common**2 - alike, 0.0)),
        stepless=None,
        assumed=(assumed[0] * kept, assumed[1] * kept) if data.assumed and kept.any() else None,
    )
    uncertain = STEP_ERROR_KNOWN_TO * step_error * (STEP_REFINEMENT - 1) / STEP_REFINEMENT
    return with_step_tolerance(there, uncertain, np.zeros_like(uncertain))


def touched(data: Data, predicted: Array) -> NDArray[np.bool_]:
    """Rows in which a load cell is pressed, measured or predicted, or soon will be or just was, (ntrials, T, 1)."""
    forces = [c for c, kind in enumerate(data.kinds) if kind == "force"]
    either = np.maximum(np.abs(np.nan_to_num(data.value[:, :, forces])), np.abs(predicted[:, :, forces]))
    pressed = (either > CONTACT_DEVIATIONS * data.noise[forces]).any(axis=2, keepdims=True)
    return dilated(pressed.astype(float), EVENT_ROWS) > 0


def with_scatter(data: Data, alike: Array) -> Data:
    """With a tolerance for the simulator's own sensitivity: the scatter of predictions (n, ntrials, T, C) at negligibly
    different parameters, which diverge where an object sticks in one and slips in another.

    As of :func:`with_step_tolerance`, the mean over a block is an error that its rows share, the rest is independent.
    """
    spread = alike - alike.mean(axis=0)
    common = _block_means(spread, data.block)
    share = 1 / (len(alike) - 1)
    lasting, apart = (share * (part**2).sum(axis=0) for part in (common, spread - common))
    stepless = data.stepless and (
        np.sqrt(data.stepless[0] ** 2 + lasting + apart),
        np.hypot(data.stepless[1], lasting**0.5),
    )
    return replace(
        data,
        sigma=np.sqrt(data.sigma**2 + lasting + apart),
        common=np.sqrt(data.common**2 + lasting),
        stepless=stepless,
    )


def _block_means(values: Array, rows: int) -> Array:
    """The mean of its block for every row, (..., T, C)."""
    return repeat_over_blocks(
        sum_by_block(values, rows) / sum_by_block(np.ones_like(values), rows), rows, values.shape[-2]
    )


def step_errors(simulated: Signals, finer: Signals) -> Signals:
    """Error of signals due to the physics step, by Richardson extrapolation from a second run with a step
    :data:`STEP_REFINEMENT` times shorter."""
    share = STEP_REFINEMENT / (STEP_REFINEMENT - 1)
    return Signals(*((getattr(simulated, f) - getattr(finer, f)) * share for f in Signals.__dataclass_fields__))
