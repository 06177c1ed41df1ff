"""What the environments rely on in the three robots: names, pads, sensors, servos, contacts."""

import mujoco
import numpy as np
import pytest

from tiago_mj.models import build, names
from tiago_mj.models.files import model_file, models_folder

ROBOTS = ("gripper_ta11", "tiago_ta11", "tiago_pal_gripper")
TA11 = ("gripper_ta11", "tiago_ta11")


def load(robot: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(model_file(f"robots/{robot}.xml")))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("pre_grasp").id)
    mujoco.mj_forward(model, data)
    return model, data


def has(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> bool:
    return mujoco.mj_name2id(model, kind, name) >= 0


def test_the_committed_files_are_what_the_table_of_numbers_gives():
    assert build.stale(models_folder(), build.build(models_folder())) == []


def test_a_file_is_stale_where_more_than_rounding_differs(tmp_path):
    (tmp_path / "a.xml").write_text('<inertial mass="1.56343" diaginertia="0.0024383968261699456 -3e-6 0"/>')
    here = '<inertial mass="1.56343" diaginertia="0.002438396826169945 -3.0000000000000005e-06 0"/>'
    assert build.stale(tmp_path, {"a.xml": here}) == []
    assert build.stale(tmp_path, {"a.xml": here, "b.xml": ""}) == ["b.xml"]
    for old, new in (("1.56343", "1.56344"), ("-3.", "3."), ("mass", "gain"), (" 0", "")):
        assert build.stale(tmp_path, {"a.xml": here.replace(old, new)}) == ["a.xml"]


@pytest.mark.parametrize("robot", ROBOTS)
def test_names_are_the_contracts(robot):
    model, _ = load(robot)
    obj = mujoco.mjtObj
    joints = names.FINGERS if robot == "gripper_ta11" else names.TIAGO_JOINTS
    assert tuple(model.actuator(i).name for i in range(model.nu)) == joints
    assert has(model, obj.mjOBJ_SITE, names.GRASP_SITE)
    assert has(model, obj.mjOBJ_BODY, names.GRIPPER_BODY)
    for side in names.SIDES:
        assert model.geom(names.PAD_GEOM[side]).bodyid[0] == model.body(names.PAD_BODY[side]).id
        assert model.site(names.PAD_SITE[side]).bodyid[0] == model.body(names.PAD_BODY[side]).id
        assert has(model, obj.mjOBJ_SENSOR, names.TOUCH_SENSOR[side])
        cell = robot in TA11  # the standard fingers have no load cell
        assert has(model, obj.mjOBJ_BODY, names.LOAD_CELL_BODY[side]) == cell
        assert has(model, obj.mjOBJ_SITE, names.LOAD_CELL_SITE[side]) == cell
        assert has(model, obj.mjOBJ_SENSOR, names.FORCE_SENSOR[side]) == cell


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_solver_is_set_for_grasping_and_the_time_step_is_left_to_the_scene(robot):
    model, _ = load(robot)
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.impratio == 10
    assert model.opt.timestep == mujoco.MjModel.from_xml_string("<mujoco/>").opt.timestep


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("opening", [0.0, 0.01, 0.045])
def test_the_gap_between_the_pads_follows_the_fingers(robot, opening):
    model, data = load(robot)
    for joint in names.FINGERS:
        data.joint(joint).qpos = opening
    mujoco.mj_kinematics(model, data)
    right, left = (model.geom(names.PAD_GEOM[side]).id for side in names.SIDES)
    gap = mujoco.mj_geomDistance(model, data, right, left, 0.2, None)
    rest = 0.0004 if robot in TA11 else 0.0  # TA11: each pad's face is 0.2 mm behind the middle
    assert gap == pytest.approx(2 * opening + rest, abs=1e-6)  # MuJoCo's own tolerance for box distances


@pytest.mark.parametrize("robot", TA11)
def test_the_ta11_pad_is_29_mm_across_and_the_beam_its_own_body(robot):
    model, _ = load(robot)
    for side in names.SIDES:
        np.testing.assert_allclose(2 * model.geom(names.PAD_GEOM[side]).size[1:], 0.0292)
        beam = model.body(names.LOAD_CELL_BODY[side])
        assert beam.mass[0] == pytest.approx(0.0463)
        assert model.body(names.PAD_BODY[side]).parentid[0] == beam.id


def test_the_three_bodies_of_the_ta11_finger_add_up_to_the_measured_finger():
    # The finger as one body, from its mesh: 90.9 g, centre and moments about it (models/PROVENANCE.md).
    model, data = load("gripper_ta11")
    data.joint("gripper_right_finger_joint").qpos = 0
    mujoco.mj_forward(model, data)
    bodies = [
        model.body(name).id for name in ("gripper_right_finger_link", "right_load_cell_link", "right_fingertip_link")
    ]
    masses, centres = model.body_mass[bodies], data.xipos[bodies] - data.body("gripper_right_finger_link").xpos
    centre = masses @ centres / masses.sum()
    inertia = np.zeros((3, 3))
    for body, offset in zip(bodies, centres - centre, strict=True):
        axes = data.ximat[body].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += model.body_mass[body] * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    assert masses.sum() == pytest.approx(0.0909, abs=2e-4)  # rounding of the three masses
    np.testing.assert_allclose(centre, [0.00483, 0.00689, -0.13457], atol=1e-5)
    expected = np.array([[163.6, 9.7, 46.4], [9.7, 179.1, -25.2], [46.4, -25.2, 31.8]]) * 1e-6
    np.testing.assert_allclose(inertia, expected, atol=0.4e-6)  # 0.2 % of the largest: the mass's rounding


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_left_finger_is_the_right_one_turned_by_half_a_turn(robot):
    model, data = load(robot)
    turn = np.diag([-1.0, -1.0, 1.0])
    hand, axes = data.body(names.GRIPPER_BODY).xpos, data.body(names.GRIPPER_BODY).xmat.reshape(3, 3)

    def inertial(name: str) -> tuple[np.ndarray, np.ndarray]:
        body = model.body(name).id
        frame = axes.T @ data.ximat[body].reshape(3, 3)
        return axes.T @ (data.xipos[body] - hand), frame @ np.diag(model.body_inertia[body]) @ frame.T

    pairs = [("gripper_right_finger_link", "gripper_left_finger_link"), ("right_fingertip_link", "left_fingertip_link")]
    for right, left in pairs + ([("right_load_cell_link", "left_load_cell_link")] if robot in TA11 else []):
        (centre, tensor), (left_centre, left_tensor) = inertial(right), inertial(left)
        np.testing.assert_allclose(left_centre, turn @ centre, atol=1e-12)
        np.testing.assert_allclose(left_tensor, turn @ tensor @ turn, atol=1e-12)
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body(right).id]
        left_geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body(left).id]
        for a, b in zip(geoms, left_geoms, strict=True):
            np.testing.assert_allclose(
                axes.T @ (data.geom_xpos[b] - hand), turn @ axes.T @ (data.geom_xpos[a] - hand), atol=1e-12
            )


