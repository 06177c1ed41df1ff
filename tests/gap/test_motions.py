"""The menu of motions: its files are what the menu says, and a robot that plays them comes to no harm."""

import functools
import json
import re
import sys
import textwrap
import types
from pathlib import Path

import numpy as np
import pytest

import tiago_mj  # noqa: F401  (registers the environments)
from tiago_mj.cli import main
from tiago_mj.models import names
from tiago_mj.recordings import motions
from tiago_mj.recordings.motions import make
from tiago_mj.recordings.motions.menu import items
from tiago_mj.recordings.record import Plan, read_motion, record
from tiago_mj.recordings.record import make as make_env

ITEMS = {item.name: item for item in items()}
PAGE = Path(__file__).parents[2] / "docs" / "motions.md"
ENVIRONMENTS = {"gripper": "tiago_mj/GripperTactile-v0", "tiago": "tiago_mj/TIAGoTactile-v0"}
#: What the gripper's URDF allows [m/s].
FINGER_SPEED = 0.05
#: Position steps: not longer than those of 40 ms that the real gripper is commanded (learning_fc: 3 mm) [m].
LONGEST_STEP = 0.003
#: Numbers of the files are rounded to so much [m, m/s, rad/s].
ROUNDED = 10.0**-make.DIGITS
#: Distance to the end of a joint's range [m, rad].
MARGIN = 1e-3


def played(item, rate, width=0.04):
    """A recording of a motion, and the environment's joint ranges."""
    motion = read_motion(Path(motions.file_name(item.name, rate)))
    plan = Plan(ENVIRONMENTS[item.robot], {"object_width": width}, None, motion, item.name)
    (trial,) = record(plan, lambda env: None, episodes=1, seed=0)
    return trial


@functools.cache
def joints(robot):
    """Of every actuated joint: where it begins, its range and its velocity limit."""
    motion = read_motion(Path(motions.file_name(next(item.name for item in items() if item.robot == robot), 25)))
    env = make_env(Plan(ENVIRONMENTS[robot], {}, None, motion, "joints"))
    core = env.unwrapped
    out = {}
    for name, fastest in zip(core.joints, core.velocity_limit, strict=True):
        joint = core.model.joint(name)
        out[name] = float(core.initial_qpos[joint.qposadr[0]]), joint.range.copy(), fastest
    env.close()
    return out


def set_points(item, rate):
    """What a motion asks for: set point by actuator from row to row, where it begins, and its range."""
    motion = read_motion(Path(motions.file_name(item.name, rate)))
    for name, sent in motion.commands.items():
        begins, within, fastest = joints(item.robot)[name]
        places = sent if item.interface == "position" else begins + np.cumsum(sent) / rate
        yield name, np.concatenate([[begins], places]), within, fastest


def test_the_files_are_what_the_menu_makes():
    made = make.files()
    assert {path.name for path in motions.FOLDER.glob("*hz.*")} == set(made)
    for name, content in made.items():
        assert (motions.FOLDER / name).read_text(encoding="utf-8") == content, name


@pytest.mark.parametrize("rate", motions.RATES)
def test_no_set_point_is_too_fast_or_near_the_end_of_a_joints_range(rate):
    for item in items():
        for name, places, (low, high), fastest in set_points(item, rate):
            limit = FINGER_SPEED if name in names.FINGERS else fastest
            step = np.abs(np.diff(places)).max()
            if item.name == "position_steps":
                assert step <= LONGEST_STEP, item.name
            else:
                assert step * rate <= limit + 2 * ROUNDED * rate, item.name
            allowed = (min(low + MARGIN, places[0]), max(high - MARGIN, places[0]))
            drift = ROUNDED * 2  # a sum of rounded velocities, each chosen from where the ones before have led
            assert places.min() >= allowed[0] - drift, item.name
            assert places.max() <= allowed[1] + drift, item.name


@pytest.mark.parametrize("item", [item for item in items() if item.robot == "gripper"], ids=lambda item: item.name)
def test_the_servos_stay_below_their_limits_with_objects_of_36_to_44_mm(item):
    # Positions are the velocities' set points: the hardest grasp tells that they are.
    runs = [(25, 0.036), (25, 0.044), (240, 0.044)] if item.interface == "velocity" else [(25, 0.044)]
    for rate, width in runs:
        trial = played(item, rate, width)
        for joint, effort in trial.efforts.items():
            assert np.abs(effort).max() < 0.93 * trial.sidecar.servo["effort_limit"][joint], (rate, width)


@pytest.mark.parametrize("item", [item for item in items() if item.robot == "tiago"], ids=lambda item: item.name)
def test_the_arm_moves_far_below_its_limits_and_follows(item):
    trial = played(item, 25)
    for joint, effort in trial.efforts.items():
        assert np.abs(effort).max() < 0.61 * trial.sidecar.servo["effort_limit"][joint], joint
    for name, places, _, _ in set_points(item, 25):
        # An arm that ran into the table or itself would not arrive.
        assert abs(trial.positions[name][-1] - places[-1]) < 0.01, name


