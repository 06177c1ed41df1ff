"""What joints with friction, play, springs, inertia and loads do, measured from outside in a rollout."""

import mujoco
import numpy as np
import pytest
from effects_bench import (
    DAMPING,
    FINGER_MASS,
    FORCE_LIMIT,
    FREE,
    KP,
    PERIOD,
    TIAGO,
    crossing,
    entry,
    free,
    grasp,
    make,
    rollout,
    shows,
)

from tiago_mj.effects.inertia import own_inertia, removable_inertia
from tiago_mj.effects.transmission.spring import polynomial, sum_of_springs
from tiago_mj.models import names

OPEN = 0.045  # where the fingers start [m]
RIGHT_FINGER, LEFT_FINGER = names.FINGERS
GRAVITY = 9.81  # m/s²


def friction_at(effects, speed, seconds=0.55):
    """What a joint's friction takes at constant speed: effort beyond the damping's, in the direction of motion [N]."""
    start = ((-0.06, 0.6),) if speed > 0 else ()
    r = free(effects, *start, (speed, seconds))
    return np.sign(speed) * r.effort[-1, 0] - DAMPING * abs(speed)


# Dry friction --------------------------------------------------------------------------------------------------------


@shows("coulomb_friction")
def test_coulomb_friction_holds_the_finger_where_it_stands_until_the_servo_pulls_harder():
    effect = {"coulomb_friction": {"force": 2.0}}
    held = free(effect, (-0.009, 0.1), (0.0, 2.0))
    # 1.8 N pull against 2 N. MuJoCo's default friction would let the finger creep all the 0.9 mm within half a second;
    # the effect's solver parameters leave it a hundredth of that in 2 s.
    assert np.abs(held.true_position - OPEN).max() < 0.011 * 9e-4
    np.testing.assert_allclose(held.set_point[-1], OPEN - 9e-4, atol=1e-9)
    pulled = free(effect, (-0.01, 0.3))
    pull = KP * 0.01 * crossing(pulled.time, OPEN - pulled.true_position[:, 0], 2e-5)
    # It breaks away at 2 N; against its damping a pull that grows by 20 N/s takes it 20 µm on in 13 ms.
    assert pull - 20 * np.sqrt(2 * 2e-5 * DAMPING / 20) == pytest.approx(2.0, abs=20 * PERIOD)


@shows("coulomb_friction")
def test_a_finger_with_coulomb_friction_stops_short_by_force_over_stiffness_and_stays_there():
    r = free({"coulomb_friction": {"force": 2.0}}, (-0.02, 1.0), (0.0, 4.0))
    short = (r.true_position - r.set_point)[:, 0]
    # It comes to rest where the pull is down to the friction, and creeps by half a percent of that a second.
    assert short[360] == pytest.approx(2.0 / KP, rel=0.01)
    assert short[-1] == pytest.approx(short[360], rel=0.005 * 3.5)


@shows("coulomb_friction", "stribeck_friction", "asymmetric_friction", "load_dependent_friction", "viscous_friction")
@pytest.mark.parametrize(
    ("effects", "closing", "opening"),
    [
        (None, 0.0, 0.0),
        ({"coulomb_friction": {"force": 3.0}}, 3.0, 3.0),
        ({"viscous_friction": {"damping": 40.0}}, 40 * 0.06, 40 * 0.06),
        ({"stribeck_friction": {"static": 3.0, "velocity": 0.01}}, 0.0, 0.0),  # e^-36 of it at 0.06 m/s
        ({"stribeck_friction": {"static": 3.0, "velocity": 0.06}}, 3 / np.e, 3 / np.e),
        ({"asymmetric_friction": {"force": 2.0}}, 0.0, 2.0),  # nothing can be taken from a joint without friction
        ({"coulomb_friction": {"force": 3.0}, "asymmetric_friction": {"force": 2.0}}, 1.0, 5.0),
        # The servo's force F carries 4.8 N of damping and its own friction: F = 4.8 / (1 - coefficient).
        ({"load_dependent_friction": {"coefficient": 0.15}}, 4.8 * 0.15 / 0.85, 4.8 * 0.15 / 0.85),
    ],
    ids=str,
)
def test_at_constant_speed_the_servo_pays_for_the_friction_of_that_direction(effects, closing, opening):
    # After 0.55 s e^-9 of 7 N is left of the start's transient, with 40 N·s/m more; friction is soft by 0.01 %.
    assert friction_at(effects, -0.06) == pytest.approx(closing, abs=0.005)
    assert friction_at(effects, +0.06) == pytest.approx(opening, abs=0.005)


