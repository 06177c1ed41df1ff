"""Reach, push and pick-and-place on TIAGo. What holds for every environment of the table is in test_every_env.py."""

import gymnasium
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tiago_mj
from tiago_mj.control.scripted import ResolvedRates, Scripted
from tiago_mj.envs.pick_and_place import PickAndPlace
from tiago_mj.envs.position_goal import NOT_THERE_YET, OBJECT_REGION, TABLE_REGION, roll_pitch_yaw
from tiago_mj.envs.push import Push
from tiago_mj.envs.reach import GOAL_REGION, Reach
from tiago_mj.models import names, scene
from tiago_mj.models.objects import GraspObject

IDS = [f"TIAGo{task}{touch}-v0" for task in ("Reach", "Push", "PickAndPlace") for touch in ("", "Tactile")]
TASKS = [Reach, Push, PickAndPlace]
WITH_OBJECT = [Push, PickAndPlace]


@pytest.fixture(params=TASKS, ids=lambda task: task.__name__)
def core(request):
    env = request.param()
    yield env
    env.close()


@pytest.mark.parametrize("name", IDS)
def test_tactile_ids_have_the_ta11_hand_and_observe_its_two_readings_and_the_others_do_not(name):
    env, plain = (gymnasium.make(f"tiago_mj/{one}").unwrapped for one in (name, name.replace("Tactile", "")))
    tactile = "Tactile" in name
    size = plain.observation_space["observation"].shape[0]
    assert env.observation_space["observation"].shape == (size + 2 * tactile,)
    load_cell = mujoco.mj_name2id(env.model, mujoco.mjtObj.mjOBJ_BODY, names.LOAD_CELL_BODY["right"])
    assert (load_cell >= 0) == tactile
    observation, info = env.reset(seed=0)
    if tactile:
        np.testing.assert_array_equal(observation["observation"][-2:], info["force_raw"])
    assert env.dt == pytest.approx(0.04)


def test_the_binary_form_observes_touch_or_no_touch():
    env = PickAndPlace(robot="tiago_ta11", force_type="binary")
    expert = Scripted.for_env(env)
    observation, info = env.reset(seed=0)
    seen = [observation["observation"][-2:]]
    for _ in range(60):
        observation, _, _, _, info = env.step(expert(observation, info))
        np.testing.assert_array_equal(observation["observation"][-2:], info["force_binary"])
        seen.append(observation["observation"][-2:])
    assert (seen[0] == 0).all()
    assert (seen[-1] == 1).all()


def test_reach_goals_fill_their_region():
    env = Reach()
    goals = np.array([env.reset(seed=seed)[0]["desired_goal"] for seed in range(200)])
    assert all(goal in GOAL_REGION for goal in goals)
    span = np.subtract(GOAL_REGION.high, GOAL_REGION.low)
    assert (np.ptp(goals, axis=0) > 0.95 * span).all()  # 200 uniform numbers miss an edge by 5 % once in 1e3


@pytest.mark.parametrize("task", WITH_OBJECT)
def test_objects_and_goals_lie_where_the_documentation_says(task):
    env = task()
    heights = []
    for seed in range(150):
        observation, _ = env.reset(seed=seed)
        place, goal = observation["achieved_goal"], observation["desired_goal"]
        assert (OBJECT_REGION[0] <= place[:2]).all()
        assert (place[:2] <= OBJECT_REGION[1]).all()
        assert (TABLE_REGION[0] <= goal[:2]).all()
        assert (goal[:2] <= TABLE_REGION[1]).all()
        assert place[2] == pytest.approx(scene.TABLE_TOP + 0.025, abs=1e-12)
        assert np.linalg.norm(goal - place) >= NOT_THERE_YET
        assert goal in env.workspace
        heights.append(goal[2] - place[2])
    raised = np.array(heights) > 1e-9
    if task is Push:
        assert not raised.any()
    else:
        assert 0.35 < raised.mean() < 0.7  # half of them; 150 draws are within 0.12 of it, few on the table are redrawn
        assert 0.15 < max(heights) <= PickAndPlace.LIFT


