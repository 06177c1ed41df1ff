"""What a user may rely on in every environment of the table."""

import copy
import warnings

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_sb3

import tiago_mj

IDS = [f"tiago_mj/{name}" for name in tiago_mj.ENVIRONMENTS]
FULL_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


def core_of(env):
    """The goal environment behind an id: itself, or what its flat view looks at."""
    return getattr(env.unwrapped, "core", env.unwrapped)


def state_of(env):
    core = env.unwrapped
    state = np.empty(mujoco.mj_stateSize(core.model, FULL_STATE))
    mujoco.mj_getState(core.model, core.data, state, FULL_STATE)
    return state


def flat(observation):
    return np.concatenate(list(observation.values())) if isinstance(observation, dict) else observation


@pytest.fixture(params=IDS, scope="module")
def env(request):
    made = gymnasium.make(request.param)
    yield made
    made.close()


def test_gymnasiums_checker_finds_nothing_to_say(env):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=0)


def test_stable_baselines3s_checker_finds_nothing_to_say(env):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_sb3(env.unwrapped, skip_render_check=True)


def test_three_hundred_random_steps_stay_inside_the_spaces(env):
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(300):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert observation in env.observation_space
        assert np.isfinite(reward)
        assert not terminated
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-12)
        if truncated:
            env.reset()


def test_two_copies_with_one_seed_are_bit_identical(env):
    twin = gymnasium.make(env.spec)
    actions = np.random.default_rng(3).uniform(-1, 1, (40, *env.action_space.shape))
    rollouts = []
    for one in (env, twin):
        first, _ = one.reset(seed=7)
        steps = [one.step(action) for action in actions]
        rollouts.append((first, steps, state_of(one)))
    (first_a, steps_a, end_a), (first_b, steps_b, end_b) = rollouts
    np.testing.assert_array_equal(flat(first_a), flat(first_b))
    np.testing.assert_array_equal(end_a, end_b)
    for a, b in zip(steps_a, steps_b, strict=True):
        np.testing.assert_array_equal(flat(a[0]), flat(b[0]))
        assert a[1] == b[1]
    twin.close()


def test_nothing_of_an_episode_reaches_the_next(env):
    """The simulator's whole state at reset, warm start and servo set points included, is that of a fresh copy."""
    fresh = gymnasium.make(env.spec)
    rng = np.random.default_rng(0)
    env.reset(seed=4)
    for _ in range(60):
        env.step(rng.uniform(-1, 1, env.action_space.shape))
    observation, info = env.reset(seed=5)
    expected, expected_info = fresh.reset(seed=5)
    np.testing.assert_array_equal(flat(observation), flat(expected))
    np.testing.assert_array_equal(state_of(env), state_of(fresh))
    for key in ("force_raw", "force_contact", "force_binary"):
        np.testing.assert_array_equal(info[key], expected_info[key])
    fresh.close()


def test_two_environments_in_one_process_do_not_touch_each_other(env):
    other = gymnasium.make(env.spec)
    env.reset(seed=6)
    other.reset(seed=6)
    before = state_of(other)
    for _ in range(10):
        env.step(env.action_space.sample())
    np.testing.assert_array_equal(state_of(other), before)
    other.close()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_action_that_is_not_finite_is_refused_and_changes_nothing(env, bad):
    env.reset(seed=0)
    before = state_of(env)
    action = np.zeros(env.action_space.shape)
    action[0] = bad
    with pytest.raises(ValueError, match="finite"):
        env.unwrapped.step(action)
    np.testing.assert_array_equal(state_of(env), before)


@pytest.mark.parametrize("bad", [np.zeros(1), np.zeros((2, 2)), "close", None, [["a"]]])
def test_an_action_of_another_shape_or_type_is_refused_and_changes_nothing(env, bad):
    env.reset(seed=0)
    before = state_of(env)
    with pytest.raises(ValueError, match="action"):
        env.unwrapped.step(bad)
    np.testing.assert_array_equal(state_of(env), before)


def test_compute_reward_over_a_batch_is_the_reward_of_each(env):
    """What HER relies on."""
    core = core_of(env)
    env.reset(seed=0)
    achieved, desired = [], []
    for _ in range(5):
        _, reward, *_ = env.step(env.action_space.sample())
        achieved.append(core._achieved(core.state))
        desired.append(core.goal.copy())
        assert core.compute_reward(achieved[-1], desired[-1], {}) == pytest.approx(reward, abs=1e-12)
    batch = core.compute_reward(np.array(achieved), np.array(desired), [{}] * 5)
    assert batch.shape == (5,)
    each = [core.compute_reward(a, d, {}) for a, d in zip(achieved, desired, strict=True)]
    np.testing.assert_allclose(batch, each, atol=1e-12)


def test_commanded_speed_and_effort_never_exceed_their_limits(env):
    core = env.unwrapped
    model, data = core.model, core.data
    rng = np.random.default_rng(1)
    env.reset(seed=1)
    for _ in range(100):
        env.step(np.sign(rng.uniform(-1, 1, env.action_space.shape)) * 5)
        assert (np.abs(data.ctrl) <= model.actuator_ctrlrange[:, 1] + 1e-12).all()
        assert (np.abs(data.actuator_force) <= model.actuator_forcerange[:, 1] + 1e-9).all()


def test_the_urdfs_joint_names_and_the_simulator_are_within_reach(env):
    core = env.unwrapped
    assert core.model.nq == core.data.qpos.size
    assert core.n_substeps * core.model.opt.timestep == pytest.approx(1 / core.metadata["render_fps"])
    for name in core.joints:
        assert core.model.joint(name).name == name
        assert core.model.actuator(name).name == name


def test_importing_again_and_copying_a_spec_is_harmless():
    assert copy.deepcopy(gymnasium.spec(IDS[0])).id == IDS[0]


def test_without_visual_geoms_the_same_happens(env):
    bare = gymnasium.make(env.spec, visual=False)
    assert bare.unwrapped.model.ngeom < env.unwrapped.model.ngeom / 2
    rng = np.random.default_rng(5)
    env.reset(seed=3)
    bare.reset(seed=3)
    for _ in range(20):
        action = rng.uniform(-1, 1, env.action_space.shape)
        observation, expected = bare.step(action)[0], env.step(action)[0]
        # The same to the last bit but where the PAL gripper is closed: its pads just touch, so the last bit decides
        # whether there is a contact; velocities [m/s, rad/s] then differ by 0.001.
        np.testing.assert_allclose(flat(observation), flat(expected), atol=2e-3)
    with pytest.raises(ValueError, match="nothing to see"):
        gymnasium.make(env.spec, visual=False, render_mode="rgb_array")
