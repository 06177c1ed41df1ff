"""Names that do not match are errors at once; those that can only mean one thing are taken."""

import csv
import json

import numpy as np
import pandas as pd
import pytest

from tiago_mj.cli import main
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings import lint
from tiago_mj.recordings.lint.names import check_names
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="shoulder" axis="0 1 0" range="-2.5 2.5" damping="0.5" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"/>
      <body pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" range="-2.5 2.5" damping="0.5" armature="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""
SERVOS = """
    <position name="motor_1" joint="shoulder" kp="200" kv="20"/>
    <position name="motor_2" joint="elbow" kp="200" kv="20"/>
"""
MAP = {
    "t_ms": {"kind": "time", "unit": "ms"},
    "shoulder_goal": "command.motor_1",
    "elbow_goal": "command.motor_2",
    "shoulder_angle": "position.shoulder",
    "elbow_angle": "position.elbow",
}
OWN = {  # the same columns by the contract's names
    "t_ms": "time",
    "shoulder_goal": "command.motor_1",
    "elbow_goal": "command.motor_2",
    "shoulder_angle": "position.shoulder",
    "elbow_angle": "position.elbow",
}
FACTS = {"rate_hz": 100, "interface": "position"}


def model(folder, actuators=SERVOS):
    path = folder / "arm.xml"
    path.write_text(ARM.format(actuators=actuators))
    return path


def table(number=0, held=None):
    """Both joints swing and follow their goals at once; ``held``: the elbow stays there."""
    time = np.arange(300) / 100
    shoulder = 0.8 * np.sin(2 * np.pi * 0.5 * time + number)
    elbow = 0.7 * np.sin(2 * np.pi * 0.8 * time) if held is None else np.full(300, held)
    noise = 1e-4 * np.random.default_rng(number).standard_normal((2, 300))
    lagging = [np.interp(time - 0.03, time, values) + n for values, n in zip((shoulder, elbow), noise, strict=True)]
    return dict(zip(OWN, (1e3 * time, shoulder, elbow, *lagging), strict=True))


