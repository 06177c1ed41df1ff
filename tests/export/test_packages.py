"""What was written is loaded by the real packages, and replayed where they simulate on a processor."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import test_targets as wanted
from interpreters import interpreter, run
from robots import JOINTS, effect, exported, robot

from tiago_mj.export import mjcf, replay

HERE = Path(__file__).parent
pytestmark = pytest.mark.slow

CASES = {
    "friction": [effect("coulomb_friction", "elbow", force=0.7), effect("viscous_friction", "rail", damping=9.0)],
    "servo": [effect("servo_stiffness", "elbow", factor=0.6), effect("force_limit", "shoulder", limit=2.5)],
    "payload": [effect("payload", "elbow", mass=0.4, x=0.12), effect("gravity_tilt", "all", angle=0.2)],
    "delay": [effect("command_delay", "all", seconds=0.0237)],
    "play": [effect("backlash", "elbow", width=0.05)],
    "elasticity": [effect("joint_elasticity", "shoulder", stiffness=100)],
}
#: How far the gap that a target leaves may be from ours, in shares of the gap.
SAME = 0.01


def _put(path, one, played):
    """A motion, for another interpreter."""
    np.savez(
        path,
        commands=played.commands,
        qpos=played.qpos,
        joints=one.joints,
        actuators=one.actuators,
        held=played.qpos[list(one.wiring.targets.actuated)],
        substeps=played.substeps,
    )


def closed(folder, effects, python, version, *words):
    """Share of the gap that a version closes, and that the file closes here."""
    one = robot(folder, effects)
    written = mjcf.write(one, version=version)
    main = written.save(folder / "written")
    played = replay.motion(one)
    _put(folder / "in.npz", one, played)
    said = run(python, HERE / "play_alone.py", main, folder / "in.npz", folder / "out.npy", *words)
    assert said.split()[-1].startswith(version)
    simulated, nominal = replay.simulated(one, one.entries, played), replay.simulated(one, (), played)
    there = replay.compared(simulated, nominal, np.load(folder / "out.npy"))
    return there.closed, replay.closing(one, written.compile()).closed


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("version", ["3.11", "3.17"])
def test_older_mujoco_closes_the_gap_as_this_one_does(case, version, tmp_path):
    python = interpreter(f"mujoco_{version.replace('.', '_')}")
    there, here = closed(tmp_path, CASES[case], python, version)
    assert there == pytest.approx(here, abs=SAME)
    assert there > 0.98


@pytest.mark.parametrize("case", ["friction", "payload", "delay", "play"])
def test_mjx_closes_it_too_but_for_delays(case, tmp_path):
    there, here = closed(tmp_path, CASES[case], interpreter("mujoco_3_17"), "3.17", "mjx")
    if case == "delay":
        assert there < 0.1, "MJX has delays now: say so in the target"
    else:
        assert there == pytest.approx(here, abs=SAME)


@pytest.mark.parametrize("case", ["friction", "play"])
def test_mjlab_s_engine_closes_it_too(case, tmp_path):
    """MuJoCo Warp 3.11, in single precision."""
    there, here = closed(tmp_path, CASES[case], interpreter("mjlab"), "3.11", "warp")
    assert there == pytest.approx(here, abs=SAME)


def test_a_model_that_is_patched_moves_as_one_that_is_written(tmp_path):
    effects = [*CASES["friction"], *CASES["servo"], *CASES["payload"]]
    out = exported(tmp_path, "playground", effects)
    one = robot(tmp_path, effects)
    played = replay.motion(one)
    _put(tmp_path / "in.npz", one, played)
    words = [one.file, tmp_path / "in.npz", tmp_path / "out.npy", "patch", out / "playground_patch.py"]
    run(interpreter("mujoco_3_17"), HERE / "play_alone.py", *words)
    simulated, nominal = replay.simulated(one, one.entries, played), replay.simulated(one, (), played)
    assert replay.compared(simulated, nominal, np.load(tmp_path / "out.npy")).closed > 1 - SAME


NEWTON = """
import json, sys
import newton
builder = newton.ModelBuilder()
builder.add_usd(sys.argv[1])
names = ("target_ke", "target_kd", "effort_limit", "armature", "friction", "damping", "velocity_limit")
print("RESULT" + json.dumps({
    "labels": [str(one) for one in builder.joint_label],
    **{name: [float(one) for one in getattr(builder, "joint_" + name)] for name in names},
    "mass": [float(one) for one in builder.body_mass],
}))
"""
#: A robot's USD.
USD = """#usda 1.0
(
    defaultPrim = "arm"
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "arm" (
    prepend apiSchemas = ["PhysicsArticulationRootAPI"]
)
{
BODIES
    def Scope "joints"
    {
        def PhysicsFixedJoint "fixed"
        {
            rel physics:body1 = </arm/base>
        }
JOINTS
    }
}
"""


#: What is loaded: of layers the first is the strongest.
TOP = """#usda 1.0
(
    defaultPrim = "arm"
    metersPerUnit = 1
    upAxis = "Z"
    subLayers = [@./newton_drives.usda@, @./robot.usda@]
)
"""


def usd():
    """Links in a row, the first joint of which slides."""
    names = ("base", "rail", "upper", "fore")
    bodies = "".join(
        f'    def Xform "{name}" (\n        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]\n    )\n'
        "    {\n        float physics:mass = 1\n        float3 physics:diagonalInertia = (0.1, 0.1, 0.1)\n    }\n"
        for name in names
    )
    joints = "".join(
        f'        def Physics{"Prismatic" if name == "rail" else "Revolute"}Joint "{name}"\n        {{\n'
        f"            rel physics:body0 = </arm/{names[k]}>\n            rel physics:body1 = </arm/{names[k + 1]}>\n"
        f'            uniform token physics:axis = "{"X" if name == "rail" else "Y"}"\n        }}\n'
        for k, name in enumerate(JOINTS)
    )
    return USD.replace("BODIES", bodies).replace("JOINTS", joints)


def test_newton_reads_the_numbers_in_si_units(tmp_path):
    python = interpreter("newton")
    out = exported(tmp_path, "newton", wanted.EFFECTS)
    (out / "robot.usda").write_text(usd())
    (out / "top.usda").write_text(TOP)
    (tmp_path / "load.py").write_text(NEWTON)
    said = json.loads(run(python, tmp_path / "load.py", out / "top.usda").split("RESULT")[1])
    order = [one.rsplit("/", 1)[1] for one in said["labels"] if not one.endswith("fixed")]
    for key, values in {
        "target_ke": wanted.STIFFNESS,
        "target_kd": wanted.DAMPING,
        "effort_limit": wanted.EFFORT,
        "armature": wanted.ARMATURE,
        "friction": wanted.FRICTION,
        "damping": wanted.VISCOUS,
    }.items():
        assert dict(zip(order, said[key], strict=True)) == pytest.approx(values, rel=1e-6), key
    speeds = dict(zip(order, said["velocity_limit"], strict=True))
    assert speeds["rail"] == pytest.approx(0.3)
    assert speeds["elbow"] == pytest.approx(1.7)
    assert speeds["shoulder"] > 1e5 or math.isinf(speeds["shoulder"])
    assert said["mass"][-1] == pytest.approx(wanted.MASS)


MJLAB = """
import json, sys
sys.path.insert(0, sys.argv[1])
import mujoco
import mjlab_robot
from mjlab.entity import Entity
model = Entity(mjlab_robot.ROBOT).spec.compile()
joints = ("rail", "shoulder", "elbow")
actuators = [model.actuator(name).id for name in joints]
print("RESULT" + json.dumps({
    "version": mujoco.__version__,
    "stiffness": [float(-model.actuator_biasprm[a, 1]) for a in actuators],
    "damping": [float(-model.actuator_biasprm[a, 2]) for a in actuators],
    "effort": [float(model.actuator_forcerange[a, 1]) for a in actuators],
    "friction": [float(model.joint(name).frictionloss[0]) for name in joints],
    "viscous": [float(model.joint(name).damping[0]) for name in joints],
    "armature": [float(model.joint(name).armature[0]) for name in joints],
    "lag": [one.delay_max_lag for one in mjlab_robot.ACTUATORS],
    "mass": float(model.body("fore").mass[0]),
}))
"""


def test_mjlab_makes_the_same_model_of_its_configuration(tmp_path):
    python = interpreter("mjlab")
    out = exported(tmp_path, "mjlab", wanted.EFFECTS)
    (tmp_path / "load.py").write_text(MJLAB)
    said = json.loads(run(python, tmp_path / "load.py", out).split("RESULT")[1])
    assert said["version"].startswith("3.11")
    for key, values in {
        "stiffness": wanted.STIFFNESS,
        "damping": wanted.DAMPING,
        "effort": wanted.EFFORT,
        "friction": wanted.FRICTION,
        "viscous": wanted.VISCOUS,
        "armature": wanted.ARMATURE,
        "lag": wanted.LAG,
    }.items():
        assert said[key] == pytest.approx([values[name] for name in JOINTS]), key
    assert said["mass"] == pytest.approx(wanted.MASS)
