"""Log likelihoods of predictions that differ in few channels are those of all channels."""

from dataclasses import replace

import numpy as np
import pytest

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.changed_channels import Around
from tiago_mj.gap.inference.noise_model import Data

ROWS, TRIALS, CHANNELS, NUISANCES = 40, 2, 4, 3


def made(size: float, step: float | None) -> tuple[likelihood.Frame, np.ndarray, np.ndarray]:
    """A frame of random recordings whose residuals are so large, a prediction, and others that change two channels."""
    rng = np.random.default_rng(3)
    shape = (TRIALS, ROWS, CHANNELS)
    base = rng.standard_normal(shape)
    noise = np.array([0.1, 0.2, 0.1, 0.3])
    value = base + size * noise * rng.standard_normal(shape)
    value[0, 5:9, 1] = np.nan
    sigma = noise * (1 + 0.1 * rng.random(shape))
    data = Data(
        ("position.a", "position.b", "velocity.a", "velocity.b"), np.array([0, 1, 0, 1]), value, noise, sigma,
        0.3 * sigma, block=8, step=None if step is None else np.array([step, 0.0, 0.0, step]),
    )  # fmt: skip
    responses = 0.2 * rng.standard_normal((NUISANCES, *shape))
    frame = likelihood.frame(data, np.full(CHANNELS, 0.8), responses, np.array([False, True, False]))
    frame = replace(frame, at=0.3 * rng.standard_normal(len(frame.at)))
    others = np.repeat(base[None], 5, axis=0)
    others[..., [0, 2]] += 0.3 * rng.standard_normal((5, TRIALS, ROWS, 2))
    return frame, base, others


@pytest.mark.parametrize("step", [None, 0.05])
def test_they_are_exact_where_nothing_is_softened(step: float | None) -> None:
    frame, base, others = made(1.0, step)
    around = Around.of(frame, base)
    changed = {c: around.white(c, others[..., c]) for c in (0, 2)}
    np.testing.assert_allclose(around.log_likelihood, likelihood.log_likelihood(frame, base[None])[0], rtol=1e-10)
    np.testing.assert_allclose(around.log_likelihoods(changed), likelihood.log_likelihood(frame, others), rtol=1e-10)


def test_softened_residuals_of_other_channels_are_expanded() -> None:
    """Within a hundredth of what the changes gain or lose."""
    frame, base, others = made(8.0, None)
    around = Around.of(frame, base)
    exact = likelihood.log_likelihood(frame, others) - likelihood.log_likelihood(frame, base[None])[0]
    near = around.log_likelihoods({c: around.white(c, others[..., c]) for c in (0, 2)}) - around.log_likelihood
    np.testing.assert_allclose(near, exact, atol=0.01 * np.abs(exact).max())


def test_all_channels_may_change() -> None:
    frame, base, others = made(8.0, None)
    around = Around.of(frame, base)
    changed = {c: around.white(c, others[..., c]) for c in range(CHANNELS)}
    np.testing.assert_allclose(around.log_likelihoods(changed), likelihood.log_likelihood(frame, others), rtol=1e-10)
