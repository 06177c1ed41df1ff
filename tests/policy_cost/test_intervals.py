"""Intervals: they hold the truth as often as they say."""

import numpy as np
import pytest
from scipy import stats

from tiago_mj.policy_cost.intervals import of_returns, of_successes


def test_without_a_spread_of_magnitudes_it_is_students_interval_of_paired_differences():
    values = np.random.default_rng(0).normal(3.0, 2.0, (1, 12))
    found = of_returns(values)
    low, high = stats.t.interval(0.95, 11, values.mean(), stats.sem(values[0]))
    assert (found.mean, found.low, found.high) == pytest.approx((values.mean(), low, high), abs=1e-6)


def test_it_holds_the_cost_of_the_robots_own_magnitude_in_95_of_100_cases():
    rng, held = np.random.default_rng(1), []
    drawn = stats.norm.ppf((np.arange(10) + 0.5) / 10)  # of a posterior N(0, 1)
    for _ in range(600):
        robot = rng.normal()
        episodes = rng.normal(0.0, 2.0, 15)  # what is harder in an episode; the same in every draw
        found = of_returns(5.0 + drawn[:, None] + episodes)
        held.append(found.low <= 5.0 + robot <= found.high)
    assert 0.92 < np.mean(held) < 0.98


def test_more_episodes_narrow_it_to_the_magnitudes_own_spread_and_no_further():
    rng = np.random.default_rng(2)
    drawn = stats.norm.ppf((np.arange(50) + 0.5) / 50)

    def width(episodes):
        found = of_returns(drawn[:, None] + rng.normal(0.0, 3.0, episodes))
        return found.high - found.low

    assert width(10) > width(100) > width(10_000)
    assert width(10_000) == pytest.approx(2 * 1.96, rel=0.1)


def test_equal_differences_have_no_spread_and_a_single_episode_none_that_is_known():
    certain = of_returns(np.full((1, 9), 4.0))
    assert (certain.mean, certain.low, certain.high) == (4.0, 4.0, 4.0)
    two = of_returns(np.stack([np.full(9, 1.0), np.full(9, 3.0)]))
    assert (two.low, two.high) == pytest.approx((1.0, 3.0), abs=1e-6)
    single = of_returns(np.ones((4, 1)))
    assert (single.low, single.high) == (None, None)
    assert not single.above_zero


def test_paired_successes_have_agresti_and_mins_interval():
    before, after = np.array([[1.0] * 14 + [0.0] * 6]), np.array([[1.0] * 5 + [0.0] * 14 + [1.0]])
    found = of_successes(before, after)
    lost, won, n = 9.5, 1.5, 22
    middle, error = (lost - won) / n, np.sqrt(lost + won - (lost - won) ** 2 / n) / n
    assert found.mean == pytest.approx(8 / 20)
    assert (found.low, found.high) == pytest.approx((middle - 1.96 * error, middle + 1.96 * error), abs=1e-3)
    same = of_successes(before, before)
    assert same.low < 0 < same.high
    sure = of_successes(np.ones((1, 20)), np.zeros((1, 20)))
    assert sure.high <= 1