@shows("coulomb_friction", "viscous_friction")
@pytest.mark.parametrize("taken", [0.4, 1.0, 2.0])
@pytest.mark.parametrize(("name", "parameter"), [("coulomb_friction", "force"), ("viscous_friction", "damping")])
def test_reality_may_have_less_friction_than_the_model(name, parameter, taken):
    """TIAGo's arm_1 has 1 N·m of friction and 1 N·m·s/rad of damping: both can be taken away, and no more than that,
    whatever a calibration says."""
    action = np.zeros((240, 10))
    action[:, 1] = -0.1
    speed = 0.1 * 1.95  # rad/s
    nominal, less = (
        rollout(effects, action, TIAGO).effort[-1, 1]
        for effects in (None, entry(name, "arm_1_joint", **{parameter: {"value": -taken}}))
    )
    expected = min(taken, 1.0) * (speed if name == "viscous_friction" else 1.0)
    # The rest of the arm, which is moved along, pulls on the joint as before within that.
    assert less - nominal == pytest.approx(expected, abs=0.005)


@shows("stribeck_friction")
def test_stribeck_friction_must_be_broken_once_and_is_gone_in_motion():
    r = free({"stribeck_friction": {"static": 3.0, "velocity": 0.01}}, (-0.002, 1.2))
    pull = -r.effort[:, 0]
    leaves = int(np.argmax(OPEN - r.true_position[:, 0] > 2e-5))
    # The servo's pull grows by 0.017 N a row, and the finger is 20 µm on after some rows.
    assert pull[: leaves + 1].max() == pytest.approx(3.0, abs=0.1)
    # Then the finger leaps: half of the friction is gone at 8 mm/s.
    assert pull[leaves : leaves + 24].min() < 1.5
    assert np.abs(r.true_velocity[leaves : leaves + 24, 0]).max() > 0.02


@shows("load_dependent_friction")
def test_load_dependent_friction_keeps_a_share_of_the_squeeze_by_direction():
    coefficient = 0.15
    effect = {"load_dependent_friction": {"coefficient": coefficient}}
    r = grasp(effect, (-0.04, 0.7), (-0.003, 1.5), (0.0, 0.5), (0.003, 0.7), (0.0, 0.5))
    felt = r.force[240:] / -r.effort[240:]
    # At rest; the pads' damping and the friction's softness are below a percent.
    np.testing.assert_allclose(felt[int(1.7 * 240) - 1], 1 - coefficient, rtol=0.01)
    np.testing.assert_allclose(felt[-1], 1 + coefficient, rtol=0.01)


# Between motor and joint ---------------------------------------------------------------------------------------------


@shows("velocity_limit", "rate_limit")
def test_a_velocity_limit_holds_the_joint_back_while_the_servos_error_grows():
    limit = 0.03
    joint = free({"velocity_limit": {"velocity": limit}}, (-0.06, 0.5))
    servo = free({"rate_limit": {"velocity": limit}}, (-0.06, 0.5))
    for r in (joint, servo):
        np.testing.assert_allclose(-r.true_velocity[-1], limit, rtol=1e-3)
    # What resists is not known at once: at the start the limit is exceeded by a few per cent.
    assert -joint.true_velocity.min() < 1.04 * limit
    # Every second 30 mm of the command are missed; the servo's set point stays within its trail of 1.2 mm.
    np.testing.assert_allclose((joint.true_position - joint.set_point)[-1], 0.03 * 0.5, rtol=0.05)
    np.testing.assert_allclose((servo.true_position - servo.set_point)[-1], DAMPING * limit / KP, rtol=1e-3)


@shows("velocity_limit")
def test_a_velocity_limit_holds_against_the_full_force_of_the_servo():
    def pulled(core):
        core.data.act[:] = 0.0

    r = rollout({"velocity_limit": {"velocity": 0.04}}, np.zeros((120, 2)), FREE, prepare=pulled)
    assert np.abs(r.effort).max() < 0.3 * FORCE_LIMIT  # what 0.04 m/s take, 3.2 N, and a start
    assert -r.true_velocity.min() == pytest.approx(0.04, rel=0.04)
    np.testing.assert_allclose(-r.true_velocity[-1], 0.04, rtol=1e-3)


