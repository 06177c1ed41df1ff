"""ROS bags as recordings: every test writes its own small bag."""

import json

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from tiago_mj.cli import main
from tiago_mj.models import names
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError

RIGHT, LEFT = names.FINGERS
START = 1_700_000_000_000_000_000
#: Rates of the real robot's topics [Hz], and length [s].
STATES, COMMANDS, FORCES, SECONDS = 50, 25, 100, 2.0
KINDS = ("ros1", "sqlite3", "mcap")


def grasp(joints=(RIGHT, LEFT, "wheel_left_joint")):
    """Messages of a closing gripper: topic, stamp [ns], type, content."""
    messages = []
    for k in range(int(STATES * SECONDS)):
        t = k / STATES
        position = {RIGHT: 0.045 - 0.01 * t, LEFT: 0.045 - 0.012 * t, "wheel_left_joint": 3.0}
        content = (joints, [position[j] for j in joints], [-0.01, -0.012, 0.0][: len(joints)], [])
        messages.append(("/joint_states", round(t * 1e9), "sensor_msgs/msg/JointState", content))
    for k in range(int(COMMANDS * SECONDS)):
        t = k / COMMANDS
        for topic, speed in (("/finger_right_controller/command", 0.01), ("/finger_left_controller/command", 0.012)):
            content = [0.045 - speed * t]
            messages.append((topic, round(t * 1e9) + 1_000_000, "std_msgs/msg/Float64MultiArray", content))
    rng = np.random.default_rng(0)
    for k in range(int(FORCES * SECONDS)):
        content = rng.normal([0.0, 0.3], 0.008).tolist()
        messages.append(("/ta11", round(k / FORCES * 1e9) + 2_000_000, "std_msgs/msg/Float64MultiArray", content))
    return sorted(messages, key=lambda message: message[1])


def write_bag(folder, kind, messages, *, header_shift=0):
    """A bag of one of the three kinds; headers may be of another clock."""
    folder.mkdir(parents=True, exist_ok=True)
    first = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    path = folder / ("grasp.bag" if first else "grasp")
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if first else Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        connections = {}
        for topic, stamp, kind_of, content in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind_of, typestore=store)
            message = make(store, kind_of, content, START + stamp + header_shift, first)
            raw = store.serialize_ros1(message, kind_of) if first else store.serialize_cdr(message, kind_of)
            writer.write(connections[topic], START + stamp, raw)
    return path


def make(store, kind, content, stamp, first):
    types = store.types
    if kind.endswith("JointState"):
        seconds = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": 0} if first else {}
        header = types["std_msgs/msg/Header"](stamp=seconds, frame_id="", **more)
        joints, *parts = content
        position, velocity, effort = (np.array(part, dtype=np.float64) for part in parts)
        return types[kind](header=header, name=list(joints), position=position, velocity=velocity, effort=effort)
    if kind.endswith("String"):
        return types[kind](data=content)
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return types[kind](layout=layout, data=np.array(content, dtype=np.float64))


def refusal(path, **options):
    with pytest.raises(RecordingError) as caught:
        read_recordings([path], **options)
    line = str(caught.value)
    assert "\n" not in line
    return line


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_the_real_robots_topics_is_a_recording(tmp_path, kind):
    (trial,) = read_recordings([write_bag(tmp_path, kind, grasp())]).trials
    assert trial.sidecar.robot == "tiago_ta11"
    assert trial.sidecar.interface == "position"
    assert trial.sidecar.rate_hz == pytest.approx(COMMANDS)
    assert set(trial.positions) == {RIGHT, LEFT}  # wheels are not of the task
    assert set(trial.commands) == {RIGHT, LEFT}
    assert not trial.efforts  # an empty list in the messages
    measured = ~np.isnan(trial.positions[LEFT])
    assert measured.sum() == STATES * SECONDS
    np.testing.assert_allclose(trial.positions[LEFT][measured], 0.045 - 0.012 * trial.time[measured], atol=1e-9)
    sent = ~np.isnan(trial.commands[RIGHT])
    np.testing.assert_allclose(trial.commands[RIGHT][sent], 0.045 - 0.01 * (trial.time[sent] - 0.001), atol=1e-9)
    assert np.nanmedian(trial.forces["left"]) == pytest.approx(0.3, abs=0.005)  # right comes first
    assert np.nanmedian(trial.forces["right"]) == pytest.approx(0.0, abs=0.005)
    assert trial.time[0] == 0.0


def test_rows_are_the_union_of_the_stamps(tmp_path):
    messages = grasp()
    (trial,) = read_recordings([write_bag(tmp_path, "mcap", messages)]).trials
    assert len(trial.time) == len({stamp for _, stamp, *_ in messages})
    assert np.isnan(trial.forces["right"]).sum() == len(trial.time) - FORCES * SECONDS


def test_a_folder_of_bags_is_a_folder_of_trials(tmp_path):
    for number in range(2):
        path = write_bag(tmp_path / "bags", "ros1", grasp()[number:])
        path.rename(path.with_name(f"grasp-{number}.bag"))
    assert [trial.name for trial in read_recordings([tmp_path / "bags"]).trials] == ["grasp-0", "grasp-1"]


