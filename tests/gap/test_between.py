"""Readings on a grid say between which two values a signal was; noise, tolerance and likelihood know that."""

import numpy as np
import pytest

from tiago_mj.gap.inference import between, likelihood, noise_model, sensor_noise
from tiago_mj.gap.inference.noise_model import Data

ROWS = 60_000


def read(step, deviation=1.0, offset=0.0, seed=0, after=True):
    """Signals anywhere on a grid, readings of them, and the deviation and step in their shape."""
    rng = np.random.default_rng(seed)
    true = rng.uniform(0, 100 * max(step, 1.0), ROWS)
    noise = deviation * rng.standard_normal(ROWS)
    rounded = np.round((true + (noise if after else 0.0)) / step) * step + (0.0 if after else noise)
    return rounded - true - offset, np.full(ROWS, deviation), np.full(ROWS, step)


@pytest.mark.parametrize("step", [0.1, 1.0, 3.0, 10.0, 30.0])
@pytest.mark.parametrize("after", [True, False], ids=["noise is rounded", "noise comes after"])
def test_at_the_truth_nothing_pulls_and_a_reading_is_no_worse_than_one_without_grid(step, after):
    args = read(step, after=after)
    pull = between.score(*args)
    assert abs(pull.mean()) < 4 * pull.std() / np.sqrt(ROWS)
    assert (between.residual(*args) ** 2).mean() < 1 + 4 * np.sqrt(2 / ROWS)
    assert pull.var() == pytest.approx(
        between.relative_information(*args[1:])[0], rel=0.15
    )  # information is the score's variance


def test_without_a_grid_the_residual_is_the_difference():
    difference = np.random.default_rng(0).normal(size=50)
    for step in (0.0, 1e-5):
        args = difference, np.full(50, 0.5), np.full(50, step)
        np.testing.assert_allclose(between.residual(*args), difference, rtol=1e-9)
        np.testing.assert_allclose(between.slope(*args), 1.0, atol=1e-9)
        np.testing.assert_allclose(between.relative_information(*args[1:]), 1.0, atol=1e-4)


def test_inside_of_a_coarse_interval_nothing_counts_and_outside_the_distance_to_it():
    step, one = np.array(20.0), np.array(1.0)
    inside = between.residual(np.array([-6.0, 0.0, 6.0]), one, step)
    assert np.abs(inside).max() < 0.02
    far = between.residual(np.array([-30.0, 30.0, 1e6]), one, step)
    np.testing.assert_allclose(far, [-20.0, 20.0, 1e6 - 10], rtol=0.01)
    ramp = between.residual(np.linspace(-40, 40, 801), one, step)
    assert (np.diff(ramp) >= -1e-12).all()
    slope = between.slope(np.linspace(-40, 40, 801), one, step)
    np.testing.assert_allclose(slope[1:-1], (ramp[2:] - ramp[:-2]) / 0.2, atol=2e-3)


@pytest.mark.parametrize("step", [1.0, 4.0])
def test_the_sum_of_squares_is_that_of_the_likelihood(step):
    """Of an offset: the best and its width, against the likelihood of readings itself."""
    from scipy.stats import norm

    args = read(step, offset=0.3)
    args = tuple(one[:6000] for one in args)
    tried = np.linspace(-0.6, 0.0, 121)
    cost = [0.5 * (between.residual(args[0] - t, *args[1:]) ** 2).sum() for t in tried]
    r = [args[0] - t for t in tried]
    exact = [-np.log(norm.cdf(x + step / 2) - norm.cdf(x - step / 2)).sum() for x in r]
    np.testing.assert_allclose(cost - min(cost), exact - min(exact), rtol=1e-6, atol=1e-6)
    assert tried[int(np.argmin(cost))] == pytest.approx(
        -0.3, abs=4 / np.sqrt(6000 * between.relative_information(*args[1:])[0])
    )


@pytest.mark.parametrize("step", [0.3, 1.0, 2.0, 4.0, 8.0])
def test_noise_beside_a_grid_does_not_collapse(step):
    """Thirty trials that rest somewhere: known to a third, where readings flicker in some of them."""
    rng = np.random.default_rng(4)
    values = np.round((rng.uniform(0, 100, (30, 1)) + rng.standard_normal((30, 64))) / step) * step
    assert sensor_noise.beside_grid(values, 1e-3) == pytest.approx(1.0, rel=0.35)


def test_noise_that_a_grid_hides_is_what_the_sensor_is_said_to_have_and_never_a_small_share_of_the_grid():
    constant = np.zeros((4, 100))
    constant[:, 60:] = 0.03
    assert sensor_noise.beside_grid(constant, 0.002, nominal=0.0077) == 0.0077
    assert sensor_noise.beside_grid(constant, 0.002) == pytest.approx(0.03 / 8)


@pytest.mark.parametrize("level", [0.02, 0.37])
def test_a_load_cell_that_rests_on_a_line_shows_no_error_that_lasts(level):
    """It reads one value throughout, up to half a step off what it feels: that is the truth of a coarse grid."""
    step, noise = 0.1, 0.005
    values = np.full((2, 240, 1), np.round(level / step) * step)
    data = Data(
        ("force.left",),
        np.array([0]),
        values,
        np.array([np.sqrt(noise**2 + step**2 / 12)]),
        np.full_like(values, noise),
        np.zeros_like(values),
        block=60,
        step=np.array([step]),
    )
    at_truth = np.full_like(values, level)
    assert likelihood.distance(data, at_truth) < 0.1  # of 480 samples
    assert likelihood.lasting(data, values - at_truth)[0] < 0.1
    off = at_truth + step
    assert likelihood.lasting(data, values - off)[0] > 10
    assert likelihood.distance(data, off) > 5e3


def test_a_grid_of_two_lines_is_one_and_noise_is_none():
    rng = np.random.default_rng(0)
    assert sensor_noise.grid_of(np.where(rng.random((3, 50)) < 0.3, 0.2, 0.0)) == pytest.approx(0.2)
    assert sensor_noise.grid_of(rng.normal(size=(3, 50))) == 0.0
    assert sensor_noise.grid_of(np.full((3, 50), 0.4)) == 0.0


def test_the_tolerance_of_an_onset_is_found_through_the_grid():
    """A force that begins to grow by 20 units/s: two simulators that differ by 2 ms are then 0.04 apart."""
    period, step, noise = 1 / 240, 0.075, np.array([0.0077])
    time = np.arange(240) * period
    true = np.maximum(20 * (time - 0.5), 0.0).clip(max=1.5)[None, :, None]
    args = noise, noise_model.Tolerance(np.array([0.0])), ("force.left",), period
    grid, _ = noise_model.sigma(np.round(true / step) * step, *args, np.array([step]))
    there = (time > 0.49) & (time < 0.53)
    assert 0.02 < grid[0, there, 0].max() < 0.08
    assert np.median(grid[0, time < 0.4, 0]) == pytest.approx(noise[0], rel=0.01)