@shows("backlash")
@pytest.mark.parametrize("width", [0.001, 0.0004])
def test_backlash_loses_its_width_at_each_reversal(width):
    to_and_fro = ((-0.02, 0.5), (0.0, 0.6), (0.02, 0.25), (0.0, 0.6), (-0.02, 0.25), (0.0, 0.6))
    r = free({"backlash": {"width": width}}, *to_and_fro)
    rests = r.true_position[[int(t * 240) for t in (1.1, 1.95, 2.8)]]
    # Sent are strokes of 5 mm; e^-15 of the way is left at rest.
    np.testing.assert_allclose(np.diff(rests, axis=0), [[0.005 - width] * 2, [-0.005 + width] * 2], atol=1e-8)
    # The first stroke begins in the middle of the gap.
    np.testing.assert_allclose(rests[0], OPEN - 0.01 + width / 2, atol=1e-8)
    turn = int(1.1 * 240)
    waits = r.time[turn + int(np.argmax(r.true_position[turn:, 0] > rests[0, 0] + 1e-7))] - 1.1
    assert waits == pytest.approx(width / 0.02, abs=2 * PERIOD)


@shows("joint_elasticity")
def test_a_spring_in_series_yields_by_force_over_stiffness():
    stiff, elastic = (
        grasp(effects, (-0.04, 0.7), (0.0, 1.0)) for effects in (None, {"joint_elasticity": {"stiffness": 3000.0}})
    )
    for r, spring in ((stiff, np.inf), (elastic, 3000.0)):
        # Of the way from pad to set point the servo, the spring and the pad each take force / stiffness.
        yields = r.force[-1] * (1 / KP + 1 / spring)
        np.testing.assert_allclose((r.true_position - r.set_point)[-1], yields, rtol=2e-3)  # 5 mN on the table


@shows("armature")
@pytest.mark.parametrize("added", [0.3, 2.0, -0.05])
def test_armature_is_inertia(added):
    """At full force, impulse over velocity is the mass that moves: what damping took is known from the way."""

    def pulled(core):
        core.data.act[:] = 0.0

    def mass(effects):
        r = rollout(effects, np.zeros((200, 2)), FREE, prepare=pulled, control_hz=2000.0)
        k = int(np.argmax(-r.true_velocity[:, 0] > 0.1))  # half of the fastest, at full force all the while
        assert (r.effort[1 : k + 1] == -FORCE_LIMIT).all()
        damped = DAMPING * (OPEN - r.true_position[k])
        return (FORCE_LIMIT * k / 2000 - damped) / -r.true_velocity[k]

    # The integrator's damping is implicit: of one step of 0.5 ms, 0.04 kg, it makes an inertia.
    np.testing.assert_allclose(mass(None), FINGER_MASS, atol=0.02)
    np.testing.assert_allclose(mass({"armature": {"mass": added}}) - mass(None), added, rtol=0.01)


def test_a_motor_s_inertia_cannot_be_taken_so_far_that_a_lighter_body_leaves_none():
    """A servo of 0.028 kg·m² that turns a body of 0.00017: MuJoCo calls the mass matrix singular."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body><joint axis="0 0 1" armature="0.028"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.05"/></body></worldbody></mujoco>""")
    dofs = np.array([0])
    bodies = own_inertia(model, dofs)
    remains = 0.028 + bodies - removable_inertia(model, dofs)
    np.testing.assert_allclose(remains, 0.1 * bodies + 0.01 * 0.028)
    assert remains > 0.9 * bodies  # which a payload may take


@shows("coupling_error")
def test_a_coupling_error_moves_the_finger_that_was_not_commanded():
    r = free({"coupling_error": {"ratio": 0.1}}, ((-0.02, 0.0), 0.5), (0.0, 0.8))
    np.testing.assert_allclose(OPEN - r.true_position[-1], [0.01, 0.001], atol=1e-8)  # e^-20
    one = free(entry("coupling_error", RIGHT_FINGER, ratio=0.1), ((-0.02, 0.0), 0.5), (0.0, 0.8))
    np.testing.assert_allclose(OPEN - one.true_position[-1], [0.01, 0.0], atol=1e-8)


