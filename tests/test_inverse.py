"""Inverse dynamics along a motion: against closed forms and against the forward simulation."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tiago_mj.models import inverse, names

PENDULUM = """
<mujoco><worldbody><body>
  <joint name="swing" axis="0 1 0" damping="0.3"/>
  <inertial pos="0 0 -0.5" mass="2" diaginertia="0.01 0.02 0.01"/>
</body></worldbody><keyframe><key name="pre_grasp" qpos="0"/></keyframe></mujoco>
"""


def sine(
    amplitude: float, hertz: float, *, seconds: float = 20.0, jitter: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Recorded times and angles of a sine, (S,) and (S, 1)."""
    time = np.arange(0, seconds, 0.01) + jitter * np.random.default_rng(0).uniform(-1, 1, round(seconds * 100))
    return time, amplitude * np.sin(2 * np.pi * hertz * time)[:, None]


def test_a_swinging_pendulum_needs_the_torque_of_its_closed_form():
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    time, angle = sine(0.6, 0.4, jitter=0.002)
    motion = inverse.motion(("swing",), time, angle, rate=100.0, cutoff=5.0)
    q, v, a = motion.position[:, 0], motion.velocity[:, 0], motion.acceleration[:, 0]
    expected = (0.02 + 2 * 0.5**2) * a + 0.3 * v + 2 * 9.81 * 0.5 * np.sin(q)
    np.testing.assert_allclose(inverse.torque(model, motion)[:, 0], expected, atol=1e-9)


def test_velocity_and_acceleration_of_jittering_positions_are_those_of_the_motion():
    time, angle = sine(0.6, 0.4, jitter=0.002)
    motion = inverse.motion(("swing",), time, angle, rate=100.0, cutoff=5.0)
    inner = slice(100, -100)  # a filter that looks both ways has no other side at the ends
    omega = 2 * np.pi * 0.4
    expected = 0.6 * np.sin(omega * motion.time[inner])
    # Linear interpolation between samples 10 ms apart and central differences cost some 1e-4 here; 1 % is far above.
    np.testing.assert_allclose(motion.position[inner, 0], expected, atol=0.006)
    velocity = 0.6 * omega * np.cos(omega * motion.time[inner])
    np.testing.assert_allclose(motion.velocity[inner, 0], velocity, atol=0.01 * 0.6 * omega)
    np.testing.assert_allclose(motion.acceleration[inner, 0], -(omega**2) * expected, atol=0.01 * 0.6 * omega**2)


def test_the_low_pass_keeps_what_is_slow_where_it_is_and_takes_what_is_fast():
    time = np.arange(0, 20, 0.01)
    slow, fast = np.sin(2 * np.pi * 0.3 * time), np.sin(2 * np.pi * 30 * time)
    kept = inverse.low_pass((slow + fast)[:, None], rate=100.0, cutoff=3.0)[200:-200, 0]
    np.testing.assert_allclose(kept, slow[200:-200], atol=1e-4)  # no lag: a shift of one sample would be 0.02


def test_the_arm_needs_in_inverse_what_drove_it_forward():
    model = inverse.free_model("tiago_ta11")
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    data.qpos[:] = model.key("pre_grasp").qpos
    joints = names.TIAGO_JOINTS
    address = [int(model.joint(name).qposadr[0]) for name in joints]
    dofs = [int(model.joint(name).dofadr[0]) for name in joints]
    data.qvel[dofs] = [0.02, *np.linspace(-0.4, 0.4, 7), 0.01, -0.01]
    mujoco.mj_forward(model, data)
    applied = np.array(data.qfrc_bias[dofs])  # hold the weight, and push
    applied[1:5] += [5.0, -8.0, 4.0, 3.0]
    data.qfrc_applied[dofs] = applied
    model.actuator_gainprm[:], model.actuator_biasprm[:] = 0, 0
    mujoco.mj_forward(model, data)
    motion = inverse.Motion(
        joints,
        np.zeros(1),
        data.qpos[None, address].copy(),
        data.qvel[None, dofs].copy(),
        data.qacc[None, dofs].copy(),
    )
    # Forward dynamics solves for the friction of the joints to its own tolerance; the inverse is exact.
    np.testing.assert_allclose(inverse.torque(model, motion)[0], applied, atol=1e-3)


def test_the_free_arm_carries_its_own_weight():
    model = inverse.free_model("tiago_ta11")
    pose = model.key("pre_grasp").qpos[None, [model.joint(name).qposadr[0] for name in names.TORSO]]
    still = inverse.Motion(names.TORSO, np.zeros(1), pose, np.zeros((1, 1)), np.zeros((1, 1)))
    carried = model.body_subtreemass[model.body("torso_lift_link").id]
    assert inverse.torque(model, still)[0, 0] == pytest.approx(9.81 * carried, rel=1e-6)


def test_agreement_of_signals_with_a_known_gap():
    measured = np.array([1.0, -1.0, 1.0, -1.0]) * 2
    half = inverse.agreement("arm_1_joint", measured, measured / 2 + 0.5)
    assert half.measured_rms == pytest.approx(2)
    assert half.bias == pytest.approx(-0.5)
    assert half.gap_rms == pytest.approx(np.sqrt(1 + 0.25))
    assert half.explained == pytest.approx(0.75)  # a quarter of the variance is left
    assert inverse.agreement("arm_1_joint", measured, measured + 3).explained == pytest.approx(1)
    assert inverse.agreement("arm_1_joint", measured, -measured).explained == pytest.approx(-3)


@pytest.mark.parametrize(
    ("time", "values", "said"),
    [
        (np.array([0, 0.01, 0.01, 0.02]), np.zeros((4, 1)), "time does not increase at row 3"),
        (np.array([0, 0.01, np.nan]), np.zeros((3, 1)), "row 3 is not finite"),
        (np.array([0, 0.01, 0.02]), np.array([[0], [np.inf], [0]]), "row 2 is not finite"),
        (np.array([0, 0.01]), np.zeros((3, 1)), "do not belong together"),
    ],
)
def test_a_recording_that_cannot_be_resampled_is_refused_with_its_row(time, values, said):
    with pytest.raises(ValueError, match=said):
        inverse.uniform(time, values, 100.0)


def test_a_cut_off_above_half_the_rate_is_refused():
    with pytest.raises(ValueError, match="below half the rate, 50 Hz"):
        inverse.low_pass(np.zeros((100, 1)), rate=100.0, cutoff=60.0)


def test_a_joint_that_the_model_lacks_is_named():
    motion = inverse.Motion(("elbow",), np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)))
    with pytest.raises(ValueError, match=r"no joint 'elbow': it has .*arm_1_joint"):
        inverse.torque(inverse.free_model("tiago_ta11"), motion)


def test_a_torque_that_never_changes_is_refused():
    with pytest.raises(ValueError, match="arm_5_joint is constant"):
        inverse.agreement("arm_5_joint", np.zeros(10), np.ones(10))