@pytest.mark.parametrize("robot", ["tiago_pal_gripper", "tiago_ta11"])
@pytest.mark.parametrize("task", TASKS)
def test_the_robot_starts_clear_of_everything_and_things_at_rest_stay_where_they_are(task, robot):
    env = task(robot=robot)
    for seed in range(5):
        first, _ = env.reset(seed=seed)
        for geoms in env.data.contact.geom[: env.data.ncon]:
            touching = {env.model.geom(geom).name for geom in geoms}
            assert touching in ({"object", "table"}, set(names.PAD_GEOM.values()))  # closed fingers may touch
        for _ in range(25):
            last = env.step(np.zeros(10))[0]
        np.testing.assert_allclose(last["achieved_goal"], first["achieved_goal"], atol=5e-4)  # what contacts sink in


@pytest.mark.parametrize("task", [Reach, Push])
@pytest.mark.parametrize("control", ["velocity", "position"])
@pytest.mark.parametrize("effects", [None, {"encoder_bias": {"offset": 1e-4}}])
def test_fingers_that_do_not_take_part_stay_closed_whatever_the_action(task, control, effects):
    env = task(control=control, effects=effects)
    env.reset(seed=0)
    hold = np.zeros(10)
    if control == "position":
        low, high = (env.model.jnt_range[:10, side] for side in (0, 1))
        hold = 2 * (env.initial_qpos[:10] - low) / (high - low) - 1
    hold[8:] = 1.0
    for _ in range(20):
        env.step(hold)
    assert np.abs(env.state.position[8:]).max() < 5e-4


def test_the_fingers_of_pick_and_place_open_and_close():
    env = PickAndPlace()
    env.reset(seed=0)
    action = np.zeros(10)
    action[8:] = -1.0
    for _ in range(20):
        env.step(action)
    assert env.state.position[8:].max() < 0.002


def test_rewards_are_the_distance_or_success_over_any_batch_axes(core):
    dense = type(core)(reward_type="dense")
    rng = np.random.default_rng(0)
    achieved = rng.uniform(-0.1, 0.1, (4, 5, 3))
    desired = np.zeros((4, 5, 3))
    distance = np.linalg.norm(achieved, axis=-1)
    np.testing.assert_allclose(dense.compute_reward(achieved, desired, {}), -distance, atol=1e-15)
    np.testing.assert_array_equal(core.compute_reward(achieved, desired, {}), np.where(distance < 0.05, 0.0, -1.0))
    for env in (core, dense):
        env.reset(seed=0)
        for _ in range(3):
            observation, reward, _, _, info = env.step(env.action_space.sample())
            assert env.compute_reward(observation["achieved_goal"], observation["desired_goal"], info) == reward
    distance = np.linalg.norm(observation["achieved_goal"] - observation["desired_goal"])
    assert reward == pytest.approx(-distance, rel=1e-12)


def test_a_wider_threshold_makes_success_of_the_same_distance():
    near, far = Reach(), Reach(distance_threshold=0.2)
    a, b = np.zeros(3), np.array([0.1, 0.0, 0.0])
    assert near.compute_reward(a, b, {}) == -1.0
    assert far.compute_reward(a, b, {}) == 0.0