@shows("coupling_error")
def test_a_finger_coupled_to_the_others_motion_trails_it_once_more():
    by_motion = free({"coupling_error": {"ratio": 0.1, "of_motion": 1}}, ((-0.02, 0.0), 0.5), (0.0, 0.8))
    # The finger that moves is drawn on by what it does to the other: 1 / (1 - ratio²).
    np.testing.assert_allclose(OPEN - by_motion.true_position[-1], np.array([0.01, 0.001]) / 0.99, rtol=1e-6)
    by_set_point = free({"coupling_error": {"ratio": 0.1}}, ((-0.02, 0.0), 0.5), (0.0, 0.8))
    moving = slice(40, 110)
    behind = (by_motion.true_position - by_set_point.true_position)[moving, 1]
    # By one more lag of the servo, 40 ms at 2 mm/s.
    np.testing.assert_allclose(behind, 8e-5, rtol=0.15)


# Loads ---------------------------------------------------------------------------------------------------------------


def without_friction(core):
    """The servos alone hold the arm."""
    core.model.dof_frictionloss[:] = 0


@shows("payload")
@pytest.mark.parametrize("mass", [0.5, 1.5, -0.3])
def test_a_payload_weighs_on_every_joint_by_its_lever_arm(mass):
    r = rollout({"payload": {"mass": mass}}, np.zeros((360, 10)), TIAGO, prepare=without_friction)
    nominal = rollout(None, np.zeros((360, 10)), TIAGO, prepare=without_friction)
    core = make(None, TIAGO)
    core.reset(seed=0)
    core.data.qpos[core.qpos_address] = r.true_position[-1]  # the pose into which the arm sags
    mujoco.mj_forward(core.model, core.data)
    tool = np.zeros((3, core.model.nv))
    mujoco.mj_jacBodyCom(core.model, core.data, tool, None, core.model.body(names.GRIPPER_BODY).id)
    lever = tool[2, core._qvel_address]  # rise of the tool's centre of mass per radian [m]
    rise = (r.effort - nominal.effort)[-1]
    assert np.abs(lever[1:5]).max() > 0.2
    # The arm has come to rest within 1.5 s to a hundredth of a newton metre. The torso lies on its lower end stop, that
    # carries most of what comes on top.
    carried = slice(1 if mass > 0 else 0, None)
    np.testing.assert_allclose(rise[carried], mass * GRAVITY * lever[carried], rtol=0.01, atol=0.01)
    assert np.sign(mass) * (nominal.true_position - r.true_position)[-1] @ lever > 1e-4  # it sags, or rises


@shows("link_mass")
@pytest.mark.parametrize("factor", [1.2, 0.7])
def test_a_heavier_link_weighs_on_the_joints_that_carry_it_by_its_lever_arm(factor):
    effect = [{"name": "link_mass", "target": "arm_4_joint", "parameters": {"factor": factor}}]
    r = rollout(effect, np.zeros((360, 10)), TIAGO, prepare=without_friction)
    nominal = rollout(None, np.zeros((360, 10)), TIAGO, prepare=without_friction)
    core = make(None, TIAGO)
    core.reset(seed=0)
    core.data.qpos[core.qpos_address] = r.true_position[-1]
    mujoco.mj_forward(core.model, core.data)
    link, expected = int(core.model.joint("arm_4_joint").bodyid[0]), np.zeros(core.model.nv)
    for body in np.flatnonzero(core.model.body_weldid == link):
        jacobian = np.zeros((3, core.model.nv))
        mujoco.mj_jacBodyCom(core.model, core.data, jacobian, None, int(body))
        expected += (factor - 1) * core.model.body_mass[body] * GRAVITY * jacobian[2]
    rise = (r.effort - nominal.effort)[-1]
    carried = slice(1, 5)  # the torso may lie on its end stop; what is beyond the link does not carry it
    np.testing.assert_allclose(rise[carried], expected[core._qvel_address][carried], rtol=0.02, atol=0.01)
    assert np.abs(rise[5:]).max() < 0.01


