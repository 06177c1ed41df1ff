"""Cases whose recordings hold motion and measured efforts: what they tell, and that it is what the drives give."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pyarrow.parquet as pq
import pytest

from benchmarks.blind import cases, effort_sensors, efforts, recordings, robots
from benchmarks.blind.dictionary import ARM, PLAIN, SIX
from benchmarks.blind.effort_sensors import CURRENT, SENSOR


def made(setting: str, effort: str, folder: Path, **changes: float) -> cases.Made:
    robots.put_model(setting, folder)
    rate, _, seconds = efforts.SESSION[setting]
    case = cases.Case(
        seed=7,
        setting=setting,
        interface="position",
        rate=rate,
        trials=1,
        seconds=min(seconds, 2.0),
        version=9,
        effort=effort,
    )
    return cases.simulate(replace(case, **changes), folder)


def test_a_run_holds_every_kind_of_case_robot_and_sensor_and_a_longer_one_begins_like_it() -> None:
    planned = efforts.cases(60, 1)
    assert {case.kind for case in planned} == {"none", "one", "two", "outside"}
    assert {case.setting for case in planned} == {PLAIN, ARM, SIX}
    assert {case.effort for case in planned} == {SENSOR, CURRENT}
    assert efforts.cases(80, 1)[:60] == planned
    cogging = [case for case in planned if any(e.name == "motor_cogging" for e in case.effects)]
    assert all(case.effort == CURRENT for case in cogging), "a sensor behind the motor does not see it"


@pytest.mark.parametrize("setting", [ARM, PLAIN, SIX])
def test_centres_of_mass_lie_off_by_the_share_of_the_reach_that_is_asked_for(setting: str, tmp_path: Path) -> None:
    one = made(setting, SENSOR, tmp_path, off_centre=0.03)
    robot, usual = one.robot.model, cases.real_robot(replace(one.case, off_centre=0.0), tmp_path).model
    moved = np.flatnonzero(usual.body_weldid)
    off = np.abs(robot.body_ipos - usual.body_ipos)
    # Two deviations at most, of 0.41 m at most: the longest reach of a link of these arms.
    assert (off[moved].max(axis=1) > 0).all()
    assert off.max() <= 2 * 0.03 * 0.41
    assert np.array_equal(robot.body_mass, usual.body_mass)
    assert not off[np.flatnonzero(usual.body_weldid == 0)].any()


@pytest.mark.parametrize("setting", [PLAIN, SIX])
@pytest.mark.parametrize("effort", [SENSOR, CURRENT])
def test_efforts_are_what_inverse_dynamics_of_the_real_robot_say(setting: str, effort: str, tmp_path: Path) -> None:
    """But for the sensor's gain, offset and noise; rows are too far apart for the fastest accelerations."""
    one = made(setting, effort, tmp_path)
    robot, recorded, sensor = one.robot, one.recorded, one.setup.effort
    assert sensor is not None
    assert recorded.effort is not None
    time, q = recorded.time[0], recorded.position[0]
    data, smooth = mujoco.MjData(robot.model), np.ones(9) / 9
    wide = np.apply_along_axis(np.convolve, 0, q, smooth, "same")
    v = np.gradient(wide, time, axis=0)
    a = np.apply_along_axis(np.convolve, 0, np.gradient(v, time, axis=0), smooth, "same")
    expected = np.zeros_like(q)
    for k in range(len(time)):
        data.qpos[robot.qpos], data.qvel[robot.dof], data.qacc[robot.dof] = wide[k], v[k], a[k]
        mujoco.mj_inverse(robot.model, data)
        expected[k] = data.qfrc_inverse[robot.dof]
    slow = np.abs(a) < np.quantile(np.abs(a), 0.6, axis=0)
    slow[:20] = slow[-20:] = False
    for j in range(len(robot.joints)):
        there = slow[:, j]
        said = sensor.gain[j] * expected[there, j] + sensor.offset[j]
        rest = recorded.effort[0, there, j] - said
        assert np.median(np.abs(rest)) < 3 * sensor.noise[j], robot.joints[j]


def test_a_torque_sensor_is_late_and_a_current_is_not(tmp_path: Path) -> None:
    one = made(PLAIN, SENSOR, tmp_path)
    assert one.setup.effort is not None
    quiet = replace(one.setup.effort, delay=0.0, noise=np.zeros(1))
    late = replace(quiet, delay=0.02)
    plan = one.recorded.commands
    both = []
    for sensor in (quiet, late):
        robot = cases.real_robot(one.case, tmp_path)
        both.append(cases.reality.simulate(robot, [], replace(one.setup, effort=sensor), plan).effort)
    rows = round(0.02 * one.case.rate)
    assert both[0] is not None
    assert both[1] is not None
    assert np.abs(both[1][0, 60 + rows :, 0] - both[0][0, 60:-rows, 0]).max() < 0.25
    assert np.abs(both[1] - both[0]).max() > 0.5
    assert effort_sensors.sensor(CURRENT, 7, one.robot).delay == 0.0


def test_files_tell_efforts_and_no_commands(tmp_path: Path) -> None:
    one = made(SIX, CURRENT, tmp_path)
    recordings.write(one, tmp_path / "recordings")
    columns = pq.read_table(tmp_path / "recordings" / "trial-00.parquet").column_names
    assert not [name for name in columns if name.startswith("command.")]
    assert [name for name in columns if name.startswith("effort.")] == [f"effort.{j}" for j in one.robot.joints]
    sidecar = json.loads((tmp_path / "recordings" / "trial-00.json").read_text())
    assert "interface" not in sidecar
    assert "set_point" not in sidecar["initial"]
    assert sidecar["uncertainty"] == {"torque_constant": effort_sensors.CONSTANT}
    assert sidecar["robot"] == "six_joints.xml"
