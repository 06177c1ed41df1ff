"""Options that say of which robot recordings are: the same for every command on recordings of a model."""

from __future__ import annotations

import argparse
import json

import mujoco
import numpy as np
import pytest
from test_known_robots import GAINS, menagerie, recorded

from tiago_mj import cli
from tiago_mj.cli import options as declared
from tiago_mj.gap import command as diagnosing
from tiago_mj.gap import diagnose_all
from tiago_mj.models import as_driven
from tiago_mj.recordings import like
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError
from tiago_mj.robots import options
from tiago_mj.robots.known import named
from tiago_mj.view.recordings import library

GO2 = named("go2")
WORDS = ("--robot", "go2", "--gains", "60,3", "--fix-base", "--like", "FL,FR", "--tie")


def parsed(*words):
    parser = argparse.ArgumentParser()
    declared.add_robot(parser)
    return parser.parse_args(words)


def test_what_is_said_of_a_robot_becomes_facts_of_its_recordings_and_can_be_said_again(tmp_path):
    folder = menagerie(tmp_path, GO2)
    given = parsed(*WORDS, "--menagerie", str(folder))
    said = options.said(given)
    assert said.model == folder / GO2.folder / GO2.file
    assert said.facts == {
        "gains": "60,3",
        "base": "fixed",
        "like": ["FL", "FR"],
        "tie": True,
    }
    assert options.said(parsed(*options.words(given))) == said
    assert options.said(parsed("--model", "arm.xml")).facts == {}
    assert options.words(parsed("--env", "GripperTactile-v0")) == ["--env", "GripperTactile-v0"]


@pytest.mark.parametrize("name", ["diagnose", "diagnose-all", "compare", "preflight", "record", "view"])
def test_every_command_on_recordings_of_a_model_takes_them(name):
    places = {"compare": ["before", "after"], "record": ["--motion", "m.csv"]}.get(name, ["logs"])
    out = [] if name in ("preflight", "view") else ["--out", "out"]
    asked = cli.build_parser(name).parse_args([name, *places, *WORDS, *out])
    assert (asked.robot, asked.gains, asked.fix_base, asked.like, asked.tie) == ("go2", "60,3", True, "FL,FR", True)


def test_diagnose_all_hands_them_to_each_diagnosis_with_absolute_paths(tmp_path, monkeypatch):
    folder = menagerie(tmp_path / "menagerie", GO2)
    (tmp_path / "logs").mkdir()
    tasks = []

    def diagnosed(task):
        tasks.append(task)
        return diagnose_all.Outcome(2, "not run")

    monkeypatch.setattr(diagnose_all, "diagnose", diagnosed)
    monkeypatch.chdir(tmp_path)
    words = ["diagnose-all", "logs", *WORDS, "--menagerie", str(folder.relative_to(tmp_path)), "--out", "out"]
    assert cli.main(words) == 2
    again = cli.build_parser("diagnose").parse_args(list(tasks[0].words))
    assert (again.robot, again.gains, again.fix_base, again.like, again.tie) == ("go2", "60,3", True, "FL,FR", True)
    assert again.menagerie == folder
    line = diagnosing.words(again)
    assert [word for word in line if word in ("--fix-base", "--tie")] == ["--fix-base", "--tie"]
    assert line[line.index("--like") + 1] == "FL,FR"


def test_the_line_that_shows_an_answer_says_all_that_was_said_of_the_robot(tmp_path):
    folder, logs = menagerie(tmp_path / "menagerie", GO2), recorded(tmp_path / "logs", GO2)
    words = ["diagnose", str(logs), "--menagerie", str(folder), *WORDS, "--out", str(tmp_path / "out")]
    asked = cli.build_parser("diagnose").parse_args(words)
    shown = cli.build_parser("view").parse_args(diagnosing.view(asked)[1:])
    assert options.said(shown) == options.said(asked)
    assert (shown.diagnosis, shown.recordings) == (tmp_path / "out", [logs])
    seen = library(shown.recordings, options.said(shown))
    assert set(seen.trials[0].positions) == set(GO2.joints.values())
    assert seen.plant.model.nv == len(GO2.joints)  # its base is held