@shows("link_centre_x", "link_centre_y", "link_centre_z")
@pytest.mark.parametrize(("axis", "offset"), [("x", 0.03), ("y", -0.04), ("z", 0.02)])
def test_a_link_whose_weight_acts_elsewhere_pulls_at_the_joints_that_carry_it(axis, offset):
    """Statically, by the virtual work of its weight: m g (dz/dq at the new centre - dz/dq at the old one); without
    MuJoCo's compensation of gravity, which follows the centre."""

    def bare(core):
        without_friction(core)
        core.model.body_gravcomp[:] = 0.0

    effect = [{"name": f"link_centre_{axis}", "target": "arm_4_joint", "parameters": {"offset": offset}}]
    nominal, r = (rollout(effects, np.zeros((360, 10)), TIAGO, prepare=bare) for effects in (None, effect))
    core = make(None, TIAGO)
    core.reset(seed=0)
    core.data.qpos[core.qpos_address] = r.true_position[-1]
    mujoco.mj_forward(core.model, core.data)
    model, data = core.model, core.data
    link, expected = int(model.joint("arm_4_joint").bodyid[0]), np.zeros(model.nv)
    along = data.xmat[link].reshape(3, 3)[:, "xyz".index(axis)]
    for body in np.flatnonzero(model.body_weldid == link):
        old, new = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, old, None, data.xipos[body], int(body))
        mujoco.mj_jac(model, data, new, None, data.xipos[body] + offset * along, int(body))
        expected += model.body_mass[body] * GRAVITY * (new - old)[2]
    rise = (r.effort - nominal.effort)[-1]
    carried = slice(1, 5)
    assert np.abs(expected[core._qvel_address][carried]).max() > 0.04
    np.testing.assert_allclose(rise[carried], expected[core._qvel_address][carried], rtol=0.03, atol=0.02)


@shows("torque_offset")
@pytest.mark.parametrize("force", [2.0, -1.0])
def test_a_constant_force_on_a_finger_moves_it_until_the_servo_gives_as_much(force):
    r = free({"torque_offset": {"force": force}}, (-0.02, 1.0), (0.0, 2.0))
    np.testing.assert_allclose((r.true_position - r.set_point)[-1], force / KP, rtol=0.01)


@shows("joint_spring")
@pytest.mark.parametrize("hardening", [0.0, 0.7])
def test_a_spring_holds_a_finger_between_its_slack_and_the_set_point(hardening):
    stiffness, rest, low, high = 600.0, 0.045, 0.0, 0.045
    effect = {"joint_spring": {"stiffness": stiffness, "rest": rest, "hardening": hardening}}
    r = free(effect, (-0.02, 1.0), (0.0, 2.0))
    factors = stiffness * polynomial(rest, hardening, low, high, high - low)

    def pulls(position):
        return np.polyval([*reversed(factors), 0.0], position - rest)

    assert pulls(high) - pulls(low) == pytest.approx(stiffness * (high - low)), "the mean stiffness is the stated one"
    pull = pulls(r.true_position[-1])
    assert np.abs(pull).min() > 2
    np.testing.assert_allclose(KP * (r.set_point - r.true_position)[-1], pull, rtol=1e-3)


def test_two_springs_side_by_side_pull_as_one():
    one, other = (0.03, np.array([300.0, 0.0, 0.0])), (0.01, np.array([250.0, 40.0, 9000.0]))
    both = sum_of_springs(one, other)
    assert 0.01 < both[0] < 0.03
    for position in (-0.02, 0.013, 0.04):
        pulls = [np.polyval([*reversed(factors), 0.0], position - rest) for rest, factors in (one, other, both)]
        assert pulls[2] == pytest.approx(pulls[0] + pulls[1])


@shows("gravity_tilt")
@pytest.mark.parametrize("angle", [0.1, -0.3])
def test_under_a_tilt_a_free_object_falls_sideways(angle):
    """By the right-hand rule about the axis from the right to the left finger, here y."""

    def lifted(core):
        core.data.joint(names.OBJECT_JOINT).qpos[2] += 0.3

    steps = 30
    r = rollout({"gravity_tilt": {"angle": angle}}, np.ones((steps, 2)), prepare=lifted)
    way = r.state[:, 2:5]
    acceleration = np.diff(way, 2, axis=0)[5:] / PERIOD**2
    # Nothing touches it: exact but for the rounding of second differences, 1e-16 / PERIOD².
    expected = GRAVITY * np.array([-np.sin(angle), 0.0, -np.cos(angle)])
    np.testing.assert_allclose(acceleration, np.tile(expected, (len(acceleration), 1)), atol=1e-8)