def logs(folder, rename, *, facts=FACTS, drop=(), held=None, count=2, renamed_in=None):
    """CSV files; columns are called as ``rename`` says, in those files alone whose numbers are given."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        here = rename if renamed_in is None or number in renamed_in else {}
        made = {here.get(name, name): values for name, values in table(number, held).items() if name not in drop}
        if "time" in made:
            made["time"] = made["time"] / 1e3
        with (folder / f"log-{number}.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(made)
            writer.writerows(zip(*made.values(), strict=True))
        if facts is not None:
            (folder / f"log-{number}.json").write_text(json.dumps(facts))
    return folder


def map_file(folder, columns):
    path = folder / "logs.yaml"
    path.write_text(json.dumps({"columns": columns}))
    return path


def refused(capsys, command, *words):
    capsys.readouterr()
    assert main([command, *map(str, words)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1, line
    assert line.startswith(f"tiago-mj {command}: ")
    return line


def looked_at(folder, arm, **options):
    """What is found in recordings of a model, and the trials."""
    read = read_recordings([folder], robot=str(arm), defaults={"robot": str(arm)}, **options)
    findings = (*read.findings, *lint.inspect_all(read.trials, plant_of(read.trials, model=arm)))
    lint.refuse(read.trials, findings)
    return findings, read.trials


# What does not match -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["preflight", "diagnose"])
@pytest.mark.parametrize("column", ["elbow_goal", "elbow_angle", "t_ms"])
@pytest.mark.parametrize("mistyped", ["map", "files"])
def test_a_column_that_the_map_names_and_no_file_has_is_an_error(tmp_path, capsys, command, column, mistyped):
    slip = column[:-2] + column[-1] + column[-2]
    columns = {slip if name == column and mistyped == "map" else name: to for name, to in MAP.items()}
    folder = logs(tmp_path / "logs", {column: slip} if mistyped == "files" else {})
    out = () if command == "preflight" else ("--out", tmp_path / "out")
    line = refused(capsys, command, folder, "--model", model(tmp_path), "--map", map_file(tmp_path, columns), *out)
    asked, there = (slip, column) if mistyped == "map" else (column, slip)
    assert f"map file logs.yaml: column {asked!r}: no recording has it; did you mean {there!r}?" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("column", ["elbow_goal", "elbow_angle"])
def test_a_column_that_is_mistyped_in_one_file_is_an_error_of_that_file(tmp_path, capsys, column):
    folder = logs(tmp_path / "logs", {column: f"{column}_"}, renamed_in=[1])
    line = refused(capsys, "preflight", folder, "--model", model(tmp_path), "--map", map_file(tmp_path, MAP))
    assert f"log-1.csv: column '{column}_': did you mean {column!r}?" in line
    left = map_file(tmp_path, {**MAP, f"{column}_": None})
    if column == "elbow_angle":
        assert looked_at(folder, model(tmp_path), map_file=left)
    else:
        with pytest.raises(RecordingError, match=r"log-1.csv: column command.motor_2: no column has it"):
            looked_at(folder, model(tmp_path), map_file=left)


@pytest.mark.parametrize("part", ["name", "file"])
@pytest.mark.parametrize(
    ("column", "slip", "said"),
    [
        ("elbow_goal", "command.motor_w", "no actuator 'motor_w': did you mean 'motor_2'?"),
        ("elbow_goal", "command.valve", "no actuator 'valve', it has motor_1, motor_2"),
        ("elbow_angle", "position.elbwo", "no joint 'elbwo': did you mean 'elbow'?"),
        ("elbow_angle", "position.gripper", "no joint 'gripper', it has shoulder, elbow"),
    ],
)
def test_a_name_that_the_model_does_not_have_is_an_error(tmp_path, capsys, part, column, slip, said):
    if part == "name":
        words = (logs(tmp_path / "logs", {}), "--map", map_file(tmp_path, {**MAP, column: slip}))
    else:
        words = (logs(tmp_path / "logs", {**OWN, column: slip}),)
    line = refused(capsys, "diagnose", *words, "--model", model(tmp_path), "--out", tmp_path / "out")
    assert f"log-0.csv: column {slip}: the model has {said}" in line


def test_a_mistyped_kind_is_an_error(tmp_path, capsys):
    folder = logs(tmp_path / "logs", {**OWN, "elbow_angle": "positions.elbow"})
    line = refused(capsys, "preflight", folder, "--model", model(tmp_path))
    assert "log-0.csv: column 'positions.elbow': did you mean 'position.elbow'?" in line


def test_the_map_says_that_a_column_is_to_be_left_out(tmp_path):
    arm, folder = model(tmp_path), tmp_path / "logs"
    logs(folder, OWN)
    for path in folder.glob("*.csv"):
        read = pd.read_csv(path)
        read.assign(**{"position.gripper": read["position.elbow"], "effort.gripper": 0.0}).to_csv(path, index=False)
    with pytest.raises(RecordingError, match=r"no joint 'gripper'.*to null to leave it out"):
        looked_at(folder, arm)
    ignoring = map_file(tmp_path, {"position.gripper": None, "effort.gripper": None, "position.not_here": None})
    findings, trials = looked_at(folder, arm, map_file=ignoring)
    assert "gripper" not in trials[0].positions
    assert not [finding for finding in findings if "gripper" in finding.channel]


def test_what_a_bag_holds_of_joints_beyond_the_model_is_left_out_and_said(tmp_path):
    """Nobody typed its names; whoever imports the bag gets the same."""
    arm = model(tmp_path)
    folder = logs(tmp_path / "logs", {**OWN}, facts={**FACTS, "source": {"bag": "whole_robot.mcap"}})
    for path in folder.glob("*.csv"):
        read = pd.read_csv(path)
        read.assign(**{"position.wheel": read["position.elbow"]}).to_csv(path, index=False)
    findings, _ = looked_at(folder, arm)
    assert {("contradiction", "position.wheel", True)} == {
        (f.code, f.channel, f.discredits) for f in findings if "wheel" in f.channel
    }


def test_forces_are_left_out_where_the_model_has_no_load_cell(tmp_path):
    (trial, _) = looked_at(logs(tmp_path / "logs", OWN), model(tmp_path))[1]
    pressed = type(trial)(**{**trial.__dict__, "forces": {"wrist": np.ones(300)}})
    (said,) = check_names([pressed], ("shoulder", "elbow"), ("motor_1", "motor_2"), ())
    assert said.discredits
    (said,) = check_names([pressed], ("shoulder", "elbow"), ("motor_1", "motor_2"), ("right",))
    assert said.refuses


# Actuators that nothing commands -------------------------------------------------------------------------------------


def test_an_actuator_without_commands_whose_joint_moves_is_an_error(tmp_path, capsys):
    arm = model(tmp_path)
    folder = logs(tmp_path / "logs", OWN, drop=["elbow_goal"])
    line = refused(capsys, "diagnose", folder, "--model", arm, "--out", tmp_path / "out")
    assert "column command.motor_2: no column has it, although the joint 'elbow' goes 1.4 rad" in line
    for name in ("command.motor_2", "command.elbow"):  # it is limp on purpose
        findings, _ = looked_at(folder, arm, map_file=map_file(tmp_path, {name: None}))
        assert "missing_column" not in {finding.code for finding in findings}


@pytest.mark.parametrize("measured", [True, False])
def test_an_actuator_that_holds_still_on_purpose_needs_no_commands_and_holds(tmp_path, measured):
    """It is said in one line, and the simulated servo holds the joint where it was, not at 0."""
    arm = model(tmp_path)
    drop = ["elbow_goal"] if measured else ["elbow_goal", "elbow_angle"]
    findings, trials = looked_at(logs(tmp_path / "logs", OWN, drop=drop, held=0.6), arm)
    (said,) = [row for row in lint.summary(findings) if row.code == "missing_column"]
    assert "holds still" in str(said)
    if measured:
        plant = plant_of(trials, model=arm)
        simulated = replay.simulate(plant, replay.grid(plant, trials), [(0, ())], replay.Run(threads=1)).position
        assert np.abs(simulated[0, :, plant.joints.index("elbow")] - 0.6).max() < 0.15  # 3 N·m of weight, 200 N·m/rad


def test_efforts_without_commands_need_no_commands(tmp_path):
    arm = model(tmp_path)
    rename = {**OWN, "shoulder_goal": "effort.shoulder", "elbow_goal": "effort.elbow"}
    _, trials = looked_at(logs(tmp_path / "logs", rename, facts={"rate_hz": 100}), arm)
    assert not trials[0].commands


def test_a_command_that_only_a_later_recording_has_is_replayed(tmp_path):
    arm = model(tmp_path)
    folder = logs(tmp_path / "logs", OWN, drop=["elbow_goal"], held=0.0, count=1)
    logs(tmp_path / "more", OWN, count=2)
    (tmp_path / "more" / "log-1.csv").rename(folder / "log-1.csv")
    (tmp_path / "more" / "log-1.json").rename(folder / "log-1.json")
    _, trials = looked_at(folder, arm)
    assert set(plant_of(trials, model=arm).actuators) == {"motor_1", "motor_2"}


# Names and interfaces that can only mean one thing -------------------------------------------------------------------


def test_commands_named_by_their_joints_are_those_of_the_actuators_that_drive_them(tmp_path):
    rename = {**OWN, "shoulder_goal": "command.shoulder", "elbow_goal": "command.elbow"}
    findings, trials = looked_at(logs(tmp_path / "logs", rename), model(tmp_path))
    assert set(trials[0].commands) == {"motor_1", "motor_2"}
    (said,) = [row for row in lint.summary(findings) if row.code == "missing_column"]
    assert "taken for the command of its actuator 'motor_1'" in str(said)
    assert said.repaired


@pytest.mark.parametrize(
    ("more", "rename", "said"),
    [
        ('<motor name="spring" joint="elbow"/>', {"elbow_goal": "command.elbow"}, "is driven by motor_2, spring"),
        ("", {"elbow_goal": "command.elbow", "shoulder_goal": "command.motor_2"}, "both are of the actuator 'motor_2'"),
    ],
)
def test_a_joints_command_that_may_be_of_two_is_refused(tmp_path, capsys, more, rename, said):
    folder = logs(tmp_path / "logs", {**OWN, **rename})
    assert said in refused(capsys, "preflight", folder, "--model", model(tmp_path, SERVOS + more))


def test_an_actuators_own_name_counts_more_than_a_joints(tmp_path):
    crossed = SERVOS.replace("motor_1", "elbow").replace("motor_2", "shoulder")
    rename = {**OWN, "shoulder_goal": "command.elbow", "elbow_goal": "command.shoulder"}
    findings, trials = looked_at(logs(tmp_path / "logs", rename), model(tmp_path, crossed))
    np.testing.assert_allclose(trials[0].commands["elbow"], table()["shoulder_goal"])
    assert "missing_column" not in {finding.code for finding in findings}


KINDS = {
    "position": '<position name="{0}" joint="{1}" kp="200" kv="20"/>',
    "general servo": '<general name="{0}" joint="{1}" gainprm="200" biastype="affine" biasprm="0 -200 -20"/>',
    "velocity": '<velocity name="{0}" joint="{1}" kv="20"/>',
    "integrating": '<intvelocity name="{0}" joint="{1}" kp="200" kv="20" actrange="-3 3"/>',
    "effort": '<motor name="{0}" joint="{1}"/>',
}
TAKES = {"general servo": "position", "integrating": "velocity"}


def actuators(first, second):
    return KINDS[first].format("motor_1", "shoulder") + KINDS[second].format("motor_2", "elbow")


@pytest.mark.parametrize("kind", KINDS)
def test_what_commands_are_is_what_the_models_actuators_take_where_nothing_says_it(tmp_path, kind):
    arm = model(tmp_path, actuators(kind, kind))
    folder = logs(tmp_path / "logs", OWN, facts={"rate_hz": 100})
    read = read_recordings([folder], robot=str(arm), defaults={"robot": str(arm)})
    assert {trial.sidecar.interface for trial in read.trials} == {TAKES.get(kind, kind)}
    (said,) = lint.summary(read.findings)
    assert f"read as what the model's actuators take: {TAKES.get(kind, kind)}" in str(said)
    logs(folder, OWN, facts={"rate_hz": 100, "interface": "position"})
    read = read_recordings([folder], robot=str(arm), defaults={"robot": str(arm)})
    assert ({trial.sidecar.interface for trial in read.trials}, read.findings) == ({"position"}, ())


def test_what_the_model_does_not_tell_is_asked_for(tmp_path, capsys):
    folder = logs(tmp_path / "logs", OWN, facts={"rate_hz": 100})
    mixed = model(tmp_path, actuators("position", "effort"))
    assert "take several kinds (motor_1 position, motor_2 effort)" in refused(
        capsys, "preflight", folder, "--model", mixed
    )
    muscles = '<muscle name="motor_1" joint="shoulder" lengthrange="-1 1"/>' + KINDS["effort"].format("x", "elbow")
    read = {**OWN, "elbow_goal": "extra.goal"}
    other = logs(tmp_path / "other", read, facts={"rate_hz": 100})
    assert "what its commands are is unknown" in refused(
        capsys, "preflight", other, "--model", model(tmp_path, muscles)
    )


@pytest.mark.parametrize(
    ("kind", "stated", "takes"),
    [
        ("effort", "position", "effort"),
        ("position", "effort", "position or velocity"),
        ("velocity", "position", "velocity"),
        ("position", "velocity", None),  # it moves the set point
        ("integrating", "position", None),
        ("effort", "effort", None),
    ],
)
def test_an_interface_that_the_models_actuators_do_not_take_is_said(tmp_path, kind, stated, takes):
    arm = model(tmp_path, actuators(kind, kind))
    folder = logs(tmp_path / "logs", OWN, facts={"rate_hz": 100, "interface": stated})
    trials = read_recordings([folder], robot=str(arm), defaults={"robot": str(arm)}).trials
    findings = lint.inspect_all(trials, plant_of(trials, model=arm))
    said = [row for row in lint.summary(findings) if "the model's actuator" in row.what]
    assert len(said) == (takes is not None)
    assert not said or f"is {stated!r}, and the model's actuator 'motor_1' takes {takes}:" in str(said[0])


def test_the_simulated_model_counts_and_not_the_one_that_a_sidecar_names(tmp_path):
    arm = model(tmp_path)
    folder = logs(
        tmp_path / "logs",
        {**OWN, "elbow_goal": "command.elbow"},
        facts={**FACTS, "robot": "tiago_mj/GripperTactile-v0"},
    )
    trials = read_recordings([folder], robot=str(arm)).trials
    assert set(trials[0].commands) == {"motor_1", "motor_2"}
