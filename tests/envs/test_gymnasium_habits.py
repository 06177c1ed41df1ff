"""What people do with any gymnasium environment: its wrappers, attributes of ``unwrapped``, slips."""

import copy
import re
import subprocess
import sys
import warnings
from pathlib import Path
from types import ModuleType

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.error import ClosedEnvironmentError, DependencyNotInstalled, ResetNeeded
from stable_baselines3.common.monitor import Monitor

import tiago_mj
from tiago_mj.models.objects import KEYS, GraspObject

FLAT, GOAL = "tiago_mj/GripperTactile-v0", "tiago_mj/GripperTactileGoal-v0"


def played(env, steps):
    """Steps after a reset; the infos."""
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape)
    return [env.step(still)[-1] for _ in range(steps)]


@pytest.mark.parametrize("make", [Monitor, wrappers.RecordEpisodeStatistics], ids=["Monitor", "gymnasium"])
def test_episode_statistics_are_recorded_around_one_environment(make):
    infos = played(make(gymnasium.make(FLAT, max_episode_steps=4)), 4)
    assert infos[-1]["episode"]["l"] == 4
    assert infos[-1]["episode"]["r"] < 0


def test_episode_statistics_are_recorded_around_many():
    envs = wrappers.vector.RecordEpisodeStatistics(gymnasium.make_vec(FLAT, num_envs=2, max_episode_steps=4))
    infos = played(envs, 4)
    assert all("episode" not in info for info in infos[:-1])
    np.testing.assert_array_equal(infos[-1]["episode"]["l"], [4, 4])
    envs.close()


def test_frames_of_the_flat_observation_are_stacked():
    env = wrappers.FrameStackObservation(gymnasium.make(FLAT), 3)
    assert env.reset(seed=0)[0].shape == (3, 6)
    assert env.step(np.zeros(2))[0].shape == (3, 6)


def test_environments_run_in_processes_of_their_own():
    apart = {"context": "forkserver"}  # a copy of this process lacks the threads that its locks wait for
    envs = gymnasium.make_vec(FLAT, num_envs=2, vectorization_mode="async", max_episode_steps=4, vector_kwargs=apart)
    try:
        ours, _ = envs.reset(seed=3)
        one, _ = gymnasium.make(FLAT).reset(seed=4)
        np.testing.assert_array_equal(ours[1], one)
        assert envs.step(np.zeros((2, 2)))[1].shape == (2,)
    finally:
        envs.close()


def test_a_video_is_recorded(tmp_path, monkeypatch):
    """The frames are ours, the encoder is moviepy's: it need not be installed here."""
    clips = []

    class Clip:
        def __init__(self, frames, fps):
            clips.append((np.array(frames), fps))

        def write_videofile(self, path, **options):
            pass

    sequence = ModuleType("moviepy.video.io.ImageSequenceClip")
    sequence.ImageSequenceClip = Clip
    for name in ("moviepy", "moviepy.video", "moviepy.video.io"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, sequence.__name__, sequence)
    env = gymnasium.make(FLAT, render_mode="rgb_array", max_episode_steps=3, width=64, height=48)
    try:
        env.reset(seed=0)
        env.render()
    except DependencyNotInstalled as fault:
        pytest.skip(str(fault))
    recorder = wrappers.RecordVideo(env, str(tmp_path), episode_trigger=lambda _: True, disable_logger=True)
    played(recorder, 3)
    recorder.close()
    ((frames, fps),) = clips
    assert frames.shape == (4, 48, 64, 3)
    assert fps == 240
    assert frames.std() > 1


def test_what_is_set_on_a_flat_view_reaches_the_environment():
    env = gymnasium.make(FLAT)
    env.reset(seed=0)
    view = env.unwrapped
    view.n_substeps = 5
    assert view.core.n_substeps == 5
    before = view.data.time
    env.step(np.zeros(2))
    assert view.data.time == pytest.approx(before + 5 * view.model.opt.timestep)
    view.goal = 0.5
    np.testing.assert_array_equal(env.step(np.zeros(2))[-1]["goal"], view.core.goal)
    assert set(view.core.goal) == {0.5}
    view.np_random = np.random.default_rng(7)
    assert view.core.np_random is view.np_random
    twin = copy.deepcopy(view)
    twin.n_substeps = 3
    assert (view.n_substeps, twin.core.n_substeps) == (5, 3)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("goal", "high", "goal 'high' is not usable"),
        ("goal", 99.0, "out of range"),
        ("goal", [np.nan, 1.0], "not finite"),
        ("n_substeps", 0, "n_substeps is 0: give a whole number from 1 to 10000"),
        ("n_substeps", 2.5, "give a whole number"),
        ("n_substeps", 10**9, "give a whole number"),
        ("dt", 0.1, "dt"),
        ("control", "position", "control cannot be changed once the environment is made: give it to gymnasium.make"),
        ("servo", "ideal", "servo cannot be changed"),
        ("joints", ("gripper_left_finger_joint",), "joints cannot be changed"),
        ("velocity_limit", 1.0, "velocity_limit cannot be changed"),
        ("force_type", "none", "force_type cannot be changed"),
        ("reward_type", "sparse", "reward_type cannot be changed"),
    ],
)
@pytest.mark.parametrize("env_id", [FLAT, GOAL])
def test_what_cannot_be_set_on_an_environment_is_refused_in_one_line(env_id, name, value, said):
    view = gymnasium.make(env_id).unwrapped
    with pytest.raises((ValueError, AttributeError), match=said) as caught:
        setattr(view, name, value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "make", [gymnasium.make, lambda name: gymnasium.make_vec(name, num_envs=2)], ids=["one", "many"]
)
@pytest.mark.parametrize("options", [3, "goal", [1.0]], ids=str)
def test_reset_options_that_are_no_mapping_are_refused_in_one_line(make, options):
    env = make(FLAT)
    with pytest.raises(ValueError, match=r"reset options .* are no mapping: give a dict with"):
        env.reset(options=options)


