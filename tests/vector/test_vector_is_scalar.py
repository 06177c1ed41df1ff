"""Environment i of a vector environment is the scalar environment with its seed and actions, to the last bit."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import tiago_mj
from tiago_mj.effects import EFFECTS
from tiago_mj.sensing.load_cell import LoadCell

IDS = [f"tiago_mj/{name}" for name in tiago_mj.ENVIRONMENTS]
GRIPPER, PICK = "tiago_mj/GripperTactile-v0", "tiago_mj/PickAndPlace-v0"
MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]
COUNT = 3

DRAWN = {
    "object": ["cylinder", "box_soft"],
    "object_mass": (0.1, 1.0),
    "object_width": (0.03, 0.05),
    "goal": (0.5, 1.5),
}
#: What a user can change, one after the other.
ARGUMENTS = {
    "objects drawn": {**DRAWN, "object_stiffness": (5000.0, 20000.0), "object_offset": (-0.005, 0.005)},
    "position control": {"control": "position"},
    "ideal servo": {"servo": "ideal"},
    "ideal servo, position control": {"servo": "ideal", "control": "position"},
    "moving average": {"sensing": LoadCell(average=12)},
    "force through the cells": {"force_source": "force", "force_type": "binary"},
    "effects on the model": {"effects": {"payload": {}, "viscous_friction": {}, "object_mass": {}}, **DRAWN},
    "effects in every physics step": {"effects": {"coulomb_friction": {}, "force_limit": {}, "motor_cogging": {}}},
    "effects that remember": {"effects": {"command_delay": {}, "backlash": {}, "force_lag": {}, "clock_skew": {}}},
    "effects that draw": {"effects": {"dropped_commands": {}, "force_dropout": {}}},
    "every effect": {"effects": {name: {} for name in EFFECTS}, **DRAWN, "object_stiffness": (5000.0, 20000.0)},
}


def pair(env_id, mode, **arguments):
    """The vector environment, and gymnasium's own of scalar ones."""
    ours = gymnasium.make_vec(env_id, num_envs=COUNT, autoreset_mode=mode, threads=2, **arguments)
    theirs = gymnasium.make_vec(
        env_id,
        num_envs=COUNT,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **arguments,
    )
    return ours, theirs


def assert_same(ours, theirs, where):
    """Every entry of theirs is in ours, the same to the last bit."""
    if isinstance(theirs, dict):
        for key, value in theirs.items():
            assert key in ours, f"{where}: {key}"
            assert_same(ours[key], value, f"{where}.{key}")
    elif isinstance(theirs, np.ndarray) and theirs.dtype == object:
        for k, value in enumerate(theirs):
            assert (ours[k] is None) == (value is None), where
            if value is not None:
                assert_same(ours[k], value, f"{where}[{k}]")
    else:
        np.testing.assert_array_equal(ours, theirs, err_msg=where)
        assert np.asarray(ours).dtype == np.asarray(theirs).dtype, where


def closing(rng, envs):
    """Random actions, the fingers closing: there is contact."""
    actions = rng.uniform(-1, 1, envs.action_space.shape)
    actions[:, -2:] = -rng.uniform(0.2, 1, (envs.num_envs, 2))
    return actions.astype(np.float32)


def play(ours, theirs, steps, rng, where=""):
    for step in range(steps):
        actions = closing(rng, ours)
        for name, a, b in zip(["observation", "reward", "terminated", "truncated", "info"], ours.step(actions),
                              theirs.step(actions), strict=True):  # fmt: skip
            assert_same(a, b, f"{where} step {step} {name}")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("env_id", IDS)
def test_every_environment_is_bit_identical_to_scalar_ones_through_resets(env_id, mode):
    ours, theirs = pair(env_id, mode, max_episode_steps=7)
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    for name, a, b in zip(("observation", "info"), ours.reset(seed=3), theirs.reset(seed=3), strict=True):
        assert_same(a, b, f"reset {name}")
    play(ours, theirs, 24, np.random.default_rng(0))
    ours.close()
    theirs.close()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("which", ARGUMENTS)
def test_every_kind_of_argument_is_bit_identical_too(which, mode):
    ours, theirs = pair(GRIPPER, mode, max_episode_steps=90, **ARGUMENTS[which])
    assert_same(ours.reset(seed=1)[1], theirs.reset(seed=1)[1], "reset")
    play(ours, theirs, 130, np.random.default_rng(0))
    assert (ours.simulations.state.force_contact.max(axis=0) >= 0).all()


