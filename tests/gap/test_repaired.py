"""The repaired model, as a file and as a stepper: both do what the diagnosis simulates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

from tiago_mj.effects import read_effects
from tiago_mj.gap import apply
from tiago_mj.gap.report import calibration, html, terminal, write
from tiago_mj.gap.report.repaired import repaired
from tiago_mj.gap.result import Diagnosis, Shrink, Verdict
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.recordings.recording import Sidecar, Trial

ARM = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" damping="0.123456789012" armature="0.01"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".6123456789"/>
      <body name="fore" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" damping=".05"/>
        <geom type="capsule" size=".015" fromto="0 0 0 .25 0 .02" mass=".3"/>
      </body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>
"""
ACTUATORS = {
    "position": '<position name="shoulder" joint="shoulder" kp="35.123456789" kv="2"/>'
    '<position name="elbow" joint="elbow" kp="18" dampratio="0.4" forcerange="-6 6"/>',
    "effort": '<motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow" gear="2"/>',
    "velocity": '<velocity name="shoulder" joint="shoulder" kv="4"/><velocity name="elbow" joint="elbow" kv="2"/>',
}
SIZE = {"position": 0.5, "effort": 1.0, "velocity": 1.5}
RATE, ROWS = 100.0, 120


def robot(folder: Path, interface: str = "position", *, given: Any = None) -> tuple[Plant, Trial, np.ndarray]:
    """The arm, a motion of it, and its commands, (rows, 2)."""
    path = folder / "arm.xml"
    path.write_text(ARM.format(actuators=ACTUATORS[interface]))
    time = np.arange(ROWS) / RATE
    commands = SIZE[interface] * np.stack([np.sin(7 * time), np.sign(np.sin(5 * time + 0.4))], axis=1)
    by_name = {"shoulder": commands[:, 0], "elbow": commands[:, 1]}
    start = {"shoulder": np.full(ROWS, 0.1), "elbow": np.full(ROWS, -0.2)}
    sidecar = Sidecar("tiago_mj.recording/1", "one", robot=str(path), rate_hz=RATE, interface=interface)
    trial = Trial("one", time, by_name, start, {}, {}, {}, sidecar, "one.csv")
    return plant_of([trial], given=read_effects(given)), trial, commands


def diagnosis(plant: Plant) -> Diagnosis:
    """One that found nothing beyond what was given."""
    said = Diagnosis(
        verdict=Verdict("no_gap", (), 1.0),
        where=(),
        stage=None,
        shrink=Shrink(None, None, 1.0, None, None, None),
        ranking=(),
        findings=(),
        next_motion=None,
        splits={},
        robot=plant.name,
        complete=True,
        seed=0,
        version="1",
        seconds=0.0,
    )
    said = replace(said, given=plant.given)
    return replace(said, repaired=repaired(said, plant))


def replayed(plant: Plant, trial: Trial) -> np.ndarray:
    """Measured positions in the diagnosis' own simulation, (rows, 2)."""
    return replay.simulate(plant, replay.grid(plant, [trial]), [(0, ())], replay.Run(threads=1)).position[0]


