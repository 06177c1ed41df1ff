"""Exploration noise that falls to 0 over a training."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")

from stable_baselines3.common.noise import VectorizedActionNoise

from tiago_mj.learn.build import make_model
from tiago_mj.learn.environments import make_env
from tiago_mj.learn.noise import Fall, Falling, noise_of
from tiago_mj.learn.settings import Settings
from tiago_mj.learn.zoo_form import checked


@pytest.mark.parametrize("envs", [1, 3])
def test_it_is_narrower_by_the_share_of_the_training_that_is_left(envs):
    noise = noise_of({"noise_type": "normal", "noise_std": "lin_0.4"}, (2,))
    if envs > 1:
        noise = VectorizedActionNoise(noise, envs)
    fall = Fall(1000)
    widths = []
    for steps in (0, 500, 1000, 1200):
        fall.model = SimpleNamespace(action_noise=noise, num_timesteps=steps)
        fall.on_rollout_start()
        np.random.seed(0)  # noqa: NPY002 - what stable-baselines3 draws from
        widths.append(np.std([noise() for _ in range(2000)]))
    assert widths[0] == pytest.approx(0.4, rel=0.05)  # three standard errors of 4000 numbers
    assert widths[1] == pytest.approx(widths[0] / 2, rel=1e-6)
    assert widths[2:] == [0.0, 0.0]


def test_a_number_does_not_fall_and_no_type_is_no_noise():
    assert not isinstance(noise_of({"noise_type": "normal", "noise_std": 0.1}, (2,)), Falling)
    assert noise_of({"noise_std": 0.1}, (2,)) is None


def test_an_episode_begins_without_what_the_one_before_had_wandered():
    noise = noise_of({"noise_type": "ornstein-uhlenbeck", "noise_std": "lin_1.0"}, (2,))
    for _ in range(200):
        far = noise()
    noise.reset()
    # A step is 0.1 standard deviations wide; 200 of them wander some 1.3.
    assert np.abs(noise()).max() < 0.5 < np.abs(far).max()


def model_of(algo, **entry):
    given = checked(algo, {"policy_kwargs": {"net_arch": [4]}, "train_freq": 1, "buffer_size": 50, **entry}, "test")
    settings = Settings("tiago_mj/GripperTactile-v0", algo, 100, {}, None, given)
    return make_model(settings, make_env(settings, 3), 0)


def test_an_action_drawn_before_learning_starts_is_held_and_forgotten_with_its_episode():
    model = model_of("td3", hold=5, learning_starts=100)
    drawn = np.array([model._sample_action(100, None, 3)[1] for _ in range(13)])
    assert drawn.shape == (13, 3, 2)
    kept = (drawn[1:] == drawn[:-1]).all(axis=(1, 2))
    assert np.flatnonzero(~kept).tolist() == [4, 9]
    model.begin_episodes()
    assert (model._sample_action(100, None, 3)[1] != drawn[-1]).all()
    model.num_timesteps = 100
    model._last_obs = np.zeros((3, 6))
    learned = [model._sample_action(100, None, 3)[1] for _ in range(2)]
    np.testing.assert_array_equal(learned[0], learned[1])
    np.testing.assert_array_equal(learned[0][0], learned[0][1])


def test_who_cannot_hold_an_action_says_so():
    with pytest.raises(ValueError, match="hold is of td3 and her-td3"):
        model_of("ddpg", hold=5)
