"""Bags of robots that ros2_control drives, read without a map file: every test writes its own small bag."""

import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tiago_mj.cli import main
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError

JOINTS = ("shoulder", "elbow")
START = 1_700_000_000_000_000_000
RATE, SECONDS = 100, 3.0
JOINT_STATE, NUMBERS = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray"
TRAJECTORY, STATE = "trajectory_msgs/msg/JointTrajectory", "control_msgs/msg/JointTrajectoryControllerState"
MODEL = {"robot": "arm.xml"}


def swing(t):
    return np.array([0.5 * np.sin(2 * t), 0.8 * (1 - np.cos(3 * t))])


class Bag:
    """A bag that is being written: states follow ``swing`` 20 ms late."""

    def __init__(self, path, states=True):
        self.path = path
        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self.messages = []
        if states:
            for k in range(int(RATE * SECONDS)):
                self.state(k / RATE, swing(max(k / RATE - 0.02, 0.0)))

    def header(self, t):
        stamp = START + round(t * 1e9)
        time = self.store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return self.store.types["std_msgs/msg/Header"](stamp=time, frame_id="")

    def add(self, topic, t, kind, **fields):
        self.messages.append((topic, START + round(t * 1e9), kind, self.store.types[kind](**fields)))

    def state(self, t, position, topic="/joint_states", names=JOINTS):
        none = np.zeros(0)
        fields = {"header": self.header(t), "position": np.array(position), "velocity": none, "effort": none}
        self.add(topic, t, JOINT_STATE, name=list(names), **fields)

    def numbers(self, topic, t, values):
        layout = self.store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        self.add(topic, t, NUMBERS, layout=layout, data=np.array(values, dtype=np.float64))

    def point(self, after, positions, velocities=()):
        types = self.store.types
        when = types["builtin_interfaces/msg/Duration"](sec=int(after), nanosec=round(after % 1 * 1e9))
        parts = {"positions": np.array(positions, dtype=float), "velocities": np.array(velocities, dtype=float)}
        none = {"accelerations": np.zeros(0), "effort": np.zeros(0)}
        return types["trajectory_msgs/msg/JointTrajectoryPoint"](**parts, **none, time_from_start=when)

    def trajectory(self, t, points, names=JOINTS, topic="/arm_controller/joint_trajectory"):
        zero = self.store.types["std_msgs/msg/Header"](
            stamp=self.store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id=""
        )
        self.add(topic, t, TRAJECTORY, header=zero, joint_names=list(names), points=points)

    def with_controller_states(self):
        """Messages of a type that the bag itself describes."""
        text = "std_msgs/Header header\nstring[] joint_names\n" + "\n".join(
            f"trajectory_msgs/JointTrajectoryPoint {part}" for part in ("feedback", "reference", "error", "output")
        )
        self.store.register(get_types_from_msg(text, STATE))
        for k in range(int(50 * SECONDS)):
            t = k / 50 + 0.001
            points = {part: self.point(0, swing(t)) for part in ("feedback", "reference", "error", "output")}
            self.add("/arm_controller/state", t, STATE, header=self.header(t), joint_names=list(JOINTS), **points)

    def write(self):
        with Writer(self.path, version=9) as writer:
            connections = {}
            for topic, stamp, kind, message in sorted(self.messages, key=lambda one: one[1]):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=self.store)
                writer.write(connections[topic], stamp, self.store.serialize_cdr(message, kind))
        return self.path


def read(bag, **defaults):
    result = read_recordings([bag.write()], defaults={**MODEL, **defaults})
    (told,) = [f.message for f in result.findings if f.code == "missing_column"]
    return result.trials[0], told


def sent(trial, joint):
    there = ~np.isnan(trial.commands[joint])
    return trial.time[there], trial.commands[joint][there]


def test_forward_commands_are_given_to_the_joints_that_follow_them(tmp_path):
    bag = Bag(tmp_path / "bag")
    for k in range(int(50 * SECONDS)):
        bag.numbers("/forward_position_controller/commands", k / 50, swing(k / 50)[::-1])  # the elbow comes first
    trial, told = read(bag)
    assert trial.sidecar.interface == "position"
    assert trial.sidecar.robot == "arm.xml"
    assert trial.sidecar.rate_hz == pytest.approx(50)
    time, values = sent(trial, "elbow")
    np.testing.assert_allclose(values, swing(time)[1], atol=1e-6)
    assert set(trial.positions) == set(JOINTS)
    assert "/joint_states for the joints' states" in told
    assert "/forward_position_controller/commands for position commands of elbow, shoulder" in told


def test_joints_that_rest_at_the_same_place_are_told_the_same(tmp_path):
    bag = Bag(tmp_path / "bag", states=False)
    names = ("wrist_1", "shoulder", "wrist_2", "tool")
    for k in range(int(RATE * SECONDS)):
        t = k / RATE
        still = 1e-4 * np.sin(k)
        bag.state(t, (still, swing(max(t - 0.02, 0.0))[0], -still, 1.3 + still), names=names)
        bag.numbers("/x/commands", t, (swing(t)[0], 1.3, 0.0, 0.0))
    trial, _ = read(bag)
    np.testing.assert_allclose(sent(trial, "tool")[1], 1.3)
    assert np.ptp(sent(trial, "shoulder")[1]) > 0.5
    np.testing.assert_array_equal(sent(trial, "wrist_1")[1], 0.0)
    np.testing.assert_array_equal(sent(trial, "wrist_2")[1], 0.0)


