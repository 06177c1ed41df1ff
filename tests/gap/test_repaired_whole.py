"""From recordings to a repaired model by the command, as a user runs it."""

from __future__ import annotations

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_motions import PENDULUM, pendulum, record

from tiago_mj.cli import main
from tiago_mj.effects import read_effects
from tiago_mj.gap import apply
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.write import write_trial

POSITION = '<position name="swing" joint="swing" kp="9" kv=".3" ctrlrange="-1 1"/>'
SERVO = PENDULUM.replace('<motor name="swing" joint="swing"/>', POSITION)


@pytest.mark.slow
def test_recordings_of_efforts_alone_end_in_a_repaired_model_too(tmp_path):
    model = pendulum()
    model.dof_frictionloss[:] += 0.3
    (tmp_path / "pendulum.xml").write_text(PENDULUM)
    seen = record(model, ("swing",), seconds=40.0)
    sidecar = replace(seen.sidecar, robot=str(tmp_path / "pendulum.xml"), rate_hz=100.0)
    write_trial(replace(seen, sidecar=sidecar), tmp_path / "logs")
    words = ["diagnose", str(tmp_path / "logs"), "--model", str(tmp_path / "pendulum.xml")]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    (named,) = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["verdict"]["effects"]
    assert named["name"] == "coulomb_friction"
    repaired = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "repaired.xml"))
    assert repaired.dof_frictionloss[0] == pytest.approx(0.02 + named["parameters"]["force"]["value"])


@pytest.mark.slow
def test_what_a_diagnosis_writes_is_the_simulator_that_it_reports(tmp_path, capsys):
    """The file, apply and the replay do the same; the search is given little time, since any answer will do."""
    (tmp_path / "servo.xml").write_text(SERVO)
    effects = json.dumps([{"name": "coulomb_friction", "parameters": {"force": 0.4}}])
    recording = ["record", "--model", str(tmp_path / "servo.xml"), "--policy", "random", "--episodes", "2"]
    assert main([*recording, "--effects", effects, "--out", str(tmp_path / "logs")]) == 0
    words = ["diagnose", str(tmp_path / "logs"), "--model", str(tmp_path / "servo.xml"), "--time-budget", "5"]
    words += [
        "--without",
        "stribeck_friction,load_dependent_friction,asymmetric_friction",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main([*words, "--effects", '{"command_delay": {"seconds": 0.02}}']) == 0
    assert "repaired.xml is the model with command delay" in capsys.readouterr().out
    calibration = tmp_path / "out" / "calibration.yaml"
    trials = read_recordings([tmp_path / "logs"]).trials
    plant = plant_of(trials, model=tmp_path / "servo.xml", given=read_effects(calibration))
    expected = replay.simulate(plant, replay.grid(plant, trials), [(0, ())], replay.Run(threads=1)).position[0]
    robot = apply(mujoco.MjModel.from_xml_path(str(tmp_path / "servo.xml")), calibration)
    robot.reset({"swing": trials[0].positions["swing"][0]})
    seen = [robot.position]
    for sent in trials[0].commands["swing"][:-1]:
        robot.step([sent])
        seen.append(robot.position)
    np.testing.assert_allclose(np.array(seen), expected, rtol=0, atol=1e-9)
    mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "repaired.xml"))