@pytest.mark.parametrize(("side", "outward"), [("right", 1.0), ("left", -1.0)])
def test_a_pressed_pad_reads_a_positive_force_on_the_load_cell(side, outward):
    model, data = load("gripper_ta11")
    data.xfrc_applied[model.body(names.PAD_BODY[side]).id, 0] = 5.0 * outward  # away from the other finger
    mujoco.mj_step(model, data, 1500)  # 3 s: 75 time constants of the servo
    reading = data.sensor(names.FORCE_SENSOR[side]).data
    assert reading[0] == pytest.approx(5.0, abs=1e-6)
    weight = 9.81 * sum(model.body(b[side]).mass[0] for b in (names.LOAD_CELL_BODY, names.PAD_BODY))
    assert np.linalg.norm(reading[1:]) == pytest.approx(weight, rel=1e-6)  # the cell also carries beam and pad


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_touch_sensors_feel_all_of_a_grasp(robot):
    # The gripper points down (gripper_link's -z): a ball between the pads, held without gravity.
    spec = mujoco.MjSpec.from_file(str(model_file(f"robots/{robot}.xml")))
    spec.option.gravity = [0, 0, 0]
    plain = spec.compile()
    data = mujoco.MjData(plain)
    mujoco.mj_resetDataKeyframe(plain, data, 0)
    mujoco.mj_forward(plain, data)
    ball = spec.worldbody.add_body(name="ball", pos=data.site(names.GRASP_SITE).xpos)
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=0.1)
    for key in list(spec.keys):
        spec.delete(key)
    model = spec.compile()
    held = mujoco.MjData(model)
    held.qpos[: plain.nq] = data.qpos
    held.act[:] = data.act
    for servo in names.FINGERS:
        held.act[model.actuator(servo).actadr] = (
            0.012  # 8 mm into the ball: up to 16 N, less what the soft contact gives way
        )
    mujoco.mj_step(model, held, 3000)
    touch = [held.sensor(names.TOUCH_SENSOR[side]).data[0] for side in names.SIDES]
    force = [held.actuator(servo).force[0] for servo in names.FINGERS]
    assert touch[0] == pytest.approx(touch[1], rel=1e-3)
    np.testing.assert_allclose(touch, np.abs(force), rtol=1e-3)
    assert min(touch) > 5


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("timestep", [0.002, 1 / 240])
def test_the_pre_grasp_pose_is_held_against_gravity_without_contact(robot, timestep):
    model, data = load(robot)
    model.opt.timestep = timestep
    assert data.ncon == 0
    for _ in range(int(5 / timestep)):
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos - model.key("pre_grasp").qpos).max() < 1e-6
    assert (np.abs(data.qfrc_actuator) <= model.jnt_actfrcrange[:, 1]).all()


