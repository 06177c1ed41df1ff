"""A copy in mid-episode, by ``copy.deepcopy`` or ``pickle``, goes on as the original does, to the last bit."""

import copy
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium import error, wrappers

import tiago_mj
from tiago_mj.effects import EFFECTS

IDS = [f"tiago_mj/{name}" for name in tiago_mj.ENVIRONMENTS]
FLAT = "tiago_mj/GripperTactile-v0"
EVERY_EFFECT = {name: {} for name in EFFECTS}
#: Objects, goals and forces that are drawn anew at each reset.
DRAWN = {"object": ["cylinder", "box_soft"], "object_mass": (0.1, 1.0), "goal": (0.5, 1.5)}


def pickled(env):
    return pickle.loads(pickle.dumps(env))


WAYS = pytest.mark.parametrize("copied", [copy.deepcopy, pickled], ids=["deepcopy", "pickle"])


def closing(env, steps, seed=0):
    """Random actions that close the fingers, so that there is contact: (steps, ...)."""
    actions = np.random.default_rng(seed).uniform(-1, 1, (steps, *env.action_space.shape))
    actions[..., -2:] -= 0.5
    return actions


def play(env, actions, reset_after=None):
    """All that an environment answers."""
    answers = []
    for k, action in enumerate(actions):
        answers.append(env.step(action))
        if k == reset_after:
            answers.append(env.reset())
    return answers


def assert_same(one, other, where=""):
    if isinstance(one, dict):
        assert one.keys() == other.keys(), where
        for key in one:
            assert_same(one[key], other[key], f"{where}/{key}")
    elif isinstance(one, (list, tuple)) or (isinstance(one, np.ndarray) and one.dtype.kind == "O"):
        assert len(one) == len(other), where
        for k, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_same(a, b, f"{where}/{k}")
    else:
        np.testing.assert_array_equal(one, other, err_msg=where)


@pytest.mark.parametrize("effects", [None, EVERY_EFFECT], ids=["nominal", "every effect"])
@pytest.mark.parametrize("name", IDS)
def test_a_copy_in_mid_episode_goes_on_as_the_original_does(name, effects):
    env = gymnasium.make(name, effects=effects, max_episode_steps=40)
    env.reset(seed=3)
    actions = closing(env, 45)
    play(env, actions[:20])
    twins = copy.deepcopy(env), pickled(env)
    # Through the end of the episode by the time limit, whose steps so far are kept, and into the next.
    expected = play(env, actions[20:], reset_after=19)
    for twin in twins:
        got = play(twin, actions[20:], reset_after=19)
        assert_same(expected, got)
        assert [answer[3] for answer in got if len(answer) == 5].index(True) == 19


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize(
    ("name", "arguments"),
    [*((name, {}) for name in IDS), (FLAT, {"effects": EVERY_EFFECT, **DRAWN})],
    ids=[*IDS, "every effect"],
)
def test_a_copy_of_many_environments_goes_on_as_they_do(name, arguments, mode):
    envs = gymnasium.make_vec(name, num_envs=3, max_episode_steps=7, autoreset_mode=mode, **arguments)
    envs.reset(seed=3)
    actions = closing(envs, 30)
    play(envs, actions[:10])
    envs.reset(options={"reset_mask": np.array([True, False, False])})  # from now on their episodes end at two times
    play(envs, actions[10:12])
    twins = copy.deepcopy(envs), pickled(envs)
    expected = play(envs, actions[12:], reset_after=9)
    for twin in twins:
        assert_same(expected, play(twin, actions[12:], reset_after=9))


@WAYS
def test_the_copy_and_the_original_share_nothing(copied):
    env = gymnasium.make(FLAT, effects={"command_delay": {}, "force_lag": {}}, **DRAWN)
    env.reset(seed=0)
    actions = closing(env, 30)
    play(env, actions[:10])
    twin, third = copied(env), copied(env)
    play(twin, actions[::-1])
    twin.reset(seed=8)
    assert_same(play(env, actions[10:]), play(third, actions[10:]))


@WAYS
def test_what_a_user_set_is_in_the_copy_too(copied):
    env = gymnasium.make(FLAT)
    env.reset(seed=0)
    core = env.unwrapped
    core.model.opt.gravity[:] = 0.0, 1.0, -3.0
    core.n_substeps, core.goal = 1, 0.5
    core.give_effects({"backlash": {}})
    twin = copied(env)
    inner = twin.unwrapped
    assert inner.data.model is inner.model
    assert inner.model is not core.model
    inner.model.opt.gravity[1] = core.model.opt.gravity[1] = 2.0  # and what is set now acts, on one each
    actions = closing(env, 20)
    assert_same(play(env, actions), play(twin, actions))


@WAYS
def test_wrappers_with_a_state_of_their_own_keep_it(copied):
    env = wrappers.FrameStackObservation(
        wrappers.RecordEpisodeStatistics(gymnasium.make(FLAT, max_episode_steps=12)), 3
    )
    env.reset(seed=0)
    actions = closing(env, 12)
    play(env, actions[:8])
    twin = copied(env)
    expected, got = play(env, actions[8:]), play(twin, actions[8:])
    for answer in (expected[-1], got[-1]):
        assert answer[-1]["episode"].pop("t") >= 0  # seconds on the clock
    assert_same(expected, got)
    assert got[-1][-1]["episode"]["l"] == 12


def test_a_pickle_goes_on_in_another_process():
    env = gymnasium.make(FLAT, effects=EVERY_EFFECT)
    env.reset(seed=1)
    actions = closing(env, 40)
    play(env, actions[:20])
    code = (
        "import pickle, sys\n"
        "env, actions = pickle.load(sys.stdin.buffer)\n"
        "pickle.dump([env.step(action) for action in actions], sys.stdout.buffer)\n"
    )
    given = pickle.dumps((env, actions[20:]))
    done = subprocess.run([sys.executable, "-c", code], input=given, capture_output=True, check=True)
    assert_same(play(env, actions[20:]), pickle.loads(done.stdout))


@WAYS
def test_a_copy_renders_with_a_context_of_its_own(copied, opengl):
    env = gymnasium.make(FLAT, render_mode="rgb_array", width=64, height=48)
    env.reset(seed=0)
    env.render()
    twin = copied(env)
    np.testing.assert_array_equal(twin.render(), env.render())
    play(twin, closing(env, 30))
    assert (twin.render() != env.render()).any()
    env.close()
    twin.close()


@WAYS
def test_a_copy_is_as_far_as_the_original(copied):
    fresh = gymnasium.make(FLAT).unwrapped
    with pytest.raises(error.ResetNeeded):
        copied(fresh).step(np.zeros(2))
    fresh.reset(seed=0)
    fresh.close()
    with pytest.raises(error.ClosedEnvironmentError):
        copied(fresh).reset()
