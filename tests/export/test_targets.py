"""What each target is given: units and signs of a robot of which no two numbers are alike, read back from the text."""

import math
import re
import sys
import types
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import yaml
from robots import ARM, JOINTS, effect, exported, robot

from tiago_mj.export import replay
from tiago_mj.export.drives import numbers_of
from tiago_mj.export.targets.registry import TARGETS

#: Each joint has another value of everything.
EFFECTS = [
    effect("coulomb_friction", "elbow", force=0.7),
    effect("viscous_friction", "shoulder", damping=0.8),
    effect("armature", "rail", mass=0.05),
    effect("servo_stiffness", "elbow", factor=0.5),
    effect("servo_damping", "shoulder", damping=1.5),
    effect("force_limit", "shoulder", limit=2.5),
    effect("velocity_limit", "rail", velocity=0.3),
    effect("velocity_limit", "elbow", velocity=1.7),
    effect("command_delay", "rail", seconds=0.02),
    effect("command_delay", ["shoulder", "elbow"], seconds=0.011),
    effect("payload", "elbow", mass=0.4, x=0.12),
]
#: At the joints, in SI units: the elbow's gear is 2, of which stiffness and damping have the square and effort has 2.
STIFFNESS = {"rail": 900.0, "shoulder": 35.0, "elbow": 9.0}
DAMPING = {"rail": 31.0, "shoulder": 3.6, "elbow": 1.16}
FRICTION = {"rail": 0.71, "shoulder": 0.17, "elbow": 0.7}
VISCOUS = {"rail": 5.1, "shoulder": 0.93, "elbow": 0.051}
ARMATURE = {"rail": 0.05, "shoulder": 0.011, "elbow": 0.0031}
EFFORT = {"rail": 53.0, "shoulder": 2.5, "elbow": 6.6}
VELOCITY = {"rail": 0.3, "elbow": 1.7}
LAG = {"rail": 10, "shoulder": 6, "elbow": 6}
MASS, CENTRE_X = 0.7, 0.125 + 0.4 / 0.7 * 0.12


def known(values):
    return pytest.approx(values, rel=1e-12)


def test_drives_are_at_the_joints_in_si_units(tmp_path):
    drives = {drive.joint: drive for drive in numbers_of(robot(tmp_path, EFFECTS)).drives}
    assert {name: one.stiffness for name, one in drives.items()} == known(STIFFNESS)
    assert {name: one.damping for name, one in drives.items()} == known(DAMPING)
    assert {name: one.friction for name, one in drives.items()} == known(FRICTION)
    assert {name: one.joint_damping for name, one in drives.items()} == known(VISCOUS)
    assert {name: one.armature for name, one in drives.items()} == known(ARMATURE)
    assert {name: one.effort for name, one in drives.items()} == known(EFFORT)
    assert {name: one.velocity for name, one in drives.items()} == known({**VELOCITY, "shoulder": math.inf})
    assert [one.slides for one in drives.values()] == [True, False, False]
    assert (drives["rail"].low, drives["rail"].high) == (-0.41, 0.43)


def test_a_spring_behind_a_servo_lowers_its_gains(tmp_path):
    (rail, shoulder, _) = numbers_of(robot(tmp_path, [effect("joint_elasticity", "shoulder", stiffness=100)])).drives
    assert (rail.stiffness, rail.damping) == (900, 31)
    assert shoulder.stiffness == known(1 / (1 / 35 + 1 / 100))
    assert shoulder.damping == known(2.1 * 100 / 135)


#: What lower gains leave of the mean squared gap on a smooth motion, as measured; half as much again is borne.
SOFTER = [
    (effect("joint_elasticity", "shoulder", stiffness=100), 0.034),
    (effect("joint_elasticity", "elbow", stiffness=60), 0.047),
    (effect("joint_elasticity", "elbow", stiffness=60, motor=0.004), 0.136),
    (effect("joint_elasticity", "rail", stiffness=3000), 0.05),
]


@pytest.mark.parametrize(("spring", "measured"), SOFTER)
def test_lower_gains_do_nearly_what_a_spring_does(spring, measured, tmp_path):
    one = robot(tmp_path, [spring])
    assert 1 - replay.closing(one, numbers_of(one).model).closed < 1.5 * measured


class Recorded:
    """A configuration of a package that is not installed: what it was made with."""

    def __init__(self, **given):
        self.__dict__.update(given)


def run_python(path, monkeypatch, **modules):
    """Run a module that was written, with stand-ins for the packages that it imports."""
    for name, names in modules.items():
        module = types.ModuleType(name)
        for one in names:
            setattr(module, one, Recorded)
        monkeypatch.setitem(sys.modules, name.replace("_", "."), module)
    names = {"__file__": str(path)}
    exec(compile(path.read_text(), str(path), "exec"), names)
    return names


