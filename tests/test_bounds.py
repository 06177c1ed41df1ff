"""Tables, archives and models that claim more than they hold, or hold more than anybody needs."""

import json
import os
import random
import resource
import struct
import sys
import time
import zipfile
import zlib
from contextlib import contextmanager
from dataclasses import replace

import gymnasium
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import tiago_mj  # noqa: F401  (registers the environments)
from tiago_mj import cli
from tiago_mj.io.quoting import HIDDEN
from tiago_mj.learn.agent_file import Agent, load_agent
from tiago_mj.models import bounded
from tiago_mj.models.bounded import BODIES, load_model
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.models.convert.urdf_to_mjcf import convert
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError

#: Of a processor; the promise of docs/trust.md. Nearly all of it takes less than a second where nothing else runs.
SECONDS, MEGABYTES = 20.0, 300.0
FACTS = {"robot": "arm.xml", "interface": "position", "rate_hz": 100.0}


@contextmanager
def frugal():
    """What is run takes little time and memory."""

    def peak():
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return most / 1e6 if sys.platform == "darwin" else most / 1e3

    before, began = peak(), time.process_time()
    yield
    assert time.process_time() - began < SECONDS
    assert peak() - before < MEGABYTES


def refusal(error, call, *arguments):
    with pytest.raises(error) as caught, frugal():
        call(*arguments)
    said = str(caught.value)
    assert type(caught.value) is error
    assert len(said.splitlines()) == 1
    assert HIDDEN.search(said) is None
    assert len(said) < 2500
    return said


# Tables

ROWS = 2000
COLUMNS = {
    "time": np.arange(ROWS) / 100,
    "command.elbow": np.sin(np.arange(ROWS) / 50),
    "position.elbow": np.cos(np.arange(ROWS) / 50),
}


def recording(path):
    return read_recordings([path], defaults=FACTS)


def repeated(value):
    """A column whose every row is one large value, which takes some bytes in a file."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(ROWS, dtype=np.int32)), pa.array([value]))


@pytest.mark.parametrize(
    "column",
    [
        lambda: repeated("x" * 1_000_000),
        lambda: pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(20_000 * ROWS)), 20_000),
        lambda: pa.array([{"a": "x" * 5_000}] * ROWS),
    ],
    ids=["text", "lists", "structures"],
)
def test_columns_that_are_no_numbers_are_not_unpacked(column, tmp_path):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({**COLUMNS, "note": column()}), path, compression="zstd")
    with frugal():
        result = recording(path)
    assert set(result.trials[0].positions) == {"elbow"}
    assert any("note" in str(finding) for finding in result.findings)


def test_more_columns_than_a_robot_has_are_refused(tmp_path):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({**COLUMNS, **{f"c{k}": np.zeros(ROWS) for k in range(6000)}}), path)
    assert "of 6003 columns are more than" in refusal(RecordingError, recording, path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time," + "c," * 1_500_000 + "\n1\n", "the first line is no header"),
        ("time,position.a\n0," + "9" * 200_000_000 + "\n", "are no table of numbers"),
        ("time,position.\u202ea\n0,1\n1,2\n", "has a character that is not shown"),
        ('time,"position.\na"\n0,1\n1,2\n', "a row does not fit the header"),
    ],
    ids=["wide", "long", "turned around", "line end"],
)
def test_a_csv_that_is_no_table_is_refused(text, said, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert said in refusal(RecordingError, recording, path)


def test_a_csv_that_is_larger_than_any_table_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,position.elbow\n0,0\n")
    with path.open("r+b") as file:
        file.truncate(10**13)  # zeros that take no room on the drive
    assert "10000000 MB" in refusal(RecordingError, recording, path)


@pytest.mark.parametrize("to", ["nowhere", "a.csv"], ids=["nowhere", "itself"])
def test_a_recording_that_is_a_link_to_nothing_is_named(to, tmp_path):
    path = tmp_path / "a.csv"
    path.symlink_to(to)
    (tmp_path / "b.csv").write_text("time,position.elbow,command.elbow\n0,0,0\n1,0,0\n")
    assert refusal(RecordingError, recording, tmp_path).startswith("a.csv: it cannot be read (")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere such names cannot be")
def test_a_file_whose_name_is_no_text_is_named(tmp_path):
    path = tmp_path / os.fsdecode(b"\xff.csv")
    path.write_text("time,position.elbow,command.elbow\n0,0,0\n1,0,0\n")
    assert "\\udcff.csv: this name is no UTF-8 text" in refusal(RecordingError, recording, path)


def test_a_table_of_whose_bytes_some_are_others_is_read_or_refused_in_one_line(tmp_path):
    rng = random.Random(3)
    for form in ("parquet", "csv"):
        path = tmp_path / f"a.{form}"
        if form == "parquet":
            pq.write_table(pa.table({key: values[:60] for key, values in COLUMNS.items()}), path)
        else:
            rows = np.column_stack([values[:60] for values in COLUMNS.values()])
            np.savetxt(path, rows, delimiter=",", header=",".join(COLUMNS), comments="")
        whole = path.read_bytes()
        for _ in range(200):
            data = bytearray(whole)
            for _ in range(rng.randint(1, 5)):
                data[rng.randrange(len(data))] = rng.randrange(256)
            path.write_bytes(data if rng.random() < 0.8 else data[: rng.randrange(len(data))])
            try:
                recording(path)
            except RecordingError as fault:
                line = str(fault)
                assert len(line.splitlines()) == 1


# Agents and checkpoints


@pytest.fixture
def agent():
    """Of the gripper with two load cells: 10 numbers in, two joints."""
    env = gymnasium.make("tiago_mj/GripperTactile-v0")
    inputs, joints = env.observation_space.shape[0], env.action_space.shape[0]
    env.close()
    rng = np.random.default_rng(0)
    layers = tuple(
        (rng.normal(size=(out, width)).astype(np.float32), np.zeros(out, dtype=np.float32))
        for width, out in ((inputs, 16), (16, joints))
    )
    bounds = np.ones(joints, dtype=np.float32)
    return Agent(layers, "ReLU", "tanh", (("", inputs),), -bounds, bounds, origin={"env": "GripperTactile-v0"})


def rewritten(path, change, **more):
    """An npz anew, with some of its parts changed: arrays by name, or bytes of a file."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    parts = change(parts)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return path