def test_a_whole_grasp_of_tiago_is_bit_identical():
    ours, theirs = pair("tiago_mj/TIAGoTactile-v0", AutoresetMode.NEXT_STEP)
    ours.reset(seed=0)
    theirs.reset(seed=0)
    felt = 0.0
    for step in range(300):
        actions = np.zeros(ours.action_space.shape, dtype=np.float32)
        actions[:, -2:] = -1.0 if step < 150 else 0.0
        (a, *_, info), (b, *_) = ours.step(actions), theirs.step(actions)
        np.testing.assert_array_equal(a, b)
        felt = max(felt, float(info["force_contact"].min()))
    assert felt > 5  # every finger of every simulation presses [N]


@pytest.mark.parametrize("which", ["objects drawn", "moving average", "every effect"])
def test_episodes_that_begin_at_different_times_do_not_disturb_each_other(which):
    arguments = {**ARGUMENTS[which], "max_episode_steps": 60}
    ours, theirs = pair(GRIPPER, AutoresetMode.SAME_STEP, **arguments)
    ours.reset(seed=5)
    theirs.reset(seed=5)
    rng = np.random.default_rng(1)
    for rows in ([1], [0, 2], [1, 2], [0, 1, 2], [2]):
        play(ours, theirs, 25, rng, f"before the reset of {rows}:")
        mask = np.isin(np.arange(COUNT), rows)
        for name, a, b in zip(
            ("observation", "info"),
            ours.reset(options={"reset_mask": mask.copy()}),
            theirs.reset(options={"reset_mask": mask.copy()}),
            strict=True,
        ):
            assert_same(a, b, f"reset of {rows}: {name}")
    play(ours, theirs, 70, rng, "at the end:")


@pytest.mark.parametrize("effects", [None, {"coulomb_friction": {}, "dropped_commands": {}}])
def test_an_environment_depends_on_nothing_but_its_own_seed_and_actions(effects):
    """The same environment alone, among others, and on another number of threads."""
    rng = np.random.default_rng(2)
    actions = closing(rng, gymnasium.make_vec(GRIPPER, num_envs=40))
    rows = []
    for count, threads, own in ((1, 1, 0), (5, 2, 3), (40, 3, 31)):
        envs = gymnasium.make_vec(GRIPPER, num_envs=count, threads=threads, effects=effects, **DRAWN)
        seeds = [900 + k for k in range(count)]
        seeds[own] = 7
        envs.reset(seed=seeds)
        seen = []
        for _ in range(40):
            given = actions[:count].copy()
            given[own] = actions[0]
            observation, reward, *_ = envs.step(given)
            seen.append([*observation[own], reward[own]])
        rows.append(seen)
    np.testing.assert_array_equal(rows[0], rows[1])
    np.testing.assert_array_equal(rows[0], rows[2])


def test_statistics_are_those_of_gymnasiums_wrapper():
    envs = gymnasium.make_vec(GRIPPER, num_envs=2, max_episode_steps=5, episode_statistics=True)
    plain = gymnasium.make_vec(GRIPPER, num_envs=2, max_episode_steps=5)
    plain = gymnasium.wrappers.vector.RecordEpisodeStatistics(plain)
    rng = np.random.default_rng(0)
    envs.reset(seed=0)
    plain.reset(seed=0)
    episodes = 0
    for _ in range(20):
        actions = closing(rng, envs)
        info, expected = envs.step(actions)[-1], plain.step(actions)[-1]
        assert ("episode" in info) == ("episode" in expected)
        if "episode" in info:
            episodes += 1
            for key in ("r", "l"):
                np.testing.assert_array_equal(info["episode"][key], expected["episode"][key])
            assert (info["episode"]["t"] > 0).all()
    assert episodes == 3


@pytest.mark.usefixtures("opengl")
def test_rendered_frames_are_the_scalar_environments(tmp_path):
    arguments = {"object_width": (0.03, 0.05), "render_mode": "rgb_array", "width": 80, "height": 60}
    ours, theirs = pair(GRIPPER, AutoresetMode.NEXT_STEP, **arguments)
    ours.reset(seed=0)
    theirs.reset(seed=0)
    frames = ours.render()
    for ours_frame, theirs_frame in zip(frames, theirs.render(), strict=True):
        np.testing.assert_array_equal(ours_frame, theirs_frame)
    assert not np.array_equal(frames[0], frames[1])  # objects of two widths
