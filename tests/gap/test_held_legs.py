"""Robots whose base floats in the model and was held, and whose motors have controllers of stated gains."""

from __future__ import annotations

import json

import mujoco
import numpy as np
import pytest

from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.models.held_base import with_held_base
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError

LEG = """
<body name="{0}" pos="{1} 0 0"><joint name="{0}_knee_joint" axis="0 1 0" range="-2 2"/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".5"/></body>"""
ROBOT = f"""
<mujoco><option timestep="0.002"/><worldbody>
<body name="cube" pos="2 0 0"><freejoint/><geom size=".1"/></body>
<body name="base" pos="0 0 1"><freejoint name="root"/><geom size=".1" mass="3"/>{LEG.format("L", 0.2)}
{LEG.format("R", -0.2)}</body></worldbody>
<actuator><motor name="L_knee" joint="L_knee_joint"/><motor name="R_knee" joint="R_knee_joint"/></actuator>
<keyframe><key qpos="2 0 0 1 0 0 0 0 0 0.3 1 0 0 0 0.5 -0.5"/></keyframe></mujoco>
"""


def recorded(folder, **facts):
    """A recording of goals and positions of two knees, 2 s at 100 Hz."""
    time = np.arange(200) / 100
    goal, position = np.sin(3 * time), 0.9 * np.sin(3 * time - 0.1)
    rows = np.stack([time, goal, -goal, position, -position], axis=1)
    header = "time,command.L_knee,command.R_knee_joint,position.L_knee_joint,position.R_knee_joint"
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=header, comments="")
    (folder / "robot.xml").write_text(ROBOT)
    (folder / "log.json").write_text(json.dumps({"robot": "robot.xml", **facts}))
    return folder / "log.csv", time, goal, position


def test_goals_of_motors_become_the_torques_that_their_gains_ask_for(tmp_path):
    log, time, goal, position = recorded(tmp_path, gains="20±10%,0.5", interface="position")
    read = read_recordings([log])
    (trial,) = read.trials
    between = (goal + np.concatenate([goal[:1], goal[:-1]])) / 2  # of the goals that end and begin at a row
    wanted = 20 * (between - position) - 0.5 * np.gradient(position, time)
    assert not trial.commands
    assert trial.efforts["L_knee_joint"] == pytest.approx(wanted)
    assert trial.efforts["R_knee_joint"] == pytest.approx(-wanted)
    assert trial.sidecar.raw["uncertainty"] == {"torque_constant.L_knee": 0.1, "torque_constant.R_knee": 0.1}
    assert any("kp=20" in finding.message for finding in read.findings)


def test_held_goals_leave_no_viscous_friction_that_the_joint_has_not(tmp_path):
    """A knee of known inertia and damping under a controller at 1 kHz whose goals are held for 20 ms: what the torques
    at the rows say of both, by least squares. Half a row of 10 ms would be 0.2 N·m·s/rad, four times the damping."""
    inertia, damping, kp, kv, row, step = 0.1, 0.05, 20.0, 1.0, 0.02, 0.001
    angle, rate, rows, time = 0.0, 0.0, [], np.arange(0, 8, row)
    for at in time:
        goal = 0.5 * np.sin(3 * at) + 0.2 * np.sin(7 * at)
        rows.append((at, goal, angle))
        for _ in range(round(row / step)):
            rate += step * (kp * (goal - angle) - (kv + damping) * rate) / inertia
            angle += step * rate
    table = np.asarray(rows)
    header = "time,command.L_knee,command.R_knee,position.L_knee_joint,position.R_knee_joint"
    log = recorded(tmp_path, gains=f"{kp},{kv}", interface="position")[0]
    np.savetxt(log, table[:, [0, 1, 1, 2, 2]], delimiter=",", header=header, comments="")
    (trial,) = read_recordings([log]).trials
    velocity = np.gradient(table[:, 2], time)
    motion = np.stack([np.gradient(velocity, time), velocity], axis=1)[5:-5]
    found = np.linalg.lstsq(motion, trial.efforts["L_knee_joint"][5:-5], rcond=None)[0]
    assert found[0] == pytest.approx(inertia, rel=0.05)
    assert found[1] == pytest.approx(damping, abs=0.02)


def test_gains_without_a_value_and_positions_that_are_missing_end_in_one_line(tmp_path):
    log, *_ = recorded(tmp_path, gains="kp=±10%,kv=1")
    with pytest.raises(RecordingError, match="give the controller's gains with values"):
        read_recordings([log])
    log, *_ = recorded(tmp_path, gains="20,1")
    log.write_text(log.read_text().replace("position.L_knee_joint", "extra.other"))
    with pytest.raises(RecordingError, match=r"position\.L_knee_joint is missing"):
        read_recordings([log])


def test_commands_of_motors_without_gains_are_torques_as_before(tmp_path):
    log, _, goal, _ = recorded(tmp_path)
    (trial,) = read_recordings([log]).trials
    assert trial.sidecar.interface == "effort"
    assert trial.commands["L_knee"] == pytest.approx(goal)


def test_a_held_base_does_not_move_and_an_object_stays_free(tmp_path):
    recorded(tmp_path)
    model = with_held_base(tmp_path / "robot.xml")
    assert (model.njnt, model.nq, model.nu) == (3, 9, 2)
    assert model.key_qpos[0] == pytest.approx([2, 0, 0, 1, 0, 0, 0, 0.5, -0.5])
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    assert data.body("base").xpos == pytest.approx([0, 0, 1])
    (tmp_path / "held.xml").write_text("<mujoco><worldbody/></mujoco>")
    with pytest.raises(ValueError, match="does not float"):
        with_held_base(tmp_path / "held.xml")


def test_a_sidecar_says_that_the_base_was_held(tmp_path):
    log, *_ = recorded(tmp_path, base="fixed")
    plant = plant_of(read_recordings([log]).trials)
    assert plant.model.nv == 8
    assert set(plant.joints) == {"L_knee_joint", "R_knee_joint"}
