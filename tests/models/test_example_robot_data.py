"""The public TIAGo of example-robot-data: converted with its meshes, and lending them to our robots."""

import mujoco
import numpy as np
import pytest

from tiago_mj.models import meshes
from tiago_mj.models.convert import convert
from tiago_mj.models.files import model_file
from tiago_mj.models.limits import joint_limits

try:
    PUBLIC = meshes.example_robot_data()
except FileNotFoundError as missing:
    pytest.skip(str(missing), allow_module_level=True)


@pytest.fixture(scope="module")
def converted(tmp_path_factory):
    out = tmp_path_factory.mktemp("public") / "tiago.xml"
    return convert(PUBLIC, out), mujoco.MjModel.from_xml_path(str(out))


def test_the_public_tiago_converts_with_its_meshes(converted):
    report, model = converted
    assert model.nmesh > 15
    assert model.nv == 12  # torso, head 2, arm 7, wheels 2
    repaired = {repair.link for repair in report.repaired}
    assert repaired == {
        *("base_antenna_left_link", "base_antenna_right_link"),
        *("arm_tool_link", "wrist_ft_link", "wrist_ft_tool_link"),
    }
    assert {fit.link for fit in report.fitted} == {
        *("base_link", "torso_lift_link", "head_1_link", "head_2_link"),
        *(f"arm_{i}_link" for i in range(1, 7)),
    }
    # The published fits of single primitives to these meshes are 3 to 10 mm off.
    assert max(fit.rms_distance for fit in report.fitted) < 0.012
    assert joint_limits(model, "arm_1_joint").velocity == 2.7


def test_the_public_tiago_agrees_with_pinocchio(converted):
    pin = pytest.importorskip("pinocchio", reason="pin is a test dependency: pip install pin")
    _, model = converted
    reference = pin.buildModelFromUrdf(str(PUBLIC))
    data, reference_data = mujoco.MjData(model), reference.createData()
    rng = np.random.default_rng(0)
    arms = [model.joint(i) for i in range(model.njnt) if model.jnt_limited[i]]
    for _ in range(20):
        pose = pin.neutral(reference)
        for joint in arms:
            value = rng.uniform(*joint.range)
            data.qpos[joint.qposadr[0]] = value
            pose[reference.joints[reference.getJointId(joint.name)].idx_q] = value
        mujoco.mj_forward(model, data)
        pin.framesForwardKinematics(reference, reference_data, pose)
        for i in range(1, model.nbody):
            expected = reference_data.oMf[reference.getFrameId(model.body(i).name)]
            np.testing.assert_allclose(data.xpos[i], expected.translation, atol=1e-9)
        torque = pin.computeGeneralizedGravity(reference, reference_data, pose)
        for joint in arms:
            index = reference.joints[reference.getJointId(joint.name)].idx_v
            assert data.qfrc_bias[joint.dofadr[0]] == pytest.approx(torque[index], rel=1e-6, abs=1e-6)


def test_the_public_tiago_holds_still(converted):
    _, model = converted
    data = mujoco.MjData(model)
    lower, upper = model.jnt_range.T
    data.qpos[:] = np.where(model.jnt_limited, np.clip(0, lower, upper), 0)
    data.act[:] = data.qpos
    mujoco.mj_step(model, data, 1000)
    assert np.isfinite(data.qpos).all()
    assert np.abs(data.qpos - data.act).max() < 0.02  # the servos bend under gravity: full effort is 0.01


@pytest.mark.parametrize("robot", ["tiago_ta11", "tiago_pal_gripper", "gripper_ta11"])
def test_meshes_change_looks_and_nothing_else(robot):
    plain = mujoco.MjModel.from_xml_path(str(model_file(f"robots/{robot}.xml")))
    dressed = meshes.with_meshes(robot).compile()
    assert (dressed.nmesh > 0) == (robot != "gripper_ta11")
    np.testing.assert_array_equal(dressed.body_mass, plain.body_mass)
    np.testing.assert_array_equal(dressed.body_inertia, plain.body_inertia)
    solid = [(m, np.flatnonzero(m.geom_group == 3)) for m in (plain, dressed)]
    for field in ("geom_size", "geom_pos", "geom_contype", "geom_conaffinity", "geom_type"):
        first, second = (getattr(m, field)[index] for m, index in solid)
        np.testing.assert_array_equal(first, second)
    data = mujoco.MjData(dressed)
    mujoco.mj_resetDataKeyframe(dressed, data, 0)
    mujoco.mj_forward(dressed, data)
    assert data.ncon == 0


def test_the_borrowed_meshes_lie_where_the_collision_primitives_are():
    model = meshes.with_meshes("tiago_ta11").compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    for link in meshes.FITTING:
        body = model.body(link).id
        mesh = [
            g
            for g in range(model.ngeom)
            if model.geom_bodyid[g] == body and model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
        ]
        solid = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and model.geom_group[g] == 3]
        middle = np.mean([data.geom_xpos[g] for g in solid], axis=0)
        # A wrong frame would be off by a link's length, 0.2 m and more; hollow shells have their centroid a few cm
        # off the box's.
        assert min(np.linalg.norm(data.geom_xpos[g] - middle) for g in mesh) < 0.06, link