def played(path: Path, plant: Plant, commands: np.ndarray) -> np.ndarray:
    """Positions of the file in MuJoCo alone, (rows, 2)."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    start = next(iter(plant.starts.values()))
    data.qpos[:] = start.qpos
    for k in range(model.nu):
        if model.actuator_delay[k] > 0 and plant.wiring.interface == "position":
            samples = np.full(model.actuator_history[k, 0], start.set_point[k])
            mujoco.mj_initCtrlHistory(model, data, k, None, samples)
    rows = [data.qpos[plant.wiring.qpos].copy()]
    for sent in commands[:-1]:
        data.ctrl[:] = sent
        mujoco.mj_step(model, data, nstep=round(1 / RATE / model.opt.timestep))
        rows.append(data.qpos[plant.wiring.qpos].copy())
    return np.array(rows)


def effect(name: str, target: str, **parameters: float) -> dict[str, Any]:
    return {"name": name, "target": target, "parameters": parameters}


IN_A_FILE = [
    ("position", [effect("coulomb_friction", "elbow", force=0.7)]),
    ("position", [effect("viscous_friction", "shoulder", damping=0.8), effect("armature", "elbow", mass=0.02)]),
    ("position", [effect("servo_stiffness", "elbow", factor=0.6), effect("servo_damping", "shoulder", damping=1.5)]),
    ("position", [effect("torque_constant", "all", factor=0.8), effect("force_limit", "shoulder", limit=2.5)]),
    ("position", [effect("payload", "elbow", mass=0.4)]),
    ("position", [effect("payload", "elbow", mass=0.4, x=0.12, y=0.02, z=-0.03)]),
    ("position", [effect("payload", "elbow", mass=-0.1, x=0.05), effect("gravity_tilt", "all", angle=0.2)]),
    ("position", [effect("joint_spring", "elbow", stiffness=5.0, rest=0.3, hardening=0.4)]),
    ("position", [effect("command_delay", "elbow", seconds=0.03)]),
    ("position", [effect("command_delay", "all", seconds=0.0237), effect("coulomb_friction", "all", force=0.3)]),
    ("effort", [effect("coulomb_friction", "elbow", force=0.2), effect("command_delay", "all", seconds=0.02)]),
    ("effort", [effect("torque_constant", "elbow", factor=0.7), effect("payload", "elbow", mass=0.2)]),
    ("velocity", [effect("viscous_friction", "elbow", damping=0.5), effect("armature", "shoulder", mass=0.05)]),
    ("velocity", [effect("force_limit", "elbow", limit=1.5), effect("command_delay", "shoulder", seconds=0.01)]),
]
#: Dry friction, between motion and rest, amplifies the last digit of a number.
EXACT = 1e-9


@pytest.mark.parametrize(("interface", "given"), IN_A_FILE, ids=str)
def test_the_repaired_model_does_in_mujoco_alone_what_the_diagnosis_simulates(interface, given, tmp_path):
    plant, trial, commands = robot(tmp_path, interface, given=given)
    made = diagnosis(plant).repaired
    assert not made.fault
    assert not made.lacks
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "repaired.xml").write_text(made.xml)
    expected = replayed(plant, trial)
    plain = replayed(replace(plant, given=()), trial)
    assert np.abs(expected - plain).max() > 1e-3, "the effect shows"
    np.testing.assert_allclose(
        played(tmp_path / "elsewhere" / "repaired.xml", plant, commands), expected, rtol=0, atol=EXACT
    )


WITH_APPLY = [
    [effect("backlash", "elbow", width=0.05)],
    [effect("command_deadband", "all", width=0.03), effect("encoder_quantization", "elbow", step=0.01)],
    [effect("command_delay", "all", seconds=0.0013), effect("stribeck_friction", "elbow", static=0.5, velocity=0.1)],
    [effect("joint_elasticity", "elbow", stiffness=60), effect("encoder_bias", "elbow", offset=0.02)],
    [effect("clock_offset", "all", seconds=0.015), effect("velocity_limit", "shoulder", velocity=1.0)],
    [effect("dropped_commands", "all", probability=0.3), effect("command_lag", "all", time_constant=0.03)],
    [effect("clock_skew", "all", rate=0.02), effect("coulomb_friction", "elbow", force=0.5)],
]


@pytest.mark.parametrize("given", [*WITH_APPLY, *(given for which, given in IN_A_FILE if which == "position")], ids=str)
def test_apply_does_with_the_users_model_what_the_diagnosis_simulates(given, tmp_path):
    plant, trial, commands = robot(tmp_path, given=given)
    (tmp_path / "diagnosis.json").write_text("{}")
    calibration.write(diagnosis(plant), tmp_path / "calibration.yaml", tmp_path / "diagnosis.json")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    stepped = apply(model, tmp_path / "calibration.yaml", seed=[0, 0])
    stepped.reset({"shoulder": 0.1, "elbow": -0.2})
    rows = [stepped.position]
    for k, sent in enumerate(commands[:-1]):
        stepped.step(sent if k % 2 else dict(zip(stepped.actuators, sent, strict=True)))
        rows.append(stepped.position)
    np.testing.assert_allclose(np.array(rows), replayed(plant, trial), rtol=0, atol=EXACT)
    assert model.opt.timestep == 0.002
    assert model.joint("elbow").frictionloss[0] == 0
    first = rows[-1]
    stepped.reset({"shoulder": 0.1, "elbow": -0.2})
    for sent in commands[:-1]:
        stepped.step(sent)
    np.testing.assert_array_equal(stepped.position, first)


def test_a_file_says_what_it_cannot_hold_and_how_to_have_it(tmp_path):
    given = [effect("coulomb_friction", "elbow", force=0.25), effect("backlash", "elbow", width=0.02)]
    plant, _, _ = robot(tmp_path, given=given)
    made = diagnosis(plant).repaired
    assert (made.holds, made.lacks) == (("coulomb_friction",), ("backlash",))
    model = mujoco.MjModel.from_xml_string(made.xml)
    assert model.joint("elbow").frictionloss[0] == 0.25
    comment = made.xml[made.xml.index("<!--") : made.xml.index("-->")]
    assert "arm.xml" in comment
    assert "coulomb_friction on elbow: force 0.25" in comment
    assert "backlash on elbow: width 0.02: NOT HELD" in comment
    assert 'tiago_mj.gap.apply(model, "calibration.yaml")' in comment


def test_effects_are_not_applied_to_a_model_that_has_them_already(tmp_path):
    plant, _, _ = robot(tmp_path, given=[effect("coulomb_friction", "elbow", force=0.25)])
    model = mujoco.MjModel.from_xml_string(diagnosis(plant).repaired.xml)
    with pytest.raises(ValueError, match="repaired one"):
        apply(model, [effect("coulomb_friction", "elbow", force=0.25)], rate_hz=100)


MESHED = """
<mujoco>
  <compiler meshdir="parts" texturedir="pictures" inertiafromgeom="true" settotalmass="2"/>
  <asset><mesh name="wedge" file="wedge.obj"/><texture name="t" type="2d" file="t.png"/></asset>
  <worldbody>
    <body><joint name="hinge" axis="0 1 0" armature=".01"/><geom type="mesh" mesh="wedge" pos=".1 0 0"/>
      <body name="tip" pos=".3 0 0"><joint name="wrist" axis="0 1 0" armature=".01"/>
        <geom size=".03 .02 .01" type="box"/></body>
    </body>
  </worldbody>
  <include file="more/servos.xml"/>
