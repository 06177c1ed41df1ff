"""Agents that take what lies beyond their training for the edge of it."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest

from tiago_mj.learn.agent_file import Agent, load_agent
from tiago_mj.learn.cut import cut, met

LOW, HIGH = np.array([-1.0, 0.5, 2.0]), np.array([1.0, 1.5, 2.0])


@pytest.fixture
def agent():
    rng = np.random.default_rng(1)
    shapes = ((8, 3), (8, 8), (2, 8))
    layers = [(rng.normal(size=s).astype(np.float32), rng.normal(size=s[0]).astype(np.float32)) for s in shapes]
    bound = np.ones(2, dtype=np.float32)
    return Agent(tuple(layers), "ReLU", "tanh", (("", 3),), -bound, bound)


def test_within_the_bounds_nothing_changes_and_beyond_them_it_acts_as_at_the_edge(agent, tmp_path):
    cut(agent, LOW, HIGH).save(tmp_path / "cut.npz")
    edged = load_agent(tmp_path / "cut.npz")
    rng = np.random.default_rng(2)
    inside = rng.uniform(LOW, HIGH, (50, 3))
    np.testing.assert_allclose(edged(inside), agent(inside), atol=1e-5)  # float32 in another order
    outside = inside + rng.normal(0, 5, (50, 3))
    np.testing.assert_allclose(edged(outside), agent(np.clip(outside, LOW, HIGH)), atol=1e-5)
    assert np.abs(agent(outside) - edged(outside)).max() > 0.1


def test_the_bounds_are_those_of_the_trainings_memory(agent, tmp_path):
    seen = np.random.default_rng(3).normal(size=(20, 4, 3)).astype(np.float32)
    with (
        zipfile.ZipFile(tmp_path / "checkpoint.zip", "w") as archive,
        archive.open("replay/observations/.npy", "w") as file,
    ):
        np.lib.format.write_array(file, seen)
    low, high = met(tmp_path / "checkpoint.zip", agent)
    np.testing.assert_array_equal(low, seen.reshape(-1, 3).min(axis=0))
    np.testing.assert_array_equal(high, seen.reshape(-1, 3).max(axis=0))
    (tmp_path / "checkpoint.zip").write_bytes(b"PK")
    with pytest.raises(ValueError, match="holds no observations"):
        met(tmp_path / "checkpoint.zip", agent)


def test_an_agent_that_normalises_is_not_cut_twice(agent):
    with pytest.raises(ValueError, match="cut already"):
        cut(cut(agent, LOW, HIGH), LOW, HIGH)
