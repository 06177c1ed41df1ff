"""By how much an explanation lowers the residual of trials kept aside, in the units explanations are compared in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tiago_mj.gap.analysis.promises import CLOSES
from tiago_mj.gap.analysis.remainder import Remainder, weighed_share
from tiago_mj.gap.inference.noise_model import Data

ROWS = 400
#: A row of the load cell in which contact begins, and by how many noises a prediction misses it there.
ONSET, MISSED = 200, 16.0


@dataclass(frozen=True)
class Recorded:
    data: Data
    test: tuple[int, ...] = (0,)


@dataclass(frozen=True)
class Predictor:
    data: Data
    replays: bool
    corrected: bool = False


def measured(assumed: float) -> Data:
    """A load cell with noise of 1, and what any two simulators differ by, ``assumed``, in every row."""
    value = np.random.default_rng(0).standard_normal((1, ROWS, 1))
    tolerance = np.full_like(value, assumed)
    sigma = np.sqrt(1 + tolerance**2)
    return Data(
        ("force.left",),
        np.zeros(1, dtype=int),
        value,
        np.ones(1),
        sigma,
        np.zeros_like(value),
        assumed=(tolerance**2, np.zeros_like(value)),
    )


def left(predicted: np.ndarray[Any, Any], data: Data) -> Remainder:
    return Remainder(float(np.mean((data.value - predicted) ** 2)), 1.0, predicted=predicted)


@pytest.mark.parametrize("replays", [True, False])
def test_an_onset_that_is_late_does_not_hide_what_an_effect_explains(replays: bool) -> None:
    """Hysteresis explains a shift of 0.7 noises all along, and its contact begins a row later (seed 71, case 16)."""
    data = measured(2.0 if replays else 0.0)
    without, with_it = np.full_like(data.value, 0.7), np.zeros_like(data.value)
    with_it[0, ONSET] = MISSED
    nothing, rest = left(without, data), left(with_it, data)
    assert rest.gap > nothing.gap  # in units of the noise alone the explanation makes it worse
    found = weighed_share(Recorded(data), Predictor(data, replays), None, rest, nothing)  # type: ignore[arg-type]
    assert CLOSES < found < 0.49 / 1.49  # the onset, compressed, takes some of that third back


def test_what_fits_the_noise_of_other_trials_closes_nothing() -> None:
    data = measured(2.0)
    noise = 0.1 * np.random.default_rng(1).standard_normal(data.value.shape)
    nothing, rest = left(np.zeros_like(data.value), data), left(noise, data)
    found = weighed_share(Recorded(data), Predictor(data, True), None, rest, nothing)  # type: ignore[arg-type]
    assert found < CLOSES
