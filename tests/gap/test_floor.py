"""What a difference between recording and prediction is measured by."""

import numpy as np
import pytest

from tiago_mj.gap import floor, score
from tiago_mj.gap.floor import Data

ROWS, NOISE = 60, 0.1


def flat(value=0.0) -> Data:
    """One channel of one trial at rest, in blocks of six rows."""
    values = np.full((1, ROWS, 1), value)
    noise = np.array([NOISE])
    sigma = np.full_like(values, NOISE)
    return Data(("position.hinge",), np.array([0]), values, noise, sigma, np.zeros_like(values), block=6)


def cost(data: Data, difference) -> float:
    return float((score.whiten(data, difference, np.ones(1)) ** 2).sum())


def test_a_joint_that_chatters_in_the_simulator_alone_may_stand_still_in_another_explanation():
    """Half a deviation would be charged for each sample if the chatter were believed to err alike over a block."""
    chatter = 0.4 * (-1.0) ** np.arange(ROWS)[None, :, None]
    data = floor.with_numerics(flat(), chatter, np.zeros_like(chatter))
    off = chatter * floor.FINER / (floor.FINER - 1)
    assert (data.common < 1e-9).all()
    assert cost(data, off) < ROWS


def test_what_a_step_shifts_for_good_is_one_error_and_not_many():
    shifted = np.full((1, ROWS, 1), 0.4)
    data = floor.with_numerics(flat(), shifted, np.zeros_like(shifted))
    off = shifted * floor.FINER / (floor.FINER - 1)
    assert data.common == pytest.approx(np.abs(off))
    assert cost(data, off) < ROWS / data.block * 1.01  # of each block once
    assert cost(data, off * (-1.0) ** np.arange(ROWS)[None, :, None]) > 20 * ROWS / data.block


@pytest.mark.parametrize("share", [0.05, 0.2, 2.0])
def test_readings_on_a_grid_differ_by_what_is_allowed_for_it(share):
    """Against draws: of values a deviation apart of which both are rounded. A quarter more than they scatter by is
    allowed where the grid is as fine as the noise."""
    step, rng = 1.0, np.random.default_rng(1)
    deviation = share * step
    one = rng.uniform(0, 100, 200_000)
    other = one + rng.normal(0, deviation, one.size)
    apart = np.round(one / step) * step - np.round(other / step) * step
    data = floor.on_grid(
        Data(
            ("position.hinge",),
            np.array([0]),
            np.zeros((1, 1, 1)),
            np.array([deviation]),
            np.full((1, 1, 1), deviation),
            np.zeros((1, 1, 1)),
        ),
        "position",
        ("hinge",),
        step,
    )
    allowed = float(data.sigma[0, 0, 0])
    assert np.sqrt(np.mean(apart**2)) <= allowed < 1.25 * np.sqrt(np.mean(apart**2))
    whole = np.full((1, 1, 1), step)
    assert score.lasting(data, whole)[0] < (step / deviation) ** 2  # what stands still stays apart
    assert (floor.on_grid(data, "force", None, step).sigma == data.sigma).all()
