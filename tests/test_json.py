"""``--json``: standard output is one JSON document, and nothing else is on it."""

import argparse
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind import __main__ as blind
from tiago_mj import cli

ROOT = Path(__file__).parents[1]
PENDULUM = ROOT / "examples" / "pendulum"


def said(capsys, *words):
    """What a command prints, read as JSON."""
    assert cli.main([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("command", [name for name in cli.COMMANDS if name != "completion"])
def test_every_command_that_prints_results_takes_json(command):
    parser = cli.build_parser(command)
    commands = next(action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    assert "--json" in commands.choices[command].format_help()


@pytest.fixture
def recordings(tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="needs the extra 'gap'")
    words = ("record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "1", "--out", tmp_path / "r")
    data = said(capsys, *words)
    assert data["robot"] == "GripperTactile-v0"
    assert data["minari"] is None
    assert len(data["recordings"]) == 1
    assert all(Path(path).is_file() for path in data["recordings"])
    return tmp_path / "r"


def test_record_and_preflight(recordings, capsys):
    data = said(capsys, "preflight", recordings)
    assert data["schema"] == "tiago_mj.preflight/1"
    assert data["trials"] == 1
    assert any(one["visible"] for one in data["effects"])


def test_calibrate_sensor(tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="needs the extra 'gap'")
    words = (
        "--env",
        "GripperTactile-v0",
        "--motion",
        "touch_release_240hz",
        "--episodes",
        "4",
        "--out",
        tmp_path / "r",
    )
    said(capsys, "record", *words)
    data = said(capsys, "calibrate-sensor", tmp_path / "r", "--out", tmp_path / "s.yaml")
    assert data["written"] == str(tmp_path / "s.yaml")
    assert np.all(np.array(data["noise"]) > 0)


def test_import(tmp_path, capsys):
    pa = pytest.importorskip("pyarrow", reason="needs the extra 'gap'")
    import pyarrow.parquet as pq

    meta, data = tmp_path / "d" / "meta", tmp_path / "d" / "data" / "chunk-000"
    meta.mkdir(parents=True)
    data.mkdir(parents=True)
    swing = (110 * np.sin(np.arange(60) / 8))[:, None].astype(np.float32)
    width = pa.list_(pa.float32(), 1)
    columns = {
        "episode_index": pa.array([0] * 60, pa.int64()),
        "frame_index": pa.array(range(60), pa.int64()),
        "timestamp": pa.array(np.arange(60) / 30, pa.float32()),
        "action": pa.array(swing.tolist(), width),
        "observation.state": pa.array(np.roll(swing, 1, axis=0).tolist(), width),
    }
    pq.write_table(pa.table(columns), data / "episode_000000.parquet")
    (meta / "episodes.jsonl").write_text(json.dumps({"episode_index": 0, "tasks": ["a"], "length": 60}))
    feature = {"dtype": "float32", "shape": [1], "names": ["pan.pos"]}
    info = {"codebase_version": "v2.1", "robot_type": "arm", "fps": 30, "total_episodes": 1}
    info["features"] = {"action": feature, "observation.state": feature}
    (meta / "info.json").write_text(json.dumps(info))
    found = said(capsys, "import", "lerobot", tmp_path / "d", "--out", tmp_path / "out")
    assert [Path(path).suffix for path in found["recordings"]] == [".parquet"]
    assert found["findings"]
    assert {"code", "file", "channel", "message", "repaired"} == set(found["findings"][0])


def test_convert(tmp_path, capsys):
    data = said(capsys, "convert", PENDULUM / "pendulum.urdf", "--out", tmp_path / "p.xml")
    assert isinstance(data, dict)
    assert (tmp_path / "p.xml").exists()


def test_agents(capsys):
    assert any(agent["name"] == "ppo-steady" for agent in said(capsys, "agents"))


def test_doctor_says_that_the_base_works(capsys):
    data = said(capsys, "doctor")
    assert data["works"] is True
    assert data["versions"]["mujoco"].startswith("4.")
    by_name = {check["name"]: check for check in data["checks"]}
    assert by_name["an environment"]["works"]
    assert all(check["works"] or check["mend"] for check in data["checks"])


def test_doctor_fails_where_no_environment_steps(capsys, monkeypatch):
    import gymnasium

    def broken(*args, **kwargs):
        raise RuntimeError("no such thing\nhere")

    monkeypatch.setattr(gymnasium, "make", broken)
    assert cli.main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "no such thing here" in out
    assert "does not work" in out


def test_doctor_names_what_an_extra_lacks(monkeypatch):
    import importlib.metadata as metadata

    from tiago_mj import doctor

    real = metadata.version

    def version(name):
        if name == "pyarrow":
            raise metadata.PackageNotFoundError(name)
        return "0.1" if name == "pandas" else real(name)

    monkeypatch.setattr(metadata, "version", version)
    lacking = doctor.missing("gap")
    assert "pyarrow" in lacking
    assert any(one.startswith("pandas>=") and "there is 0.1" in one for one in lacking)
    assert "pyarrow" not in doctor.missing(None)


@pytest.mark.usefixtures("opengl")
@pytest.mark.slow
def test_demo(tmp_path, capsys):
    data = said(capsys, "demo", "--out", tmp_path)
    assert data == json.loads((tmp_path / "demo.json").read_text())


def test_blind_prints_the_scores_alone(tmp_path, capsys, monkeypatch):
    """What the check itself prints goes to standard error."""

    def check(arguments):
        print("a line for people")
        (arguments.out / "seal.txt").write_text("abc\n")
        (arguments.out / "scores.json").write_text('{"top1": {"value": 1.0}}')
        return 0

    monkeypatch.setattr(blind.command, "blind", check)
    assert blind.main(["--cases", "1", "--seed", "1", "--out", str(tmp_path), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data == {"seal": "abc", "scores": {"top1": {"value": 1.0}}}


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_knows_commands_options_and_environments(shell, capsys):
    assert cli.main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for word in ("diagnose-all", "calibrate-sensor", "time-budget", "GripperTactileSteady-v0"):
        assert word in script


def test_bash_completes(capsys):
    assert cli.main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    ask = 'COMP_WORDS=(tiago-mj dia); COMP_CWORD=1; _shtab_tiago_mj; echo "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "-c", f"{script}\n{ask}"], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["diagnose", "diagnose-all"], done.stderr