@pytest.mark.parametrize("robot", ["tiago_ta11", "tiago_pal_gripper"])
def test_gravity_compensation_counts_against_the_effort_limit(robot):
    model, data = load(robot)
    assert data.qfrc_actuator[0] == pytest.approx(data.qfrc_gravcomp[0])
    model.jnt_actfrcrange[0] = -100, 100  # less than the 172 N that the torso needs
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == 100


@pytest.mark.parametrize("robot", ["tiago_ta11", "tiago_pal_gripper"])
def test_the_arm_servos_are_about_critically_damped_in_the_pre_grasp_pose(robot):
    model, data = load(robot)
    dense = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, dense)
    for i, name in enumerate(names.TORSO + names.ARM):
        kp, kv = model.actuator(name).gainprm[0], -model.actuator(name).biasprm[2]
        ratio = (kv + np.ravel(model.dof_damping[i])[0]) / (2 * np.sqrt(kp * dense[i, i]))
        assert 0.95 < ratio < 1.05, name  # the gains are rounded to two or three digits, and serve both hands


def test_the_fingers_lag_by_40_ms_as_the_real_servo_does():
    model, data = load("gripper_ta11")
    model.opt.timestep = 1e-4
    for joint in names.FINGERS:
        data.actuator(joint).ctrl = -0.05
    mujoco.mj_step(model, data, 5000)  # 0.5 s: 12 time constants
    behind = data.qpos - data.act
    # damping * v / kp = 80 * 0.05 / 2000 = 2 mm at 0.05 m/s
    np.testing.assert_allclose(behind, 0.002, rtol=1e-3)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_servos_stay_within_speed_range_and_effort(robot):
    model, data = load(robot)
    rng = np.random.default_rng(4)
    for _ in range(200):
        data.ctrl[:] = rng.uniform(-1e3, 1e3, model.nu)
        mujoco.mj_step(model, data, 10)
        assert (np.abs(data.qfrc_actuator) <= model.jnt_actfrcrange[:, 1] + 1e-9).all()
        assert (data.act >= model.jnt_range[:, 0]).all()
        assert (data.act <= model.jnt_range[:, 1]).all()
    from tiago_mj.models.limits import joint_limits

    for i in range(model.nu):
        velocity = joint_limits(model, model.actuator(i).name).velocity
        assert tuple(model.actuator_ctrlrange[i]) == (-velocity, velocity)


@pytest.mark.parametrize("robot", ROBOTS)
def test_visual_geoms_neither_collide_nor_weigh(robot):
    model, _ = load(robot)
    visual = model.geom_group == 2
    assert visual.sum() >= 20
    assert not model.geom_contype[visual].any()
    assert not model.geom_conaffinity[visual].any()
    source = mujoco.MjSpec.from_file(str(model_file(f"robots/{robot}.xml")))
    assert all(geom.mass == 0 for geom in source.geoms)


@pytest.mark.parametrize("robot", ["tiago_ta11", "tiago_pal_gripper"])
def test_neighbouring_links_never_touch_and_the_arm_meets_the_trunk(robot):
    model, data = load(robot)
    rng = np.random.default_rng(5)
    touching = set()
    for _ in range(2000):
        data.qpos[:] = rng.uniform(*model.jnt_range.T)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for geoms in data.contact.geom:
            touching.add(frozenset(model.body(model.geom_bodyid[g]).name for g in geoms))
    trunk = {
        "base_link",
        "torso_fixed_link",
        "torso_fixed_column_link",
        "torso_lift_link",
        "head_1_link",
        "head_2_link",
    }
    near = trunk | {"arm_1_link", "arm_2_link"}
    pads = frozenset(names.PAD_BODY.values())
    for pair in touching - {pads}:
        assert len(pair & near) == 1, pair  # one of the trunk or the shoulder, one from the upper arm on
    for neighbours in (
        ("torso_lift_link", "base_link"),
        ("torso_lift_link", "arm_2_link"),
        ("torso_lift_link", "arm_3_link"),
        ("arm_1_link", "arm_3_link"),
        ("arm_1_link", "torso_fixed_column_link"),
    ):
        assert frozenset(neighbours) not in touching
    assert frozenset(("arm_5_link", "torso_lift_link")) in touching
    assert frozenset((names.GRIPPER_BODY, "base_link")) in touching


def test_pads_meet_objects_and_each_other():
    model, _ = load("tiago_ta11")
    right, left = (model.geom(names.PAD_GEOM[side]) for side in names.SIDES)
    assert right.contype & left.conaffinity
    assert right.priority > 0
    for geom in (model.geom(i) for i in range(model.ngeom)):
        if geom.group == 3:
            assert 1 & geom.conaffinity, geom.name  # an object's default contype is 1


def test_a_missing_model_file_is_answered_with_those_that_exist():
    with pytest.raises(FileNotFoundError, match=r"robots/gripper_ta11\.xml"):
        model_file("robots/panda.xml")
