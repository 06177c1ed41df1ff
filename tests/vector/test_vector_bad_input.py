"""What a vector environment does with what it cannot use."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import tiago_mj

IDS = [f"tiago_mj/{name}" for name in tiago_mj.ENVIRONMENTS]
GRIPPER = "tiago_mj/GripperTactile-v0"
MODES = ["NextStep", "SameStep"]


def make(count=4, env_id=GRIPPER, **arguments):
    return gymnasium.make_vec(env_id, num_envs=count, **arguments)


def state(envs):
    return envs.unwrapped.simulations.batch.state.copy()


@pytest.mark.parametrize("count", [0, -1, 2.5, True, "many", None])
def test_a_number_of_environments_that_is_none_is_refused(count):
    with pytest.raises(ValueError, match=r"num_envs is .*give a whole number of environments, 1 or more"):
        make(count)


@pytest.mark.parametrize("env_id", IDS)
def test_more_environments_than_there_is_memory_for_are_refused_before_any_is_made(env_id):
    with pytest.raises(ValueError, match=r"num_envs is 1000000000: they need about .* GB .*give at most \d+$"):
        make(10**9, env_id)


@pytest.mark.parametrize(
    ("argument", "value", "words"),
    [
        ("threads", -1, "threads is -1: give"),
        ("threads", 1.5, "threads is 1.5: give"),
        ("autoreset_mode", "sometimes", "autoreset_mode 'sometimes' is unknown: use .*'NextStep'.*'SameStep'"),
        ("max_episode_steps", 0, "max_episode_steps is 0: give"),
        ("render_mode", "human", "render_mode 'human' shows one environment"),
        ("object", "teapot", "object 'teapot' is unknown"),
    ],
)
def test_an_argument_that_is_unusable_is_one_line(argument, value, words):
    with pytest.raises(ValueError, match=words) as caught:
        make(**{argument: value})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("env_id", IDS)
def test_actions_of_another_shape_or_type_are_refused_and_change_nothing(env_id):
    envs = make(3, env_id)
    envs.reset(seed=0)
    before = state(envs)
    joints = envs.single_action_space.shape[0]
    for bad in (np.zeros(joints), np.zeros((2, joints)), np.zeros((3, joints + 1)), np.zeros((3, joints, 1)), 0.0):
        with pytest.raises(ValueError, match=rf"actions have shape .*: give \(3, {joints}\)"):
            envs.step(bad)
    for bad in (None, "close", [["a"] * joints] * 3, [[0.0], [0.0, 0.0], []]):
        with pytest.raises(ValueError, match="actions are not numeric"):
            envs.step(bad)
    np.testing.assert_array_equal(state(envs), before)


@pytest.mark.parametrize("effects", [None, {"command_lag": {}}])
@pytest.mark.parametrize("control", ["velocity", "position"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_row_that_is_not_finite_is_named_and_the_others_go_on(bad, control, effects):
    envs, undisturbed = (make(3, control=control, effects=effects) for _ in range(2))
    envs.reset(seed=0)
    undisturbed.reset(seed=0)
    actions = np.full((3, 2), -0.7)
    for _ in range(5):
        envs.step(actions)
        undisturbed.step(actions)
    spoilt = actions.copy()
    spoilt[1, 0] = bad
    set_points = envs.simulations.batch.act.copy()
    with pytest.warns(RuntimeWarning, match=r"actions of environments \[1\] are not finite"):
        observation, reward, terminated, truncated, info = envs.step(spoilt)
    expected, expected_reward, *_, good = undisturbed.step(actions)
    np.testing.assert_array_equal(observation[[0, 2]], expected[[0, 2]])
    np.testing.assert_array_equal(reward[[0, 2]], expected_reward[[0, 2]])
    np.testing.assert_array_equal(info["action_refused"], [False, True, False])
    assert "action_refused" not in good
    assert np.isfinite(observation).all()
    assert np.isfinite(reward).all()
    assert not (terminated | truncated).any()
    if effects is None:
        np.testing.assert_allclose(envs.simulations.batch.act[1], set_points[1], atol=1e-15)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "action_refused" not in envs.step(actions)[-1]


@pytest.mark.parametrize("effects", [None, {"coulomb_friction": {}, "command_delay": {}}])
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("fault", ["speed", "nan"])
def test_a_simulation_that_diverges_is_begun_again_counted_and_named(fault, mode, effects, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log of it where it runs
    envs, undisturbed = (make(3, autoreset_mode=mode, effects=effects, episode_statistics=True) for _ in range(2))
    envs.reset(seed=0)
    undisturbed.reset(seed=0)
    actions = np.full((3, 2), -0.7)
    last, *_ = envs.step(actions)
    undisturbed.step(actions)
    envs.simulations.batch.qvel[1] = 1e12 if fault == "speed" else np.nan
    with pytest.warns(RuntimeWarning, match=r"simulations \[1\] have diverged"):
        observation, reward, terminated, truncated, info = envs.step(actions)
    expected, expected_reward, *_ = undisturbed.step(actions)
    np.testing.assert_array_equal(observation[[0, 2]], expected[[0, 2]])
    np.testing.assert_array_equal(reward[[0, 2]], expected_reward[[0, 2]])
    np.testing.assert_array_equal(truncated, [False, True, False])
    np.testing.assert_array_equal(info["diverged"], [0, 1, 0])
    np.testing.assert_array_equal(info["_episode"], [False, True, False])
    assert not terminated.any()
    final = info["final_obs"][1] if mode == "SameStep" else observation[1]
    np.testing.assert_array_equal(final, last[1])  # the last good one
    assert np.isfinite(reward).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(20):
            observation, reward, *_, info = envs.step(actions)
            expected, expected_reward, *_ = undisturbed.step(actions)
            assert np.isfinite(observation).all()
            np.testing.assert_array_equal(observation[[0, 2]], expected[[0, 2]])
            np.testing.assert_array_equal(reward[[0, 2]], expected_reward[[0, 2]])
    np.testing.assert_array_equal(info["diverged"], [0, 1, 0])
    assert observation[1, 0] < 0.045  # it moves again


def test_stepping_before_a_reset_or_after_an_end_is_refused():
    envs = make(2, max_episode_steps=2, autoreset_mode="Disabled")
    with pytest.raises(ResetNeeded, match="reset"):
        envs.step(np.zeros((2, 2)))
    envs.reset(seed=0)
    envs.step(np.zeros((2, 2)))
    envs.reset(options={"reset_mask": np.array([True, False])})
    envs.step(np.zeros((2, 2)))
    with pytest.raises(ResetNeeded, match=r"environments \[1\] have ended"):
        envs.step(np.zeros((2, 2)))
    envs.reset(options={"reset_mask": np.array([False, True])})
    envs.step(np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"seed": -1}, "seed -1 is not usable"),
        ({"seed": "luck"}, "seed is 'luck': give"),
        ({"seed": [1, 2]}, "2 seeds for 4 environments"),
        ({"seed": [1, 2, 3, 0.5]}, "seed 0.5 is not usable"),
        ({"options": {"gaol": 1}}, "reset option 'gaol' is unknown"),
        ({"options": {"goal": 99.0}}, "goal 99 is out of range"),
        ({"options": {"goal": np.ones((4, 3))}}, "goal has shape .4, 3.: give"),
        ({"options": {"goal": "high"}}, "goal 'high' is not usable"),
        ({"options": {"reset_mask": np.zeros(4, bool)}}, "at least one True"),
        ({"options": {"reset_mask": [True]}}, "boolean array of shape"),
        ({"options": {"reset_mask": np.ones(4)}}, "boolean array of shape"),
    ],
)
def test_a_reset_that_is_unusable_is_refused_and_changes_nothing(arguments, words):
    envs = make()
    envs.reset(seed=0)
    envs.step(np.full((4, 2), -1.0))
    before = state(envs)
    with pytest.raises(ValueError, match=words):
        envs.reset(**arguments)
    np.testing.assert_array_equal(state(envs), before)


def test_goals_are_one_for_all_or_one_each():
    envs = make(3)
    _, info = envs.reset(seed=0, options={"goal": 0.5})
    np.testing.assert_array_equal(info["goal"], np.full((3, 2), 0.5))
    each = np.array([[0.5, 0.6], [0.7, 0.8], [0.9, 1.0]])
    _, info = envs.reset(options={"goal": each, "reset_mask": np.array([True, False, True])})
    np.testing.assert_array_equal(envs.simulations.goal, [each[0], [0.5, 0.5], each[2]])