</mujoco>
"""
WEDGE = "v 0 0 0\nv .2 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
SERVOS = """
<mujoco><actuator><position name="hinge" joint="hinge" kp="20" dampratio="1"/>
<position name="wrist" joint="wrist" kp="9" kv="1"/></actuator></mujoco>
"""


def test_a_model_of_several_files_with_meshes_is_repaired_from_another_folder(tmp_path):
    for name in ("parts", "pictures", "more"):
        (tmp_path / "robot" / name).mkdir(parents=True)
    path = tmp_path / "robot" / "robot.xml"
    path.write_text(MESHED)
    (tmp_path / "robot" / "parts" / "wedge.obj").write_text(WEDGE)
    (tmp_path / "robot" / "more" / "servos.xml").write_text(SERVOS)
    picture = pytest.importorskip("PIL.Image")
    picture.new("RGB", (4, 4), (9, 99, 199)).save(tmp_path / "robot" / "pictures" / "t.png")
    sidecar = Sidecar("tiago_mj.recording/1", "one", robot=str(path), rate_hz=RATE, interface="position")
    still = {"hinge": np.zeros(30), "wrist": np.full(30, 0.1)}
    trial = Trial("one", np.arange(30) / RATE, still, still, {}, {}, {}, sidecar, "one.csv")
    plant = plant_of([trial], given=read_effects({"payload": {"mass": 0.4, "x": 0.02}, "servo_stiffness": {}}))
    made = diagnosis(plant).repaired
    assert not made.fault
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "repaired.xml").write_text(made.xml)
    sent = np.stack([still["hinge"], still["wrist"]], axis=1)
    seen = played(tmp_path / "out" / "repaired.xml", plant, sent)
    np.testing.assert_allclose(seen, replayed(plant, trial), rtol=0, atol=EXACT)


def test_a_calibration_says_how_its_robot_is_commanded(tmp_path):
    plant, _, _ = robot(tmp_path, given=[effect("backlash", "elbow", width=0.02)])
    (tmp_path / "diagnosis.json").write_text("{}")
    said = yaml.safe_load(calibration.text(diagnosis(plant), tmp_path / "diagnosis.json"))
    assert (said["rate_hz"], said["interface"], said["timestep"]) == (100.0, "position", 0.002)
    assert (said["joints"], said["actuators"]) == (["shoulder", "elbow"], ["shoulder", "elbow"])


@pytest.mark.parametrize(
    ("faulty", "message"),
    [
        (lambda model: apply(model, {"backlash": {}}), "rate_hz="),
        (lambda model: apply(model, {"backlash": {}}, rate_hz=100).step({"wrist": 0}), "has shoulder, elbow"),
        (lambda model: apply(model, {"backlash": {}}, rate_hz=100).step([1, 2, 3]), r"give \(2,\)"),
        (lambda model: apply(model, {"backlash": {}}, rate_hz=100).step([1, np.nan]), "'elbow' is no finite"),
        (lambda model: apply(model, {"backlash": {}}, rate_hz=100, joints=["elbow"]), "add 'shoulder'"),
        (lambda model: apply(model, "nowhere.yaml", rate_hz=100), "no calibration file"),
    ],
)
def test_what_apply_cannot_use_is_said_in_one_line(faulty, message, tmp_path):
    plant, _, _ = robot(tmp_path)
    with pytest.raises(ValueError, match=message) as fault:
        faulty(plant.model)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], ""),
        (["coulomb_friction"], "repaired.xml is the model with Coulomb friction."),
        (["backlash"], 'No model file can hold backlash: tiago_mj.gap.apply(model, "calibration.yaml") does.'),
        (["payload", "backlash"], "repaired.xml is the model with payload. No model file can hold backlash: "),
    ],
)
def test_the_terminal_and_the_page_say_what_the_file_holds(given, said, tmp_path):
    found = diagnosis(robot(tmp_path, given={name: {} for name in given})[0])
    shown = [line for _, line in terminal.lines(found, {})]
    assert any(said in line for line in shown) if said else not any("repaired" in line for line in shown)
    page = html.render(found)
    assert said.replace('"', "&#34;") in page
    assert "gymnasium.make(ID" not in page


def test_a_file_that_cannot_be_written_costs_no_verdict(tmp_path):
    plant, _, _ = robot(tmp_path, given={"coulomb_friction": {}})
    (tmp_path / "arm.xml").write_text("<mujoco><broken/></mujoco>")
    found = diagnosis(plant)
    paths = write(found, tmp_path / "out")
    assert "repaired.xml" not in paths
    assert paths["calibration.yaml"].is_file()
    assert "repaired.xml could not be written (XML Error" in terminal.lines(found, {})[-1][1]
    assert "repaired.xml" in write(diagnosis(robot(tmp_path)[0]), tmp_path / "out")
