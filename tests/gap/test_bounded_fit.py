"""The least squares within bounds that every explanation along a measured motion is fitted by."""

import numpy as np
import pytest

from tiago_mj.gap.torque.normal import Normal, Rows, within


def problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Correlated columns, of which several would lie outside bounds that are tight, one-sided, or hold zero alone."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 15))
    matrix = random.standard_normal((4 * n, n)) @ (np.eye(n) + random.uniform(0, 1.5) * random.standard_normal((n, n)))
    target = matrix @ random.standard_normal(n) + random.standard_normal(4 * n)
    low, high = -random.uniform(0, 0.4, n), random.uniform(0, 0.4, n)
    low[random.random(n) < 0.1], high[random.random(n) < 0.1] = -np.inf, np.inf
    low[random.random(n) < 0.1] = 0.0
    return matrix, target, low, high


def optimal(gradient: np.ndarray, values: np.ndarray, low: np.ndarray, high: np.ndarray, slack: float) -> np.ndarray:
    """Karush, Kuhn and Tucker, variable by variable: no slope inside, none that leads back inside at a bound."""
    at_low, at_high = values <= low, values >= high
    inside = (np.abs(gradient) <= slack) & ~at_low & ~at_high
    return inside | (at_low & (gradient >= -slack)) | (at_high & (gradient <= slack))


@pytest.mark.parametrize("seed", range(300))
def test_the_optimum_within_tight_bounds_is_found(seed: int) -> None:
    matrix, target, low, high = problem(seed)
    gram, right = matrix.T @ matrix, matrix.T @ target
    found = within(gram, right, low, high)
    assert ((found >= low) & (found <= high)).all()
    # Rounding in a gradient is some 1e-16 of its terms, which the conditioning of the columns enlarges.
    slack = 1e-9 * float(np.abs(gram).max() * np.abs(found).max() + np.abs(right).max())
    assert optimal(gram @ found - right, found, low, high, slack).all()


def test_a_fit_of_several_blocks_is_optimal_with_priors_and_releases_what_it_need_not_hold() -> None:
    """Two opposing columns: the first would leave its bound, and comes back inside as soon as the second is held."""
    random = np.random.default_rng(1)
    rows = Rows(np.ones((60, 1), bool), np.repeat(np.arange(3), 20), np.ones(1))
    first = random.standard_normal(60)
    second = first + 0.1 * random.standard_normal(60)
    gap = 3.0 * first - 2.9 * second
    low, high = np.array([0.0, -0.5]), np.array([2.0, 0.5])
    precision = np.array([0.5, 0.0])
    normal = Normal(rows, gap[:, None], [first[:, None], second[:, None]], precision, low, high)
    found = normal.fit([0, 1], [0, 1, 2])
    assert 0.0 < found[0] < 2.0
    assert found[1] == -0.5
    gram = normal.gram.sum(axis=0) + np.diag(precision)
    gradient = gram @ found - normal.right.sum(axis=0)
    assert optimal(gradient, found, low, high, 1e-6 * float(np.abs(gram).max())).all()  # a ridge of 1e-9 beside it


def test_a_variable_without_freedom_stays_where_it_is_held() -> None:
    gram, right = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([4.0, 0.0])
    assert within(gram, right, np.array([-1.0, 1.0]), np.array([9.0, 1.0])) == pytest.approx([1.5, 1.0])
    assert within(gram, right, np.array([1.0, 1.0]), np.array([1.0, 1.0])) == pytest.approx([1.0, 1.0])