def test_mjlab(tmp_path, monkeypatch):
    out = exported(tmp_path, "mjlab", EFFECTS)
    stubs = {
        "mjlab": [],
        "mjlab_actuator": ["BuiltinPositionActuatorCfg"],
        "mjlab_entity": ["EntityArticulationInfoCfg", "EntityCfg"],
    }
    names = run_python(out / "mjlab_robot.py", monkeypatch, **stubs)
    by_name = {one.target_names_expr[0]: one for one in names["ACTUATORS"]}
    assert tuple(by_name) == JOINTS
    assert {name: one.stiffness for name, one in by_name.items()} == known(STIFFNESS)
    assert {name: one.damping for name, one in by_name.items()} == known(DAMPING)
    assert {name: one.effort_limit for name, one in by_name.items()} == known(EFFORT)
    assert {name: one.delay_min_lag for name, one in by_name.items()} == LAG
    assert {name: one.delay_max_lag for name, one in by_name.items()} == LAG
    assert (names["TIMESTEP"], names["DECIMATION"]) == (0.002, 5)
    model = names["spec"]().compile()
    assert model.nu == 0
    assert dict(zip(JOINTS, model.dof_frictionloss, strict=True)) == known(FRICTION)
    assert dict(zip(JOINTS, model.dof_damping, strict=True)) == known(VISCOUS)
    assert dict(zip(JOINTS, model.dof_armature, strict=True)) == known(ARMATURE)


def test_isaac_lab(tmp_path, monkeypatch):
    out = exported(tmp_path, "isaaclab", EFFECTS)
    stubs = {"isaaclab": [], "isaaclab_actuators": ["DelayedPDActuatorCfg"]}
    names = run_python(out / "isaaclab_actuators.py", monkeypatch, **stubs)
    groups = names["ACTUATORS"].values()
    assert sorted(name for one in groups for name in one.joint_names_expr) == sorted(JOINTS)
    for key, wanted in {
        "stiffness": STIFFNESS,
        "damping": DAMPING,
        "friction": FRICTION,
        "dynamic_friction": FRICTION,
        "viscous_friction": VISCOUS,
        "armature": ARMATURE,
        "effort_limit": EFFORT,
        "effort_limit_sim": EFFORT,
        "velocity_limit_sim": VELOCITY,
    }.items():
        said = {name: value for one in groups for name, value in (getattr(one, key) or {}).items()}
        assert said == known(wanted), key
    assert {name: one.min_delay for one in groups for name in one.joint_names_expr} == LAG
    assert (names["SIM_DT"], names["DECIMATION"], names["GRAVITY"]) == (0.002, 5, (0.0, 0.0, -9.81))


def test_isaac_lab_without_a_delay_has_implicit_actuators(tmp_path, monkeypatch):
    out = exported(tmp_path, "isaaclab", EFFECTS[:1])
    stubs = {"isaaclab": [], "isaaclab_actuators": ["ImplicitActuatorCfg"]}
    (group,) = run_python(out / "isaaclab_actuators.py", monkeypatch, **stubs)["ACTUATORS"].values()
    assert not hasattr(group, "min_delay")