def test_a_map_file_names_other_topics_and_what_the_sidecar_would_say(tmp_path):
    messages = [("/arm/state" if topic == "/joint_states" else topic, *rest) for topic, *rest in grasp()]
    map_file = tmp_path / "map.yaml"
    map_file.write_text(
        "robot: arm.xml\ninterface: velocity\ntopics:\n  /arm/state: {kind: joint_state}\n"
        f"  /finger_left_controller/command: {{kind: command, names: [{LEFT}]}}\n"
    )
    (trial,) = read_recordings([write_bag(tmp_path, "sqlite3", messages)], map_file=map_file).trials
    assert (trial.sidecar.robot, trial.sidecar.interface) == ("arm.xml", "velocity")
    assert set(trial.positions) == {RIGHT, LEFT, "wheel_left_joint"}
    assert set(trial.commands) == {LEFT}
    assert not trial.forces
    assert set(trial.sidecar.source) == {"bag"}
    map_file.write_text(
        "robot: arm.xml\ninterface: velocity\ntopics:\n  /arm/state: {kind: joint_state, joints: [elbwo]}\n"
        f"  /finger_left_controller/command: {{kind: command, names: [{LEFT}]}}\n"
    )
    with pytest.raises(RecordingError, match="topic /arm/state has no joint 'elbwo', which the map file names"):
        read_recordings([write_bag(tmp_path / "again", "sqlite3", messages)], map_file=map_file)


def test_a_sidecar_beside_a_bag_counts_more_than_the_map(tmp_path):
    path = write_bag(tmp_path, "ros1", grasp())
    path.with_suffix(".json").write_text(json.dumps({"robot": "mine.xml", "trial": "first"}))
    (trial,) = read_recordings([path]).trials
    assert (trial.name, trial.sidecar.robot) == ("first", "mine.xml")


def test_headers_of_another_clock_are_not_believed_and_that_is_said(tmp_path):
    path = write_bag(tmp_path, "sqlite3", grasp(), header_shift=7_000_000_000 - START)
    result = read_recordings([path])
    assert [(f.code, f.channel, f.repaired) for f in result.findings] == [("time_origin", "/joint_states", True)]
    assert result.trials[0].time[-1] == pytest.approx(SECONDS, abs=0.05)


def test_messages_that_repeat_a_stamp_are_said(tmp_path):
    messages = grasp()
    states = [message for message in messages if message[0] == "/joint_states"]
    result = read_recordings([write_bag(tmp_path, "mcap", sorted(messages + states[:5], key=lambda m: m[1]))])
    assert [(f.code, f.repaired) for f in result.findings] == [("time_not_monotonic", True)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_without_a_needed_topic_says_which_there_are(tmp_path, kind):
    messages = [message for message in grasp() if message[0] != "/joint_states"]
    line = refusal(write_bag(tmp_path, kind, messages))
    assert "topic /joint_states is missing" in line
    assert "/ta11" in line


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_that_was_cut_off_is_refused(tmp_path, kind):
    path = write_bag(tmp_path, kind, grasp())
    file = path if path.is_file() else next(entry for entry in path.iterdir() if entry.suffix in (".db3", ".mcap"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert "not a whole ROS bag" in refusal(path)


def test_a_file_that_only_looks_like_a_bag_is_refused(tmp_path):
    for suffix in (".bag", ".mcap", ".db3"):
        path = tmp_path / f"fake{suffix}"
        path.write_bytes(b"nothing of the kind" * 100)
        assert "not a whole ROS bag" in refusal(path)


def test_topics_of_the_wrong_kind_are_refused(tmp_path):
    words = [*grasp(), ("/log", 5_000_000, "std_msgs/msg/String", "hello")]
    bag = write_bag(tmp_path, "mcap", sorted(words, key=lambda message: message[1]))
    for topics, said in [
        ("/log: {kind: force, names: [right]}", "not numbers"),
        ("/ta11: {kind: force, names: [right]}", "2 numbers"),
        ("/ta11: {kind: joint_state}", "not a JointState"),
        ("/ta11: {kind: telepathy, names: [right]}", "telepathy"),
        ("/ta11: {kind: force}", "names is missing"),
        ("/ta11: force", "write {kind"),
    ]:
        map_file = tmp_path / "map.yaml"
        map_file.write_text(f"robot: x\ninterface: position\ntopics:\n  {topics}\n")
        assert said in refusal(bag, map_file=map_file)


def test_a_bag_is_imported_from_the_command_line(tmp_path, capsys):
    bag = write_bag(tmp_path, "ros1", grasp())
    out = tmp_path / "out"
    assert main(["import", "bag", str(bag), "--robot", "tiago_mj/GripperTactile-v0", "--out", str(out)]) == 0
    assert "1 recording in" in capsys.readouterr().out
    (trial,) = read_recordings([out]).trials
    assert trial.sidecar.robot == "tiago_mj/GripperTactile-v0"
    assert np.isnan(trial.forces["right"]).any()
