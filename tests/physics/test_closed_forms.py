"""The scene against what a textbook says: free fall, Coulomb's cone, the inclined plane, the servo's spring."""

import gymnasium
import mujoco
import numpy as np
import pytest

import tiago_mj  # noqa: F401

G = 9.81


@pytest.fixture
def env():
    made = gymnasium.make("tiago_mj/GripperTactile-v0", object_offset=0).unwrapped
    made.reset(seed=0)
    return made


def test_a_released_object_falls_freely(env):
    env.data.joint("object_joint").qpos[:3] = [0.0, 0.0, 2.0]  # away from everything
    mujoco.mj_forward(env.model, env.data)
    for _ in range(60):
        env.step([0.0, 0.0])
    time, h = 60 / 240, env.model.opt.timestep
    fallen = 2.0 - env.state.object_pose[2]
    # The integrator is semi-implicit: it is one half step ahead, g t h / 2, exactly.
    assert fallen == pytest.approx(G * time**2 / 2 + G * time * h / 2, rel=1e-6)


def squeeze(env, newtons):
    """Both fingers pushed onto the object with that force, through the servo's spring; returns the normal forces."""
    for _ in range(400):
        error = newtons - env.state.force_contact
        env.step(np.clip(-error * 0.01 / 0.08, -1, 1))
    return env.state.force_contact


@pytest.mark.parametrize(("share", "slips"), [(0.5, False), (0.9, False), (1.5, True)])
def test_a_held_object_slips_only_outside_the_friction_cone(env, share, slips):
    """Inside the cone contacts creep at force / (damping · impratio) (docs/compliance.md); outside, the object is lost.

    Just outside (up to 1.2) MuJoCo's convex contacts press harder while they slide, and the object leaves slowly.
    """
    normal = squeeze(env, 8.0)
    friction = env.model.pair_friction[0, 0]
    cone = friction * normal.sum()
    body = env.model.body("object").id
    # lift the object's weight and then pull it up, so that the table plays no part
    env.data.xfrc_applied[body, 2] = env.model.body_mass[body] * G + share * cone
    start = env.state.object_pose[2]
    for _ in range(24):
        env.step([0.0, 0.0])
    moved = env.state.object_pose[2] - start
    creep = share * cone / (2 * 100 * env.model.opt.impratio) * 0.1
    if slips:
        assert moved > 20 * creep / share
    else:
        assert moved == pytest.approx(creep, rel=0.05)


@pytest.mark.parametrize(("degrees", "slides"), [(30, False), (55, True)])
def test_the_object_slides_on_a_table_steeper_than_the_friction_angle(env, degrees, slides):
    """Friction 1 is an angle of 45°. Low and flat, so that it slides before it topples."""
    angle = np.radians(degrees)
    env.data.joint("object_joint").qpos[:3] = [0.6, -0.2, env.data.joint("object_joint").qpos[2]]
    box = gymnasium.make("tiago_mj/GripperTactile-v0", object="box", object_width=0.04, object_offset=0).unwrapped
    box.reset(seed=0)
    box.model.opt.gravity[:] = [G * np.sin(angle) * -1, 0, -G * np.cos(angle)]
    joint = box.data.joint("object_joint")
    joint.qpos[:3] = [0.6, -0.2, 0.545 + 0.02]
    joint.qpos[3:] = [np.sqrt(0.5), 0, np.sqrt(0.5), 0]  # lying: 0.1 m along the slope, 0.04 m high
    mujoco.mj_forward(box.model, box.data)
    for _ in range(60):
        box.step([0.0, 0.0])
    travelled = 0.6 - box.state.object_pose[0]
    if slides:
        expected = G * (np.sin(angle) - np.cos(angle)) * 0.25**2 / 2
        assert travelled == pytest.approx(expected, rel=0.1)
    else:
        assert abs(travelled) < 0.003


def test_a_pushed_finger_gives_way_by_force_over_the_servos_stiffness(env):
    env.data.joint("gripper_right_finger_joint").qfrc_applied[:] = -3.0
    for _ in range(240):
        env.step([0.0, 0.0])
    assert 0.045 - env.state.position[0] == pytest.approx(3.0 / 2000, rel=1e-3)


def test_a_held_grasp_is_two_springs_in_series(env):
    """A finger's servo (2000 N/m) against the contact (10 kN/m): 1667 N per metre of set point."""
    squeeze(env, 4.0)
    before, set_point = env.state.force_contact.copy(), env.data.act.copy()
    for _ in range(12):
        env.step([-0.1, -0.1])
    for _ in range(100):
        env.step([0.0, 0.0])
    gained = (env.state.force_contact - before) / (set_point - env.data.act)
    assert gained == pytest.approx(1 / (1 / 2000 + 1 / 10_000), rel=0.01)