def test_playground_s_patch_makes_the_model_that_was_simulated(tmp_path):
    effects = [*EFFECTS, effect("gravity_tilt", "all", angle=0.2)]
    out = exported(tmp_path, "playground", effects)
    names = {}
    exec((out / "playground_patch.py").read_text(), names)
    one = robot(tmp_path, effects)
    model = names["patch"](mujoco.MjModel.from_xml_string(ARM))
    wanted = numbers_of(one).exact
    for field in ("dof_frictionloss", "dof_solref", "dof_damping", "dof_armature", "body_mass", "body_inertia"):
        np.testing.assert_allclose(getattr(model, field), getattr(wanted, field), rtol=1e-12, atol=1e-15)
    for field in ("body_ipos", "actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "actuator_forcelimited"):
        np.testing.assert_allclose(getattr(model, field), getattr(wanted, field), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(model.opt.gravity, wanted.opt.gravity)
    written = mujoco.MjModel.from_xml_path(str(out / "model" / "arm.xml"))
    np.testing.assert_allclose(model.dof_invweight0, written.dof_invweight0, rtol=1e-6)
    assert names["CONFIG_OVERRIDES"] == {"ctrl_dt": 0.01, "sim_dt": 0.002}


def test_newton_has_hinges_per_degree_and_slides_per_metre(tmp_path):
    text = (exported(tmp_path, "newton", EFFECTS) / "newton_drives.usda").read_text()
    joints = {}
    for name, body in re.findall(r'over "(\w+)" \([^)]*Drive[^)]*\)\s*\{([^}]*)\}', text):
        joints[name] = {key: float(value) for key, value in re.findall(r"float ([\w:]+) = (\S+)", body)}
    assert tuple(joints) == JOINTS
    for name, values in joints.items():
        axis, per = ("linear", 1.0) if name == "rail" else ("angular", 180 / math.pi)
        assert values[f"drive:{axis}:physics:stiffness"] * per == known(STIFFNESS[name])
        assert values[f"drive:{axis}:physics:damping"] * per == known(DAMPING[name])
        assert values[f"drive:{axis}:physics:maxForce"] == known(EFFORT[name])
        assert values["newton:damping"] * per == known(VISCOUS[name])
        assert values["newton:friction"] == known(FRICTION[name])
        assert values["newton:armature"] == known(ARMATURE[name])
    assert joints["rail"]["newton:velocityLimit"] == known(0.3)
    assert joints["elbow"]["newton:velocityLimit"] == known(1.7 * 180 / math.pi)
    assert "newton:velocityLimit" not in joints["shoulder"]
    assert f"float physics:mass = {MASS}" in text
    assert float(re.search(r"centerOfMass = \(([^,]*),", text)[1]) == known(CENTRE_X)


def test_ros2_control_has_limits(tmp_path):
    said = yaml.safe_load((exported(tmp_path, "ros2_control", EFFECTS) / "joint_limits.yaml").read_text())
    limits = said["joint_limits"]
    assert tuple(limits) == JOINTS
    assert {name: one["max_effort"] for name, one in limits.items()} == known(EFFORT)
    assert {n: one["max_velocity"] for n, one in limits.items() if one["has_velocity_limits"]} == known(VELOCITY)
    assert (limits["shoulder"]["min_position"], limits["shoulder"]["max_position"]) == (-1.9, 2.1)


def test_urdf_has_dynamics_limits_and_inertials(tmp_path):
    root = ElementTree.parse(exported(tmp_path, "urdf", EFFECTS) / "joints.urdf").getroot()
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    assert [joint.get("type") for joint in joints.values()] == ["prismatic", "revolute", "revolute"]
    for name, joint in joints.items():
        dynamics, limit = joint.find("dynamics"), joint.find("limit")
        assert float(dynamics.get("damping")) == known(VISCOUS[name])
        assert float(dynamics.get("friction")) == known(FRICTION[name])
        assert float(limit.get("effort")) == known(EFFORT[name])
        assert float(limit.get("velocity")) == known(VELOCITY.get(name, 1e6))
    assert joints["elbow"].find("limit").get("lower") == "-2.3"
    (link,) = root.findall("link")
    assert link.get("name") == "fore"
    assert float(link.find("inertial/mass").get("value")) == known(MASS)
    assert float(link.find("inertial/origin").get("xyz").split()[0]) == known(CENTRE_X)
    _same_inertia(tmp_path, [float(link.find("inertial/inertia").get(key)) for key in INERTIA])


INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def _same_inertia(folder, values):
    """About the centre along the body's axes, as MuJoCo reads ``fullinertia`` back."""
    model = numbers_of(robot(folder, EFFECTS)).exact
    body = model.body("fore").id
    full = " ".join(map(repr, values))
    body_text = f'<body><joint/><inertial pos="0 0 0" mass="1" fullinertia="{full}"/></body>'
    read = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body_text}</worldbody></mujoco>")
    np.testing.assert_allclose(read.body_inertia[1], model.body_inertia[body], rtol=1e-9)
    turns = np.zeros((2, 9))
    for turn, quat in zip(turns, (read.body_iquat[1], model.body_iquat[body]), strict=True):
        mujoco.mju_quat2Mat(turn, quat)
    one, other = (t.reshape(3, 3) @ np.diag(model.body_inertia[body]) @ t.reshape(3, 3).T for t in turns)
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_sdf_has_dynamics_limits_and_inertials(tmp_path):
    root = ElementTree.parse(exported(tmp_path, "sdf", EFFECTS) / "joints.sdf").getroot()
    for joint in root.iter("joint"):
        name, axis = joint.get("name"), joint.find("axis")
        assert float(axis.find("dynamics/damping").text) == known(VISCOUS[name])
        assert float(axis.find("dynamics/friction").text) == known(FRICTION[name])
        assert float(axis.find("limit/effort").text) == known(EFFORT[name])
        assert (axis.find("limit/velocity") is None) == (name not in VELOCITY)
    assert root.find("world/gravity").text == "0 0 -9.81"
    (link,) = root.iter("link")
    assert float(link.find("inertial/mass").text) == known(MASS)
    _same_inertia(tmp_path, [float(link.find(f"inertial/inertia/{key}").text) for key in INERTIA])


def test_gymnasium_is_given_the_calibration_itself(tmp_path):
    out = exported(tmp_path, "gymnasium", EFFECTS)
    assert (out / "calibration.yaml").read_bytes() == (tmp_path / "diagnosis" / "calibration.yaml").read_bytes()


@pytest.mark.parametrize("name", TARGETS)
def test_no_effect_at_all_is_written_as_the_model_s_own_numbers(name, tmp_path, capsys):
    exported(tmp_path, name, [])
    assert "names no effect" in capsys.readouterr().out