@pytest.mark.parametrize("name", [FLAT, GOAL])
def test_an_unwrapped_environment_is_stepped_neither_before_its_reset_nor_after_its_end(name):
    env = gymnasium.make(name).unwrapped
    for name, call in (("step", lambda: env.step(np.zeros(2))), ("render", env.render)):
        with pytest.raises(ResetNeeded, match=re.escape(f"reset() must be called before {name}()")):
            call()
    env.reset(seed=0)
    env.step(np.zeros(2))
    env.close()
    env.close()  # as often as one likes
    for call in (lambda: env.step(np.zeros(2)), env.reset, env.render):
        with pytest.raises(ClosedEnvironmentError, match=r"was closed: make a new one with gymnasium\.make"):
            call()


def test_physics_steps_are_not_changed_under_effects_that_reckon_with_them():
    env = gymnasium.make(FLAT, effects={"backlash": {}}).unwrapped
    with pytest.raises(AttributeError, match="n_substeps cannot be changed while effects act"):
        env.n_substeps = 3
    env.give_effects(None)
    env.n_substeps = 3
    assert env.n_substeps == 3


@pytest.mark.parametrize(
    "action",
    [
        np.full(2, 1e308),
        np.full(2, 1e308, dtype=np.longdouble) * 10,
        np.array([2**64 - 1, 2], dtype=np.uint64),
        [1e308, 1e308],
        np.float32([3e38, 3e38]),
    ],
    ids=repr,
)
def test_a_large_action_is_clipped_without_a_warning(action):
    env, full, envs = gymnasium.make(FLAT).unwrapped, gymnasium.make(FLAT).unwrapped, gymnasium.make_vec(FLAT, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for one in (env, full, envs):
            one.reset(seed=0)
        expected = full.step(np.ones(2))[0]
        np.testing.assert_array_equal(env.step(action)[0], expected)
        np.testing.assert_array_equal(envs.step(np.stack([action, action]))[0][0], expected)


def test_many_environments_are_stepped_no_more_after_their_end():
    envs = gymnasium.make_vec(FLAT, num_envs=2)
    with pytest.raises(ResetNeeded, match=re.escape("reset() must be called before render()")):
        envs.render()
    envs.reset(seed=0)
    envs.close()
    for call in (lambda: envs.step(np.zeros((2, 2))), envs.reset, envs.render):
        with pytest.raises(ClosedEnvironmentError, match="was closed"):
            call()


@pytest.mark.parametrize(
    ("make", "given", "said"),
    [
        (gymnasium.make, {"objekt": "box"}, "HoldForce has no argument 'objekt': did you mean 'object'?"),
        (gymnasium.make, {"rewardtype": "sparse"}, "did you mean 'reward_type'?"),
        (gymnasium.make, {"zzz": 1}, "there are control, control_hz"),
        (gymnasium.make_vec, {"num_envs": 2, "thread": 1}, "did you mean 'threads'?"),
    ],
    ids=lambda one: getattr(one, "__name__", str(one)),
)
def test_a_mistyped_argument_gets_the_nearest_name(make, given, said):
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        make(FLAT, **given)
    assert "\n" not in str(caught.value)


def test_importing_it_and_making_an_environment_prints_nothing():
    code = "import tiago_mj, gymnasium; gymnasium.make('tiago_mj/GripperTactile-v0').reset(seed=0)\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_notices_of_other_packages_are_left_to_them():
    notifications = pytest.importorskip("farama_notifications").notifications
    assert "gymnasium_robotics" in notifications


DIVERGING = """
import gymnasium, numpy as np, tiago_mj
env = gymnasium.make({id!r}, **{options})
env.reset(seed=0)
seen = env.step(env.action_space.sample())[0]
env.unwrapped.data.qvel[:] = 1e12
after, reward, terminated, truncated, info = env.step(env.action_space.sample())
assert truncated and not terminated and np.isfinite(reward)
both = [(seen, after)] if isinstance(seen, np.ndarray) else [(seen[k], after[k]) for k in seen]
assert all(np.array_equal(a, b) for a, b in both)
copied = __import__("copy").deepcopy(env)
for one in (env, copied):
    try:
        one.step(one.action_space.sample())
    except gymnasium.error.ResetNeeded as fault:
        assert "diverged" in str(fault)
    else:
        raise AssertionError("it went on")
    one.reset(seed=0)
    assert not one.step(one.action_space.sample())[3]
"""


@pytest.mark.parametrize("id", [FLAT, GOAL])
@pytest.mark.parametrize("options", [{}, {"effects": {"coulomb_friction": {"force": 1.0}}}], ids=["plain", "effects"])
def test_a_simulation_that_diverges_ends_its_episode_and_writes_no_log(tmp_path, id, options):
    program = [sys.executable, "-c", DIVERGING.format(id=id, options=options)]
    done = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.iterdir()) == []
    assert done.stderr.count("MuJoCo: Nan, Inf or huge value") == 1
    assert "the simulation has diverged: its episode is truncated" in done.stderr


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec], ids=["make", "make_vec"])
@pytest.mark.parametrize(("given", "says"), [
    ({"width": 0.05}, r"width is 0.05: .* pixels from 1 to 16384 \(an object's width is object_width\)"),
    ({"height": "big"}, r"height is 'big': .* whole number of pixels"),
    ({"width": True}, "width is True"),
    ({"visual": "no"}, "visual is 'no': give True or False"),
    ({"load_cells": 1}, "load_cells is 1: give True or False"),
    ({"joints": "arm"}, "joints is 'arm': give a list of names"),
    ({"joints": ["gripper_right_finger_jiont"]}, "does not move: did you mean 'gripper_right_finger_joint'"),
    ({"joints": ["gripper_right_finger_joint"] * 2}, "twice: name each joint once"),
    ({"object_width": "0.04"}, r"object_width is '0.04': give one number or \(low, high\) in m"),
    ({"object_mass": (0.1, "0.2")}, "object_mass is"),
    ({"object_wdith": 0.04}, "no argument 'object_wdith': did you mean 'object_width'"),
    ({"object": {"shape": "box", "width": 0.05}}, "object has no key 'width': did you mean 'width_m'"),
    ({"object": {"radius_m": 0.02, "width_m": 0.04}}, "object has radius_m and width_m: give one of them"),
    ({"object": {"mass_kg": "heavy"}}, "object mass_kg is 'heavy': give a number"),
    ({"object": {"colour": "red"}}, "object has no key 'colour': use shape, radius_m"),
    ({"object": {"shape": "ball"}}, "object shape 'ball' is unknown: use one of cylinder, box"),
    ({"object": "bottle"}, "object 'bottle' is unknown: .*, or describe your own by a dictionary with shape, width_m"),
])  # fmt: skip
def test_a_slip_in_an_argument_is_one_line_that_says_the_mend(make, given, says):
    with pytest.raises(ValueError, match=says) as caught:
        make(FLAT, **given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", tiago_mj.ENVIRONMENTS)
def test_every_environment_refuses_a_keyword_that_it_does_not_know(name):
    with pytest.raises(ValueError, match="no argument 'contol_hz': did you mean 'control_hz'"):
        gymnasium.make(f"tiago_mj/{name}", contol_hz=25)


def test_an_object_of_ones_own_is_what_its_dictionary_says():
    said = {"shape": "box", "width_m": 0.03, "height_m": 0.08, "mass_kg": 0.2, "stiffness": 4000, "damping": 40}
    core = gymnasium.make(GOAL, object=[said]).unwrapped
    core.reset(seed=0)
    assert core.object_choice.first() == GraspObject("box", 0.03, 0.08, 0.2, 4000, 40)
    np.testing.assert_allclose(core.model.body("object").mass, 0.2)
    round_one = gymnasium.make(GOAL, object={"radius_m": 0.018}).unwrapped
    np.testing.assert_allclose(round_one.model.geom("object").size[0], 0.018)


def test_the_examples_of_an_own_object_in_the_documents_run():
    page = (Path(__file__).parents[2] / "docs" / "tasks.md").read_text("utf-8")
    block = re.search(r"## An object of your own\n.*?```python\n(.*?)```", page, re.DOTALL)[1]
    made = {}
    exec(block, made)
    assert made["env"].unwrapped.object_choice.first().width == 0.06
    section = page.split("## An object of your own")[1].split("\n## ")[0]
    named = [key for row in re.findall(r"^\| (`[^|]+) \|", section, re.M) for key in re.findall(r"`(\w+)`", row)]
    assert sorted(named) == sorted(KEYS)


def test_the_example_of_a_recorded_film_in_the_documents_runs(tmp_path, monkeypatch):
    pytest.importorskip("moviepy")
    page = (Path(__file__).parents[2] / "docs" / "tasks.md").read_text("utf-8")
    block = re.search(r"## Films by.*?```python\n(.*?)```", page, re.DOTALL)[1]
    monkeypatch.chdir(tmp_path)
    try:
        exec(block, {})
    except DependencyNotInstalled as fault:
        pytest.skip(str(fault))
    assert (tmp_path / "films" / "rl-video-episode-0.mp4").stat().st_size > 1000
