"""Commands become motion as the named servo would have it."""

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401


def fingers(servo, actions, **arguments):
    env = gymnasium.make("tiago_mj/GripperClose-v0", servo=servo, **arguments).unwrapped
    env.reset(seed=0)
    states = []
    for action in actions:
        env.step(np.full(2, action))
        states.append((env.state.position[0], env.state.velocity[0]))
    return env, np.array(states)


def test_the_pal_servo_lags_a_constant_velocity_by_damping_over_stiffness():
    _, states = fingers("pal", [-0.5] * 96)
    time = 96 / 240
    commanded = 0.045 - 0.5 * 0.08 * time
    lag = (states[-1, 0] - commanded) / 0.04
    assert lag == pytest.approx(80 / 2000, rel=0.01)
    assert states[-1, 1] == pytest.approx(-0.04, rel=1e-3)


def test_the_ideal_servo_has_its_velocity_within_two_control_steps():
    _, states = fingers("ideal", [-1.0, -1.0, -1.0, 0.5, 0.5, 0.5])
    assert states[1:3, 1] == pytest.approx(-0.08, rel=0.02)
    assert states[4:, 1] == pytest.approx(0.04, rel=0.03)


@pytest.mark.parametrize("servo", ["pal", "ideal"])
def test_a_blocked_finger_pushes_with_its_effort_limit_and_no_more(servo):
    env = gymnasium.make("tiago_mj/GripperTactile-v0", servo=servo, object_offset=0).unwrapped
    env.reset(seed=0)
    for _ in range(280):
        env.step([-1.0, -1.0])
    assert env.state.force_contact == pytest.approx(16.0, rel=0.01)


@pytest.mark.parametrize("servo", ["pal", "ideal"])
@pytest.mark.parametrize("hz", [240, 25])
def test_position_control_reaches_its_target_no_faster_than_the_limit(servo, hz):
    action = 2 * 0.02 / 0.045 - 1  # 20 mm
    _, states = fingers(servo, [action] * (2 * hz), control="position", control_hz=hz)
    assert states[-1, 0] == pytest.approx(0.02, abs=1e-4)
    # A position servo may swing a little past the speed of its set point, as the real one does.
    assert np.abs(states[:, 1]).max() < 0.08 * 1.05


def test_every_joint_of_tiago_follows_its_own_velocity_command():
    env = gymnasium.make("tiago_mj/TIAGoTactile-v0", servo="ideal").unwrapped
    env.reset(seed=0)
    inward = np.where(env.data.qpos[:10] > env._range.mean(axis=1), -1.0, 1.0)
    for _ in range(12):  # before the arm meets the table
        env.step(0.2 * inward)
    np.testing.assert_allclose(env.state.velocity / env.velocity_limit, 0.2 * inward, atol=0.005)


def test_tiago_holds_its_pose_under_gravity():
    env = gymnasium.make("tiago_mj/TIAGoTactile-v0").unwrapped
    env.reset(seed=0)
    start = env.state.position.copy()
    for _ in range(300):
        env.step(np.zeros(10))
    np.testing.assert_allclose(env.state.position, start, atol=1e-4)


@pytest.mark.parametrize("hz", [25, 50, 100, 240, 1000])
def test_the_physics_step_divides_every_control_period(hz):
    env = gymnasium.make("tiago_mj/GripperTactile-v0", control_hz=hz).unwrapped
    assert env.dt == pytest.approx(1 / hz)
    assert env.model.opt.timestep <= 1 / 480 + 1e-12
    env.reset(seed=0)
    env.step([0.0, 0.0])
    assert env.data.time == pytest.approx(1 / hz)
