"""LeRobot datasets as recordings: every test writes its own small dataset, in the layout of version 3.0 or 2.1."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tiago_mj.cli import main
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

#: Names as an SO-101 has them.
ARM = ("shoulder_pan", "elbow_flex", "gripper")
RATE, ROWS, EPISODES = 30, 45, 3
MODEL = """<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="{0}" axis="0 0 1" range="-2 2"/><geom size="0.1"/>
    <body><joint name="{1}" axis="0 1 0" range="-1.7 1.7"/><geom size="0.1"/>
      <body><joint name="{2}" axis="0 1 0" range="-0.2 1.8"/><geom size="0.1"/></body></body></body></worldbody>
  <actuator><position name="pan" joint="{0}" kp="10"/><position name="elbow" joint="{1}" kp="10"/>
    <{3} name="jaw" joint="{2}"/></actuator></mujoco>"""


def dataset(
    folder,
    *,
    names=tuple(f"{joint}.pos" for joint in ARM),
    actions=None,
    largest=110.0,
    robot="so101_follower",
    version="v3.0",
    rows=ROWS,
):
    """A dataset whose first joint swings to ``largest``, the second to 20, and whose gripper opens to 80 of 100."""
    frames = {"episode_index": [], "frame_index": [], "timestamp": [], "observation.state": [], "action": []}
    for episode in range(EPISODES):
        phase = np.arange(rows) / rows * 2 * np.pi
        command = np.stack([largest * np.sin(phase), 20 * np.cos(phase) + episode, 40 - 40 * np.cos(phase)], axis=1)
        frames["episode_index"] += [episode] * rows
        frames["frame_index"] += list(range(rows))
        frames["timestamp"] += list(np.arange(rows, dtype=np.float32) / np.float32(RATE))
        frames["action"] += command.tolist()
        frames["observation.state"] += np.roll(command, 1, axis=0).tolist()
    width = pa.list_(pa.float32(), 3)
    types = [pa.int64(), pa.int64(), pa.float32(), width, width]
    table = pa.table({name: pa.array(v, kind) for (name, v), kind in zip(frames.items(), types, strict=True)})
    meta = folder / "meta"
    meta.mkdir(parents=True)
    listed = [{"episode_index": k, "tasks": ["Grab the cube"], "length": rows} for k in range(EPISODES)]
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    if version == "v3.0":
        (meta / "episodes" / "chunk-000").mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist(listed), meta / "episodes" / "chunk-000" / "file-000.parquet")
        half = rows + rows // 2  # an episode may go on in the next file
        pq.write_table(table.slice(0, half), chunk / "file-000.parquet")
        pq.write_table(table.slice(half), chunk / "file-001.parquet")
    else:
        (meta / "episodes.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in listed))
        for k in range(EPISODES):
            pq.write_table(table.slice(k * rows, rows), chunk / f"episode_{k:06d}.parquet")

    def feature(labels):
        return {"dtype": "float32", "shape": [3], "names": labels if labels is None else list(labels)}

    info = {"codebase_version": version, "robot_type": robot, "fps": RATE, "total_episodes": EPISODES}
    info["features"] = {"observation.state": feature(names), "action": feature(actions or names)}
    (meta / "info.json").write_text(json.dumps(info))
    return folder


def model(folder, joints=ARM, last="position"):
    path = folder / "arm.xml"
    path.write_text(MODEL.format(*joints, last))
    return path


def imported(source, out, *options):
    assert main(["import", "lerobot", str(source), "--out", str(out), *map(str, options)]) == 0
    return read_recordings([out]).trials


def refused(capsys, source, *options):
    out = source.parent / "never"
    assert main(["import", "lerobot", str(source), "--out", str(out), *map(str, options)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert not out.exists()
    return said


@pytest.mark.parametrize("version", ["v3.0", "v2.1"])
def test_each_episode_of_a_whole_arm_becomes_a_trial_of_the_model(tmp_path, capsys, version):
    source = dataset(tmp_path / "cubes", version=version)
    trials = imported(source, tmp_path / "out", "--model", model(tmp_path))
    assert [trial.name for trial in trials] == ["episode_000000", "episode_000001", "episode_000002"]
    trial = trials[1]
    assert set(trial.positions) == set(ARM)
    assert set(trial.commands) == {"pan", "elbow", "jaw"}  # the model's actuators
    assert trial.sidecar.rate_hz == RATE
    assert trial.sidecar.interface == "position"
    assert trial.sidecar.motion == "Grab the cube"
    np.testing.assert_allclose(trial.time, np.arange(ROWS) / RATE, atol=1e-12)
    # 110 cannot be a share of a range: degrees. The gripper's 0 to 80 of 100 are a share of the model's range.
    assert np.abs(trial.commands["pan"]).max() == pytest.approx(np.deg2rad(110), rel=1e-2)
    assert trial.positions["elbow_flex"][1] == pytest.approx(np.deg2rad(21), rel=1e-6)
    assert np.ptp(trial.positions["gripper"]) == pytest.approx(0.8 * 2.0, rel=1e-2)
    assert trial.positions["gripper"].min() == pytest.approx(-0.2, abs=1e-6)
    said = capsys.readouterr().out
    assert "taken as degrees" in said
    assert "gripper: taken as shares of the model's joint ranges" in said
    assert plant_of(trials).actuators == ("pan", "elbow", "jaw")  # what a diagnosis simulates


def test_what_may_be_degrees_or_shares_is_asked_for(tmp_path, capsys):
    source = dataset(tmp_path / "cubes", largest=80.0)
    arm = model(tmp_path)
    assert "--units degrees or --units normalised" in refused(capsys, source, "--model", arm)
    (trial, *_) = imported(source, tmp_path / "a", "--model", arm, "--units", "degrees")
    assert np.abs(trial.commands["pan"]).max() == pytest.approx(np.deg2rad(80), rel=1e-2)
    (trial, *_) = imported(source, tmp_path / "b", "--model", arm, "--units", "normalised,elbow_flex=degrees")
    assert np.abs(trial.commands["pan"]).max() == pytest.approx(0.8 * 2.0, rel=1e-2)
    assert trial.positions["elbow_flex"][1] == pytest.approx(np.deg2rad(20), rel=1e-6)


def test_radians_of_another_arm_stay_as_they_are(tmp_path, capsys):
    source = dataset(tmp_path / "x", largest=1.5, robot="panda", names=("a", "b", "c"))
    table = pq.read_table(source / "data/chunk-000/file-000.parquet")
    assert max(map(abs, table["action"][0].as_py())) > 2 * np.pi  # of b: not radians
    assert "does not say" in refused(capsys, source)
    (trial, *_) = imported(source, tmp_path / "out", "--units", "radians")
    assert np.abs(trial.commands["a"]).max() == pytest.approx(1.5, rel=1e-2)
    assert trial.sidecar.robot == "panda"


def test_without_a_model_a_grippers_share_is_kept_and_not_used(tmp_path, capsys):
    (trial, *_) = imported(dataset(tmp_path / "cubes"), tmp_path / "out")
    assert set(trial.commands) == {"shoulder_pan", "elbow_flex"}
    assert set(trial.extras) == {"position.gripper", "command.gripper"}
    said = capsys.readouterr().out
    assert "give --model" in said
    assert "--model FILE.xml --out diagnosis" in said
    assert "only a model tells" in refused(capsys, tmp_path / "cubes", "--units", "normalised")


def test_other_names_of_an_arm_are_found_or_asked_for(tmp_path, capsys):
    """SO-100 datasets before version 3 have ``main_shoulder_pan``; a public MJCF of that arm calls it Rotation."""
    source = dataset(tmp_path / "old", names=tuple(f"main_{joint}" for joint in ARM), version="v2.1")
    (trial, *_) = imported(source, tmp_path / "a", "--model", model(tmp_path, ("Rotation", "Elbow", "Jaw")))
    assert set(trial.positions) == {"Rotation", "Elbow", "Jaw"}
    arm = model(tmp_path, ("base", "Elbow", "Jaw"))
    assert "--joints main_shoulder_pan=JOINT" in refused(capsys, source, "--model", arm)
    (trial, *_) = imported(source, tmp_path / "b", "--model", arm, "--joints", "main_shoulder_pan=base,main_gripper=")
    assert set(trial.positions) == {"base", "Elbow"}
    assert set(trial.commands) == {"pan", "elbow"}


def damaged(source, how):
    info_file = source / "meta" / "info.json"
    info = json.loads(info_file.read_text())
    file = source / "data" / "chunk-000" / "file-001.parquet"
    if how == "cut off":
        file.write_bytes(file.read_bytes()[:-50])
    elif how == "pointer":
        file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    elif how == "missing file":
        file.unlink()
    elif how == "no data":
        for path in file.parent.iterdir():
            path.unlink()
    elif how == "rows missing":
        table = pq.read_table(file)
        pq.write_table(table.slice(0, table.num_rows - 5), file)
    elif how == "column missing":
        pq.write_table(pq.read_table(file).drop_columns(["action"]), file)
    elif how == "width":
        info["features"]["action"] = {"dtype": "float32", "shape": [2], "names": ["shoulder_pan.pos", "gripper.pos"]}
    elif how == "version":
        info["codebase_version"] = "v1.6"
    elif how == "rate":
        info["fps"] = None
    elif how == "actions":
        info["features"]["action"]["names"] = ["delta_x", "delta_y", "gripper.pos"]
    elif how == "state":
        del info["features"]["observation.state"]
    elif how == "no json":
        info_file.write_text("{")
        return
    elif how == "encoder steps":
        table = pq.read_table(file)
        steps = pa.array([[2048.0, 1.0, 1.0]] * table.num_rows, table.schema.field("action").type)
        pq.write_table(table.set_column(table.column_names.index("action"), "action", steps), file)
    info_file.write_text(json.dumps(info))


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("cut off", "data/chunk-000/file-001.parquet: not a whole Parquet file"),
        ("pointer", "git lfs pull"),
        ("missing file", "episode 1 has 22 rows, meta/episodes says 45"),
        ("no data", "data/chunk-*/*.parquet is missing"),
        ("rows missing", "episode 2 has 40 rows, meta/episodes says 45"),
        ("column missing", "data/chunk-000/file-001.parquet: column action is missing"),
        ("width", "column action does not have 2 numbers in every row"),
        ("version", "codebase_version is 'v1.6'"),
        ("rate", "fps is None"),
        ("actions", "action 'delta_x' is no position of a joint"),
        ("state", "observation.state is no list of numbers"),
        ("no json", "meta/info.json is not readable JSON"),
        ("encoder steps", "steps of the encoder"),
    ],
)
def test_a_damaged_dataset_ends_in_one_line_that_says_where(tmp_path, capsys, how, said):
    source = dataset(tmp_path / "cubes")
    damaged(source, how)
    assert said in refused(capsys, source, "--model", model(tmp_path))


def test_a_list_of_episodes_that_is_one_endless_line_is_not_read_to_its_end(tmp_path, capsys):
    source = dataset(tmp_path / "cubes", version="v2.1")
    with (source / "meta" / "episodes.jsonl").open("r+b") as file:
        file.write(b" ")
        file.truncate(10**12)  # zeros that take no room on the drive
    assert "meta/episodes is not the format's" in refused(capsys, source, "--model", model(tmp_path))


def test_a_model_that_does_not_fit_ends_in_one_line(tmp_path, capsys):
    source = dataset(tmp_path / "cubes")
    urdf = tmp_path / "arm.urdf"
    urdf.write_text("<robot name='x'/>")
    for options, said in [
        (("--model", tmp_path / "no.xml"), "no such file"),
        (("--model", urdf), "tiago-mj convert"),
        (("--model", model(tmp_path, last="motor")), "its actuator is a motor"),
        (("--joints", "elbow"), "write NAME=JOINT"),
        (("--joints", "knee=elbow_flex"), "the dataset has no 'knee'"),
        (("--units", "furlongs"), "use one of degrees"),
        (("--units", "knee=degrees"), "there is no joint 'knee'"),
        (("--map", tmp_path / "map.yaml"), "--map is of bag"),
    ]:
        assert said in refused(capsys, source, *options)
    assert "meta/info.json is missing" in refused(capsys, tmp_path / "nowhere")