def test_the_arm_touches_nothing_on_the_way():
    for item in items():
        if item.robot != "tiago":
            continue
        motion = read_motion(Path(motions.file_name(item.name, 25)))
        env = make_env(Plan(ENVIRONMENTS["tiago"], {}, None, motion, item.name))
        core = env.unwrapped
        env.reset(seed=0)
        thing = core.model.body("object").id
        sequence = motion.at(25)
        for k in range(motion.steps(25)):
            action = [sequence[name][k] if name in sequence else 0.0 for name in core.joints]
            env.step(np.array(action) / core.velocity_limit)
            touching = core.model.geom_bodyid[core.data.contact.geom]
            assert (touching == thing).any(axis=1).all(), item.name  # the object stands on the table
        env.close()


def test_contact_motions_press_and_free_ones_do_not():
    for name in ("squeeze_light", "taps", "staircase_grip", "position_squeeze_medium"):
        assert max(force.max() for force in played(ITEMS[name], 25).forces.values()) > 0.3, name
    for name in ("rest", "free_sweep", "staircase_free", "chirp_free", "right_only"):
        # Four standard deviations of the load cells' noise.
        assert max(force.max() for force in played(ITEMS[name], 25, width=0.044).forces.values()) < 4 * 0.0077, name


def test_every_motion_ends_at_rest_and_a_25_hz_file_is_the_240_hz_one():
    for item in items():
        slow, fast = (read_motion(Path(motions.file_name(item.name, rate))) for rate in motions.RATES)
        assert abs(slow.time[-1] - fast.time[-1]) <= 1 / 25
        for name in slow.commands:
            ends = [motion.commands[name][-5:] for motion in (slow, fast)]
            still = 0.0 if item.interface == "velocity" else ends[0][-1]
            assert np.abs(np.concatenate(ends) - still).max() <= ROUNDED
        for (_, there, _, _), (_, here, _, _) in zip(set_points(item, 25), set_points(item, 240), strict=True):
            if item.name == "position_steps":
                continue
            at = np.arange(len(there)) / 25
            between = np.interp(at, np.arange(len(here)) / 240, here)
            assert np.abs(there - between).max() < 0.05 * 1.5 / 25, item.name  # a control step at the fastest


def test_positions_are_the_set_points_of_the_velocities():
    for item in ITEMS.values():
        if f"position_{item.name}" not in ITEMS:
            continue
        twin = ITEMS[f"position_{item.name}"]
        for (_, moved, _, _), (_, sent, _, _) in zip(set_points(item, 25), set_points(twin, 25), strict=True):
            np.testing.assert_allclose(moved, sent, atol=2 * ROUNDED)


def test_record_takes_them_by_name_and_says_what_names_there_are(tmp_path, capsys):
    call = ["record", "--env", "GripperTactile-v0", "--out", str(tmp_path / "out"), "--motion"]
    assert main([*call, "touch_release_25hz"]) == 0
    assert main([*call, "rest_25hz.csv"]) == 0
    assert sorted(path.stem for path in (tmp_path / "out").glob("*.parquet")) == [
        "rest_25hz-000",
        "touch_release_25hz-000",
    ]
    facts = json.loads((tmp_path / "out" / "touch_release_25hz-000.json").read_text())
    assert (facts["rate_hz"], facts["interface"]) == (25, "velocity")
    capsys.readouterr()
    assert main([*call, "touch_release"]) == 2
    assert "touch_release_25hz or touch_release_240hz" in capsys.readouterr().err
    assert main([*call, "wave_goodbye"]) == 2
    assert "wave_goodbye" in capsys.readouterr().err


def test_the_page_lists_the_menu():
    text = PAGE.read_text(encoding="utf-8")
    for item in items():
        if item.interface == "velocity" or item.name == "position_steps":
            assert f"| `{item.name}` | {item.seconds:.1f} | {item.purpose} |" in text, item.name


class FakeRos:
    """What the page's player needs of ROS, remembering what was published."""

    def __init__(self, monkeypatch):
        self.sent = {}
        rospy, std_msgs, messages = (types.ModuleType(name) for name in ("rospy", "std_msgs", "std_msgs.msg"))
        rospy.init_node = rospy.sleep = lambda *given: None
        rospy.Rate = lambda hz: types.SimpleNamespace(sleep=lambda: None)
        rospy.Publisher = lambda topic, kind, queue_size: types.SimpleNamespace(
            publish=lambda message: self.sent.setdefault(topic, []).append(message["data"][0])
        )
        messages.Float64MultiArray = dict
        for name, module in (("rospy", rospy), ("std_msgs", std_msgs), ("std_msgs.msg", messages)):
            monkeypatch.setitem(sys.modules, name, module)


@pytest.mark.parametrize("name", ["position_squeeze_medium_25hz", "position_steps_25hz", "position_right_only_25hz"])
def test_the_pages_player_sends_the_real_gripper_the_same_set_points(name, monkeypatch):
    code = re.search(r"<!-- test: player -->\s+```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
    robot = FakeRos(monkeypatch)
    path = motions.find(name)
    monkeypatch.setattr(sys, "argv", ["play.py", str(path)])
    exec(compile(textwrap.dedent(code), "play.py", "exec"), {})  # the page's own code
    item = ITEMS[name.removesuffix("_25hz")]
    for actuator, places, _, _ in set_points(item, 25):
        side = actuator.split("_")[1]
        np.testing.assert_allclose(robot.sent[f"/finger_{side}_controller/command"], places[1:], atol=1e-9)