@pytest.mark.parametrize("task", WITH_OBJECT)
def test_the_observation_holds_joints_hand_and_object_in_the_documented_order(task):
    env = task()
    env.reset(seed=3)
    rng = np.random.default_rng(3)
    turn = Rotation.from_euler("xyz", [0.3, -0.4, 1.2])
    body = env.data.joint(names.OBJECT_JOINT)
    body.qpos[2] += 0.1  # in free fall, turning
    body.qpos[3:] = turn.as_quat(scalar_first=True)
    body.qvel[:] = 0.1, 0.2, 0.3, 1.0, 2.0, 3.0
    for _ in range(2):
        observation = env.step(rng.uniform(-0.5, 0.5, 10))[0]["observation"]
    model, data = env.model, env.data
    joints = [model.joint(name) for name in names.TIAGO_JOINTS]
    np.testing.assert_array_equal(observation[:10], [data.qpos[joint.qposadr[0]] for joint in joints])
    np.testing.assert_array_equal(observation[10:20], [data.qvel[joint.dofadr[0]] for joint in joints])
    # The grasp point is a sensor's, one physics step (2 ms) old.
    mujoco.mj_kinematics(model, data)
    hand = data.site(names.GRASP_SITE).xpos
    np.testing.assert_allclose(observation[20:23], hand, atol=2 * 2e-3)
    np.testing.assert_array_equal(observation[23:26], data.body(names.OBJECT_BODY).xpos)
    np.testing.assert_array_equal(observation[26:29], observation[23:26] - observation[20:23])
    measured = Rotation.from_quat(data.body(names.OBJECT_BODY).xquat, scalar_first=True).as_euler("xyz")
    np.testing.assert_allclose(observation[29:32], measured, atol=1e-9)
    np.testing.assert_array_equal(observation[32:38], body.qvel)


def test_roll_pitch_and_yaw_agree_with_scipy_over_a_batch():
    turns = Rotation.random(200, rng=0)
    got = roll_pitch_yaw(turns.as_quat(scalar_first=True).reshape(10, 20, 4))
    np.testing.assert_allclose(got.reshape(200, 3), turns.as_euler("xyz"), atol=1e-7)


def test_a_goal_that_is_given_is_the_goal_of_that_episode_only(core):
    wanted = (np.add(core.workspace.low, core.workspace.high) / 2).tolist()
    assert core.reset(seed=0, options={"goal": wanted})[0]["desired_goal"] == pytest.approx(wanted)
    assert core.reset()[0]["desired_goal"] != pytest.approx(wanted)


@pytest.mark.parametrize("goal", [(0.7, 0.0, 0.3), (1.5, 0.0, 0.7), (0.7, 0.8, 0.7), 0.7, (0.7, 0.0), "up", np.nan])
def test_a_goal_out_of_reach_is_refused_and_changes_nothing(core, goal):
    core.reset(seed=0)
    before, old = core.data.qpos.copy(), core.goal.copy()
    core.step(np.ones(10))
    after = core.data.qpos.copy()
    with pytest.raises(ValueError, match=r"goal .*(workspace|usable|finite)"):
        core.reset(options={"goal": goal})
    np.testing.assert_array_equal(core.data.qpos, after)
    np.testing.assert_array_equal(core.goal, old)
    assert (before != after).any()


def test_a_goal_in_the_air_is_for_pick_and_place_only():
    goal = {"goal": (0.65, 0.0, 0.7)}
    PickAndPlace().reset(options=goal)
    with pytest.raises(ValueError, match="workspace"):
        Push().reset(options=goal)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"robot": "gripper_ta11"}, "robot 'gripper_ta11'.*tiago_ta11"),
        ({"force_type": "loud"}, "force_type 'loud'.*raw"),
        ({"reward_type": "normalised"}, "reward_type 'normalised'.*sparse"),
        ({"distance_threshold": 0.0}, "distance_threshold is 0.0"),
        ({"distance_threshold": np.nan}, "distance_threshold is nan"),
        ({"control_hz": 0}, "control_hz is 0"),
        ({"control": "torque"}, "control 'torque'"),
        ({"force_source": "skin", "force_type": "raw"}, "force source 'skin'"),
    ],
)
@pytest.mark.parametrize("task", TASKS)
def test_a_bad_argument_is_one_clear_line(task, arguments, words):
    with pytest.raises(ValueError, match=words) as caught:
        task(**arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"object": "teapot"}, "object 'teapot' is unknown"),
        ({"object": []}, "empty list"),
        ({"object_mass": -1.0}, "object mass is -1.0"),
        ({"object_width": 0.095}, "does not fit"),
        ({"object": GraspObject(height=0.2)}, "0.2 m high"),
    ],
)
@pytest.mark.parametrize("task", WITH_OBJECT)
def test_a_bad_object_is_one_clear_line(task, arguments, words):
    with pytest.raises(ValueError, match=words) as caught:
        task(**arguments)
    assert "\n" not in str(caught.value)