def test_a_floating_robot_is_recorded_with_its_base_held_and_its_motors_controlled(tmp_path):
    folder = menagerie(tmp_path / "menagerie", GO2)
    motion = tmp_path / "go2.csv"
    assert cli.main(["robots", "go2", "--motion", str(motion)]) == 0
    gains = "{},{}".format(*GAINS)
    words = ["record", "--robot", "go2", "--menagerie", str(folder), "--motion", str(motion), "--gains", gains]
    assert cli.main([*words, "--fix-base", "--like", "FL,FR,RL,RR", "--out", str(tmp_path / "logs")]) == 0
    sidecar = json.loads((tmp_path / "logs" / "go2-000.json").read_text())
    assert (sidecar["base"], sidecar["gains"], sidecar["like"]) == ("fixed", gains, ["FL", "FR", "RL", "RR"])
    assert sidecar["interface"] == "position"
    (trial,) = read_recordings([tmp_path / "logs"]).trials
    joints = set(GO2.joints.values())
    assert set(trial.positions) == set(trial.efforts) == joints  # goals became torques, as a real robot's would
    travelled = {name: float(np.ptp(values)) for name, values in trial.positions.items()}
    assert min(travelled.values()) > 0.1  # every leg follows, and none falls


def test_a_motor_under_a_controller_gives_its_own_torque_at_most(tmp_path):
    path = tmp_path / "arm.xml"
    body = '<body><joint name="j" axis="0 1 0"/><geom size=".05" mass="1"/></body>'
    path.write_text(
        f"<mujoco><worldbody>{body}</worldbody><actuator>"
        '<motor name="j" joint="j" ctrlrange="-2 2"/></actuator></mujoco>'
    )
    model = as_driven.load(path, stated="100,1")
    data = mujoco.MjData(model)
    data.ctrl[:] = 1.0
    mujoco.mj_forward(model, data)
    assert data.actuator_force[0] == pytest.approx(2.0)  # 100 N·m are asked for
    data.ctrl[:] = 0.01
    mujoco.mj_forward(model, data)
    assert data.actuator_force[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--model", "{}/servo.xml", "--gains", "20,1"], "is a servo that has its gains"),
        (["--model", "{}/geared.xml", "--gains", "20,1"], "motors without a gear"),
        (["--model", "{}/motor.xml", "--gains", "kp=±30%"], "says no stiffness"),
        (["--model", "{}/motor.xml", "--fix-base"], "does not float"),
        (["--env", "GripperTactile-v0", "--fix-base"], "are of a model"),
        (["--robot", "nobody"], "no such robot"),
    ],
)
def test_what_does_not_fit_a_model_that_is_recorded_is_one_line(tmp_path, capsys, words, said):
    kinds = {"servo": '<position joint="j" kp="9" name="j"/>', "geared": '<motor joint="j" gear="5" name="j"/>'}
    for name, drive in {**kinds, "motor": '<motor joint="j" name="j"/>'}.items():
        (tmp_path / f"{name}.xml").write_text(
            '<mujoco><worldbody><body><joint name="j"/><geom size=".05"/></body></worldbody>'
            f"<actuator>{drive}</actuator></mujoco>"
        )
    given = [word.format(tmp_path) for word in words]
    assert cli.main(["record", *given, "--policy", "random", "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_tie_without_like_parts_is_one_line(tmp_path):
    rows = [f"{0.1 * k:.1f},{k},{k}" for k in range(30)]
    (tmp_path / "log.csv").write_text("\n".join(["time,command.j,position.j", *rows]))
    (tmp_path / "log.json").write_text(json.dumps({"robot": "GripperTactile-v0", "interface": "position", "tie": True}))
    trials = read_recordings([tmp_path / "log.csv"]).trials
    with pytest.raises(RecordingError, match="give --like FL,FR,RL,RR"):
        like.tied(trials)
