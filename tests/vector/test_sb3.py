"""Vector environments in stable-baselines3."""

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from tiago_mj.vector.sb3 import SB3VecEnv, make_sb3

GRIPPER, PUSH = "tiago_mj/GripperTactile-v0", "tiago_mj/TIAGoPush-v0"


@pytest.mark.parametrize("env_id", [GRIPPER, PUSH])
def test_it_is_what_stable_baselines3_makes_of_scalar_environments(env_id):
    ours = make_sb3(env_id, 2, seed=4, max_episode_steps=6)
    theirs = DummyVecEnv([lambda: Monitor(gymnasium.make(env_id, max_episode_steps=6)) for _ in range(2)])
    theirs.seed(4)
    first, expected = ours.reset(), theirs.reset()
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(15):
        np.testing.assert_equal(first, expected)
        actions = rng.uniform(-1, 1, (2, *ours.action_space.shape)).astype(np.float32)
        first, reward, done, infos = ours.step(actions)
        expected, expected_reward, expected_done, expected_infos = theirs.step(actions)
        np.testing.assert_array_equal(reward, expected_reward)
        np.testing.assert_array_equal(done, expected_done)
        for info, other, over in zip(infos, expected_infos, done, strict=True):
            assert info["is_success"] == other["is_success"]
            assert info["TimeLimit.truncated"] == other["TimeLimit.truncated"]
            if over:
                ended += 1
                np.testing.assert_equal(info["terminal_observation"], other["terminal_observation"])
                assert info["reward_terms"] == other["reward_terms"]
                assert info["episode"]["l"] == other["episode"]["l"]
                assert info["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-6)  # Monitor rounds
    assert ended == 4


def test_ppo_learns_on_it_and_reports_returns():
    env = make_sb3(GRIPPER, 8, seed=0, max_episode_steps=16)
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=1, seed=0, device="cpu")
    model.learn(512)
    assert len(model.ep_info_buffer) == 512 // 16
    mean, _ = evaluate_policy(model, env, n_eval_episodes=8, warn=True)
    assert -3 * 16 < mean < 0


def test_her_relabels_through_it():
    env = make_sb3(PUSH, 2, seed=0, max_episode_steps=10)
    model = SAC("MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, learning_starts=24, batch_size=16,
                gradient_steps=1, train_freq=8, policy_kwargs={"net_arch": [8]}, seed=0, device="cpu")  # fmt: skip
    model.learn(64)
    assert model.num_timesteps == 64
    assert model.replay_buffer.size() > 0


def test_wrappers_of_stable_baselines3_fit_on_it():
    env = VecNormalize(make_sb3(GRIPPER, 3, seed=0))
    assert env.reset().shape == (3, 6)
    observation, *_ = env.step(np.zeros((3, 2)))
    assert np.abs(observation).max() <= env.clip_obs


def test_goals_can_be_set_for_the_next_episodes():
    env = make_sb3(GRIPPER, 2, seed=0)
    env.set_options([{"goal": 0.5}, {"goal": 1.5}])
    env.reset()
    np.testing.assert_array_equal([info["goal"] for info in env.reset_infos], [[0.5, 0.5], [1.5, 1.5]])
    env.reset()
    assert env.reset_infos[0]["goal"][0] == env.reset_infos[1]["goal"][0]
    env.set_options([{"goal": 0.5}, {}])
    with pytest.raises(ValueError, match="every one a 'goal'"):
        env.reset()


def test_what_it_cannot_do_is_said_in_one_line():
    with pytest.raises(ValueError, match="SameStep"):
        SB3VecEnv(gymnasium.make_vec(GRIPPER, num_envs=2).unwrapped)
    env = make_sb3(GRIPPER, 2)
    assert env.get_attr("joints") == [env.envs.core.joints] * 2
    assert not env.has_attr("compute_reward")  # the flat view is no goal environment
    with pytest.raises(AttributeError, match="make_sb3"):
        env.set_attr("goal", 1.0)
    with pytest.raises(AttributeError, match="compute_reward"):
        env.env_method("reset")