def test_numbers_that_no_joint_clearly_follows_are_refused_and_a_map_settles_it(tmp_path):
    bag = Bag(tmp_path / "bag", states=False)
    for k in range(int(RATE * SECONDS)):
        bag.state(k / RATE, np.repeat(np.sin(2 * k / RATE), 2))  # both joints do the same
        bag.numbers("/x/commands", k / RATE, np.sin(2 * k / RATE) + np.array([0.0, 1e-3]))
    bag.write()
    with pytest.raises(RecordingError, match=r"/x/commands.*--map") as refused:
        read_recordings([bag.path], defaults=MODEL)
    assert "\n" not in str(refused.value)
    map_file = tmp_path / "map.yaml"
    map_file.write_text(
        "interface: position\ntopics:\n  /joint_states: {kind: joint_state}\n"
        "  /x/commands: {kind: command, names: [shoulder, elbow]}\n"
    )
    (trial,) = read_recordings([bag.path], map_file=map_file, defaults=MODEL).trials
    assert set(trial.commands) == set(JOINTS)


def test_a_trajectory_controllers_reference_counts_more_than_its_trajectories(tmp_path):
    bag = Bag(tmp_path / "bag")
    bag.with_controller_states()
    bag.trajectory(0.1, [bag.point(1.0, (9.0, 9.0))])
    trial, told = read(bag)
    time, values = sent(trial, "shoulder")
    np.testing.assert_allclose(values, swing(time)[0], atol=1e-6)
    assert "/arm_controller/state for position commands of shoulder, elbow" in told
    assert "/arm_controller/joint_trajectory" not in told


def test_between_the_points_of_a_trajectory_the_controller_interpolates(tmp_path):
    bag = Bag(tmp_path / "bag", states=False)
    for k in range(int(RATE * SECONDS)):
        bag.state(k / RATE, (0.1, 0.2))
    bag.trajectory(0.5, [bag.point(1.0, (1.1, 0.2)), bag.point(1.5, (0.1, 0.2))])
    bag.trajectory(1.0, [bag.point(0.5, (2.0,))], names=("shoulder",))  # takes over half way
    trial, _ = read(bag)
    time, shoulder = sent(trial, "shoulder")
    assert time[0] == pytest.approx(0.5)  # nothing was commanded before
    np.testing.assert_allclose(np.interp([0.5, 0.75, 1.0], time, shoulder), [0.1, 0.35, 0.6], atol=1e-9)
    np.testing.assert_allclose(np.interp([1.25, 1.5, 2.9], time, shoulder), [1.3, 2.0, 2.0], atol=1e-9)
    np.testing.assert_allclose(sent(trial, "elbow")[1], 0.2)


def test_points_with_velocities_are_joined_smoothly(tmp_path):
    bag = Bag(tmp_path / "bag")
    knots = np.linspace(0.25, 2.5, 10)
    rate = [np.array([np.cos(2 * t), 2.4 * np.sin(3 * t)]) for t in knots]
    bag.trajectory(0.0, [bag.point(t, swing(t), v) for t, v in zip(knots, rate, strict=True)])
    trial, _ = read(bag)
    time, elbow = sent(trial, "elbow")
    inside = (time > 0.25) & (time < 2.5)
    np.testing.assert_allclose(elbow[inside], swing(time[inside])[1], atol=1e-3)  # straight lines are 0.06 off


def broken(how, bag):
    if how == "no states":
        bag.messages = [m for m in bag.messages if m[0] != "/joint_states"]
    elif how == "two states":
        bag.messages = [
            ("/left/joint_states" if k % 2 else "/right/joint_states", *m[1:]) for k, m in enumerate(bag.messages)
        ]
    if how in ("no states", "two states", "two kinds"):
        for k in range(150):
            bag.numbers("/position_controller/commands", k / 50, swing(k / 50))
    if how == "two kinds":
        bag.state(1.0, (0.0,), names=("wheel",))
        for k in range(150):
            bag.trajectory(k / 50, [bag.point(0.1, (0.0,))], names=("wheel",))
            bag.numbers("/wheel_velocity_controller/commands", k / 50, (0.1,))
    elif how == "too many numbers":
        bag.numbers("/position_controller/commands", 0.1, (1.0, 2.0, 3.0))
    elif how == "points":
        bag.trajectory(0.1, [bag.point(1.0, (1.1, 0.2)), bag.point(0.5, (0.1, 0.2))])


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("no states", "the bag has none"),
        ("two states", "the bag has /left/joint_states, /right/joint_states"),
        ("two kinds", "0 joints have a velocity"),
        ("too many numbers", "has 3 numbers, and 2 joints have a position"),
        ("points", "do not follow each other in time"),
    ],
)
def test_what_cannot_be_told_ends_in_one_line_that_asks_for_a_map(tmp_path, how, said):
    bag = Bag(tmp_path / "bag")
    broken(how, bag)
    bag.write()
    with pytest.raises(RecordingError) as refused:
        read_recordings([bag.path], defaults=MODEL)
    line = str(refused.value)
    assert "\n" not in line
    assert "bag" in line
    assert said in line
    assert "--map" in line


def test_such_a_bag_is_imported_with_its_robot_and_asks_for_it(tmp_path, capsys):
    bag = Bag(tmp_path / "bag")
    for k in range(int(50 * SECONDS)):
        bag.numbers("/position_controller/commands", k / 50, swing(k / 50))
    bag.write()
    out = tmp_path / "out"
    assert main(["import", "bag", str(bag.path), "--out", str(out)]) == 2
    assert "--robot" in capsys.readouterr().err
    assert main(["import", "bag", str(bag.path), "--robot", "arm.xml", "--out", str(out)]) == 0
    assert "taken are /joint_states" in capsys.readouterr().out
    (trial,) = read_recordings([out]).trials
    assert set(trial.commands) == set(JOINTS)
