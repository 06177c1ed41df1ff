"""Training on simulators that are drawn anew for every episode."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")

from tiago_mj import cli
from tiago_mj.effects import read_effects
from tiago_mj.learn.environments import make_env
from tiago_mj.learn.randomise import draw, read_ranges
from tiago_mj.learn.settings import Settings

RANGES = {"command_delay": {"seconds": [0.0, 0.05]}, "servo_stiffness": {"factor": [0.25, 4.0]}}


def made(ranges, count=3):
    options = {"max_episode_steps": 12, "object_offset": 0.0}
    settings = Settings("tiago_mj/GripperTactile-v0", "td3", 100, options, None, {}, randomise=ranges)
    return make_env(settings, count)


def played(env, seed, steps=30):
    env.seed(seed)
    seen = [env.reset()]
    for _ in range(steps):
        observation, *_ = env.step(np.full((env.num_envs, 2), -1.0, dtype=np.float32))
        seen.append(observation)
    return np.array(seen)


def test_factors_are_drawn_by_ratio_and_times_evenly():
    rng = np.random.default_rng(0)
    drawn = [draw(RANGES, rng) for _ in range(2000)]
    times = np.array([one[0].parameters["seconds"] for one in drawn])
    factors = np.array([one[1].parameters["factor"] for one in drawn])
    assert [one.name for one in drawn[0]] == list(RANGES)
    assert times.min() >= 0
    assert times.max() <= 0.05
    # Standard errors of the means: 0.0145 / √2000 = 0.0003 s, and 0.80 / √2000 = 0.018.
    assert times.mean() == pytest.approx(0.025, abs=0.0015)
    assert np.log(factors).mean() == pytest.approx(0.0, abs=0.08)
    read_effects(drawn[0])


def test_every_episode_has_another_simulator():
    env = made({"velocity_limit": {"velocity": [0.004, 0.02]}})
    way = played(env, 3, steps=36)[:, :, 0]
    ends = way[[11, 23, 35]] - way[[0, 12, 24]]
    assert len(np.unique(np.round(ends, 7))) == 9


def test_the_same_seed_gives_the_same_episodes():
    np.testing.assert_array_equal(played(made(RANGES), 7), played(made(RANGES), 7))
    assert not np.array_equal(played(made(RANGES), 7), played(made(RANGES), 8))


def test_a_training_is_randomised_and_its_card_says_so(tmp_path):
    (tmp_path / "h.yml").write_text("default: {batch_size: 8, train_freq: 10, gradient_steps: 10, n_envs: 2}\n")
    (tmp_path / "ranges.yml").write_text("force_gain: {factor: [0.5, 2.0]}\n")
    words = [
        "train", "--env", "GripperTactile-v0", "--hyperparameters", str(tmp_path / "h.yml"), "--steps", "80",
        "--env-option", "max_episode_steps=20", "--evaluation-episodes", "2", "--checkpoint-every", "40", "--quiet",
        "--randomise", str(tmp_path / "ranges.yml"), "--out", str(tmp_path / "run"),
    ]  # fmt: skip
    assert cli.main(words) == 0
    assert '| randomised | {"force_gain": {"factor": [0.5, 2.0]}} |' in (tmp_path / "run" / "card.md").read_text()
    assert json.loads((tmp_path / "run" / "settings.json").read_text())["randomise"] == {
        "force_gain": {"factor": [0.5, 2.0]}
    }


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "give effects with ranges"),
        ({"no_such": {"factor": [1, 2]}}, "effect 'no_such' is unknown"),
        ({"force_gain": {"facto": [1, 2]}}, "has no parameter 'facto'"),
        ({"force_gain": {"factor": [2, 1]}}, "force_gain.factor is [2, 1]"),
        ({"command_delay": {"seconds": [-1, 0]}}, "at least 0"),
        ({"command_delay": 0.1}, "needs a range of a parameter"),
    ],
)
def test_unusable_ranges_are_one_line(given, said):
    with pytest.raises(ValueError, match=r"^ranges: .*") as fault:
        read_ranges(given, "ranges")
    assert said in str(fault.value)
    assert "\n" not in str(fault.value)