def claiming(shape, kind="<f4"):
    """An array's file that holds eight bytes."""
    text = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode()
    text += b" " * (64 - (len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + b"\0" * 8


@pytest.mark.parametrize(
    ("part", "content"),
    [
        ("weight_0.npy", claiming((10**13,))),
        ("weight_0.npy", claiming((10**9, 10**9))),
        ("weight_0.npy", claiming((-1,))),
        ("weight_0.npy", claiming((2,), "|O")),
        ("weight_0.npy", b"no array"),
        ("header.npy", claiming((), "<U4000000000")),
        ("more.npy", b"\0" * 200_000_000),
    ],
    ids=["long", "square", "negative", "objects", "nothing", "header", "packed zeros"],
)
def test_an_array_that_claims_more_than_it_holds_is_refused(part, content, agent, tmp_path):
    path = tmp_path / "agent.npz"
    agent.save(path)
    rewritten(path, lambda parts: {**parts, part: content})
    assert "is no agent that can be read" in refusal(ValueError, load_agent, path)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such pipes and devices")
@pytest.mark.parametrize("kind", ["pipe", "zeros", "folder"])
def test_an_agent_that_is_no_file_is_refused_at_once(kind, tmp_path):
    path = tmp_path / "agent.npz"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "zeros":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    assert "it is a folder, a pipe or a device" in refusal(ValueError, load_agent, path)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ({"activation": ["ReLU"]}, "ReLU"),
        ({"inputs": [["", 10**400]]}, "too large"),
        ({"inputs": {"": 3}}, ""),
        ({"limit": 0}, "divides"),
        ({"origin": [1]}, "origin"),
        ({"schema": ["tiago_mj.agent/1"]}, "schema"),
        ([1], "schema"),
    ],
)
def test_a_header_of_another_form_is_refused(header, said, agent, tmp_path):
    path = tmp_path / "agent.npz"
    agent.save(path)
    whole = {"schema": "tiago_mj.agent/1", **agent.header()}
    text = json.dumps({**whole, **header} if isinstance(header, dict) else header)
    np.savez(path, header=np.array(text), **agent.arrays())
    assert said in refusal(ValueError, load_agent, path)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_evaluate_refuses_an_agent_whose_weights_are_not_finite(value, agent, tmp_path, capsys):
    (weight, bias), *others = agent.layers
    weight = weight.copy()
    weight[3, 2] = value
    path = tmp_path / "agent.npz"
    replace(agent, layers=((weight, bias), *others)).save(path)
    words = ["evaluate", "--env", "GripperTactile-v0", "--policy", str(path), "--episodes", "1"]
    assert cli.main(words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "it has numbers that are not finite" in said


def test_an_agent_of_whose_bytes_some_are_others_acts_or_is_refused_in_one_line(agent, tmp_path):
    rng = random.Random(5)
    path = tmp_path / "agent.npz"
    agent.save(path)
    whole = path.read_bytes()
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(rng.randint(1, 4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        try:
            load_agent(path)
        except ValueError as fault:
            line = str(fault)
            assert type(fault) is ValueError  # noqa: PT017
            assert len(line.splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [("a weight is not a number", "not finite"), ("it is packed", "compressed"), ("an array claims more", "claims")],
)
def test_a_checkpoint_that_cannot_be_gone_on_from_is_refused(change, said, tmp_path, capsys):
    torch = pytest.importorskip("torch")
    pytest.importorskip("stable_baselines3")
    import io

    (tmp_path / "h.yml").write_text("default: {n_envs: 1, learning_starts: 10, policy_kwargs: {net_arch: [4]}}\n")
    words = [
        "train", "--env", "GripperTactile-v0", "--hyperparameters", str(tmp_path / "h.yml"), "--steps", "60", "--quiet",
        "--env-option", "max_episode_steps=20", "--evaluation-episodes", "1", "--out", str(tmp_path / "run"),
    ]  # fmt: skip
    assert cli.main(words) == 0
    path = tmp_path / "run" / "seed-0" / "checkpoint.zip"
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    if "weight" in change:
        tensors = torch.load(io.BytesIO(parts["parameters.pt"]), weights_only=True)
        next(iter(tensors["parameters"]["policy"].values())).fill_(float("nan"))
        packed = io.BytesIO()
        torch.save(tensors, packed)
        parts["parameters.pt"] = packed.getvalue()
    if "array" in change:
        parts["replay/rewards/.npy"] = claiming((10**13,))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if "packed" in change else zipfile.ZIP_STORED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    capsys.readouterr()
    assert cli.main(words) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "checkpoint.zip cannot be read" in line
    assert said in line


# Models

ARM, EQUAL = '<worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>', '<joint joint1="j"/>'
BODY = '<body><joint/><geom size=".1"/></body>'


def world(inside):
    return f"<mujoco><worldbody>{inside}</worldbody></mujoco>"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (world('<replicate count="1000" offset="1 0 0">' * 3 + BODY + "</replicate>" * 3), "<replicate> makes"),
        (world(BODY * 3000), f"more than {BODIES} bodies"),
        (world('<body><joint/><geom size=".1"/>' * 3000 + "</body>" * 3000), "nested more than"),
        (world("<geom size='.1'/>" * 30_000), "elements"),
        (world('<flexcomp name="f" type="grid" count="1000 1000 1000" spacing=".1 .1 .1"/>'), "<flexcomp>"),
        ('<mujoco><asset><texture builtin="flat" width="100000" height="100000"/></asset></mujoco>', "<texture>"),
        ('<mujoco><asset><hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/></asset></mujoco>', "<hfield>"),
        ('<mujoco><size nuser_body="1000000000"/></mujoco>', "nuser_body"),
        ('<mujoco><custom><numeric name="n" size="1000000000" data="1"/></custom></mujoco>', "<numeric>"),
        ('<mujoco><option timestep="1e-12"/></mujoco>', "timestep"),
        ('<mujoco><option iterations="1000000000"/></mujoco>', "iterations"),
        (f"<mujoco>{ARM}<equality>{EQUAL * 9000}</equality></mujoco>", "MB of memory"),
        ('<mujoco><size memory="100G"/></mujoco>', "memory of <size> is '100G'"),
        ('<mujoco><include file="model.xml"/></mujoco>', "included within itself"),
        ('<mujoco><include file="."/></mujoco>', "'.' is no file"),
        ('<!DOCTYPE a [<!ENTITY b "bbbb">]><mujoco/>', "document type"),
        ("<!--" + "x" * 20_000_000 + "--><mujoco/>", "16 MB"),
        ("<mujoco><worldbody>", "model.xml:1: "),
        ("", "model.xml:1: "),
    ],
    ids=lambda value: value[:40] if value else "nothing",
)  # fmt: skip
def test_a_model_that_nobody_can_simulate_is_refused_before_it_is_compiled(text, said, tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(text)
    assert said in refusal(ValueError, load_model, path, "model model.xml")


def picture(width, height, rows):
    """A PNG of one bit a pixel that claims a size and holds so many black rows."""

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    packer = zlib.compressobj(9)
    part = bytes((1 + width // 8) * 100)
    packed = b"".join(packer.compress(part) for _ in range(rows // 100)) + packer.flush()
    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a process's memory is not bounded")
@pytest.mark.parametrize(("height", "rows"), [(40_000, 40_000), (8, 100_000)], ids=["large", "more than it claims"])
def test_a_picture_of_kilobytes_that_unpacks_to_gigabytes_is_refused(height, rows, tmp_path):
    (tmp_path / "t.png").write_bytes(picture(40_000, height, rows))
    assert (tmp_path / "t.png").stat().st_size < 3_000_000
    path = tmp_path / "model.xml"
    path.write_text('<mujoco><asset><texture type="2d" file="t.png"/></asset></mujoco>')
    assert "t.png" in refusal(ValueError, load_model, path, "model")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no such pipes")
def test_a_model_that_does_not_compile_in_time_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(bounded, "SECONDS", 3.0)
    os.mkfifo(tmp_path / "m.stl")  # nobody ever writes into it
    path = tmp_path / "model.xml"
    path.write_text('<mujoco><asset><mesh name="m" file="m.stl"/></asset></mujoco>')
    assert "it takes more than 3 s to compile" in refusal(ValueError, load_model, path, "model")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no such pipes")
def test_a_model_that_is_a_pipe_is_refused_at_once(tmp_path):
    for name, read, error in (
        ("model.xml", lambda path: load_model(path, "model"), ValueError),
        ("robot.urdf", lambda path: convert(path, tmp_path / "out.xml"), ConversionError),
    ):
        os.mkfifo(tmp_path / name)
        assert "is a pipe" in refusal(error, read, tmp_path / name)


def test_a_model_with_a_mesh_compiles_as_without_bounds(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "m.stl")
    path = tmp_path / "model.xml"
    asset = '<asset><mesh name="m" file="m.stl"/></asset>'
    path.write_text(world('<geom type="mesh" mesh="m"/>').replace("<worldbody>", f"{asset}<worldbody>"))
    assert load_model(path, "model").nmeshvert == 8


def test_a_model_that_nobody_can_wait_for_is_refused(tmp_path):
    path = tmp_path / "model.xml"
    heap = '<replicate count="60"><body><freejoint/><geom size=".1"/></body></replicate>'
    path.write_text(world(heap).replace("<worldbody>", '<option timestep="1e-5"/><worldbody>'))
    model = load_model(path, "model")
    assert "a second of simulation takes" in refusal(ValueError, bounded.check_speed, model, "model")
    path.write_text(world(BODY))
    bounded.check_speed(load_model(path, "model"), "model")


def test_what_models_take_in_from_other_files_counts(tmp_path):
    (tmp_path / "many.xml").write_text("<mujocoinclude>" + BODY * 300 + "</mujocoinclude>")
    (tmp_path / "arm.xml").write_text(world('<body><joint/><geom size=".1"/></body>'))
    path = tmp_path / "model.xml"
    path.write_text(world('<include file="many.xml"/>'))
    assert load_model(path, "model").nbody == 301
    path.write_text(world('<replicate count="5" offset="1 0 0"><include file="many.xml"/></replicate>'))
    assert "bodies" in refusal(ValueError, load_model, path, "model")
    path.write_text(
        '<mujoco><asset><model name="arm" file="arm.xml"/></asset><worldbody>'
        + "".join(f'<frame><attach model="arm" prefix="{k}"/></frame>' for k in range(3))
        + "</worldbody></mujoco>"
    )
    assert load_model(path, "model").nbody == 4


def urdf(parents):
    links = "".join(f'<link name="l{k}"/>' for k in range(len(parents) + 1))
    joints = "".join(
        f'<joint name="j{k}" type="fixed"><parent link="l{parent}"/><child link="l{k + 1}"/></joint>'
        for k, parent in enumerate(parents)
    )
    return f'<robot name="r">{links}{joints}</robot>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (urdf([0] * 2999), "has 3000 links"),
        (urdf(range(400)), "hangs on more than"),
        ('<robot name="r">' + "<a>" * 5000 + "</a>" * 5000 + "</robot>", "within each other"),
        ('<robot name="' + "x" * 100_000 + '"><link/></robot>', "name"),
        ('<robot name="\u202e"><link name="a\u202e"/><link name="b"/></robot>', "root links"),
    ],
    ids=["links", "chain", "nesting", "long name", "turned around"],
)
def test_a_urdf_that_is_no_robot_is_refused(text, said, tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    assert said in refusal(ConversionError, convert, path, tmp_path / "robot.xml")


# Environments


@pytest.mark.parametrize("options", [3, "x", [1], {"goal": 10**5000}, {"goal": {}}, {("a",): 1}, {"x" * 10**6: 1}])
def test_an_environment_takes_no_options_of_another_form(options):
    for env in (
        gymnasium.make("tiago_mj/GripperTactileGoal-v0"),
        gymnasium.make("tiago_mj/GripperTactile-v0"),
        gymnasium.make_vec("tiago_mj/GripperTactileGoal-v0", num_envs=2),
    ):
        said = refusal(ValueError, lambda env=env: env.reset(options=options))
        assert "goal" in said
        env.close()


@pytest.mark.parametrize("name", ["object", "servo", "control", "control_hz", "finger_speed", "sensing", "object_mass"])
@pytest.mark.parametrize(
    "value", [[[]], {}, 10**5000, float("nan"), "x" * 10**6, {"a": [1]}], ids=lambda v: str(type(v))
)
def test_an_environment_takes_no_arguments_of_another_form(name, value):
    refusal(ValueError, lambda: gymnasium.make("tiago_mj/GripperTactile-v0", **{name: value}))