def test_objects_of_other_sizes_and_shapes_stand_on_the_table_and_are_carried():
    env = PickAndPlace(object=["cylinder", "box"], object_width=(0.03, 0.06), object_mass=(0.2, 0.4))
    expert = Scripted.for_env(env)
    kinds = set()
    for seed in range(6):
        observation, info = env.reset(seed=seed)
        expert.reset()
        kinds.add(int(env.model.geom_type[env.model.geom(names.OBJECT_GEOM).id]))
        assert observation["achieved_goal"][2] == pytest.approx(scene.TABLE_TOP + 0.05, abs=1e-12)
        for _ in range(100):
            observation, _, _, _, info = env.step(expert(observation, info))
        assert info["is_success"], seed
    assert len(kinds) == 2


class ReachFromAbove(Reach):
    START = Push.START


def press_on_the_table(source):
    """A hand that points down, no object: readings before and while the fingertips press on the table."""
    env = ReachFromAbove(robot="tiago_ta11", force_type="raw", force_source=source)
    _, info = env.reset(seed=0)
    readings = [info["force_raw"]]
    for _ in range(20):
        readings.append(env.step(np.zeros(10))[4]["force_raw"])
    rates = ResolvedRates(env)
    contacts = []
    for _ in range(60):
        action = np.zeros(10)
        action[:8] = rates(env.data.qpos[:10], np.array([0.0, 0.0, -0.1]))
        info = env.step(action)[4]
        contacts.append(info["force_contact"])
    np.testing.assert_array_equal(contacts, 0.0)  # there is no object
    return env, np.array(readings), info["force_raw"]


def test_load_cells_without_an_object_read_noise_and_feel_the_table_with_the_touch_source_only():
    env, free, pressed = press_on_the_table("touch")
    noise = env.load_cell.noise
    assert np.abs(free).max() < 5 * noise  # 42 normal numbers
    assert free.std() == pytest.approx(noise, rel=0.4)  # standard error of a deviation from 42: 11 %
    assert (pressed > env.load_cell.units(5.0)).all()  # newtons: the arm leans on both fingertips
    _, _, ignored = press_on_the_table("contact")
    assert np.abs(ignored).max() < 5 * noise


def test_the_reach_task_without_load_cells_has_no_readings():
    _, info = Reach().reset(seed=0)
    assert info["force_raw"].shape == (0,)
    assert "object" not in {Reach().model.body(index).name for index in range(Reach().model.nbody)}


def test_the_goal_is_drawn_where_it_is_and_drawing_does_not_disturb_the_simulation():
    env = Push(render_mode="rgb_array", width=64, height=64)
    twin = Push()
    for one in (env, twin):
        one.reset(seed=0)
    for _ in range(3):
        env.render()
        np.testing.assert_array_equal(env.data.site(scene.GOAL_SITE).xpos, env.goal)
        action = np.full(10, 0.3)
        a, b = env.step(action)[0], twin.step(action)[0]
        np.testing.assert_array_equal(a["observation"], b["observation"])
    env.close()


def test_all_six_are_registered_and_none_of_them_is_flat():
    assert set(IDS) <= set(tiago_mj.ENVIRONMENTS)
    assert all(tiago_mj.ENVIRONMENTS[name].relative is None for name in IDS)


def test_an_arm_that_presses_on_a_load_cell_whose_curve_is_bent_observes_within_its_space():
    bent = {"force_nonlinearity": {"quadratic": 1.0}}
    env = gymnasium.make("tiago_mj/TIAGoPickAndPlaceTactile-v0", effects=bent)
    rng = np.random.default_rng(3)
    given = rng.uniform(-1, 1, (60, 10)).astype(np.float32)[40:]
    given[:, -2:] = -np.abs(given[:, -2:])
    env.reset(seed=2)
    seen = [env.step(action)[0] for action in given]
    assert all(observation in env.observation_space for observation in seen)
    assert max(observation["observation"][-2:].max() for observation in seen) > 500  # 23 of a straight curve
    env.close()
