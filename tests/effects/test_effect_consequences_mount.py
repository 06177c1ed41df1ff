"""What a base that gives way does to an arm, against MuJoCo's own hinges below the base."""

import mujoco
import mujoco.batch
import numpy as np
import pytest
from effects_bench import shows

from tiago_mj.effects import Entry
from tiago_mj.effects.host import BatchHost, ScalarHost
from tiago_mj.effects.mount import MOUNT_DAMPING
from tiago_mj.effects.runner import Runner
from tiago_mj.effects.wiring import wire

JOINTS = ("turn", "lift", "bend")
STEP, PERIOD = 0.002, 0.01  # s
GRAVITY = 9.81  # m/s²
LIGHT = "1e-6 1e-6 1e-6"  # inertia of a base that has none


def arm(base):
    """Three joints on a base, with hinges below it where ``base`` has some."""
    servos = zip(JOINTS, (300, 600, 200), (20, 30, 8), strict=True)
    actuators = "".join(f'<position name="{name}" joint="{name}" kp="{kp}" kv="{kv}"/>' for name, kp, kv in servos)
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{STEP}" integrator="implicitfast"/>
      <worldbody><body>{base}
        <body pos="0 0 .1"><joint name="turn" axis="0 0 1" armature=".05" damping=".5"/>
          <geom type="capsule" fromto="0 0 0 0 0 .2" size=".04" mass="2"/>
          <body pos="0 0 .2"><joint name="lift" axis="0 1 0" armature=".05" damping=".5"/>
            <geom type="capsule" fromto="0 0 0 .3 0 0" size=".04" mass="2"/>
            <body pos=".3 0 0"><joint name="bend" axis="0 1 0" armature=".02" damping=".2"/>
              <geom type="capsule" fromto="0 0 0 .25 0 .05" size=".03" mass="1.5"/>
            </body>
          </body>
        </body>
      </body></worldbody>
      <actuator>{actuators}</actuator>
    </mujoco>""")


def fixed():
    return arm(f'<inertial pos="0 0 0" mass="1" diaginertia="{LIGHT}"/>')


def hinged(stiffness, damping, inertia):
    springs = f'stiffness="{stiffness}" damping="{damping}"'
    hinges = f'<joint axis="1 0 0" {springs}/><joint axis="0 1 0" {springs}/>'
    return arm(f'{hinges}<inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>')


def robots_own_inertia():
    """About the foot, the mean of both axes, as the arm stands at first [kg·m²]."""
    model = hinged(1, 1, 1e-6)
    data, matrix = mujoco.MjData(model), np.zeros((5, 5))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    return (matrix[0, 0] + matrix[1, 1]) / 2


def commands(seconds=4.0):
    """Set points [rad]: waves about two joints, jumps of the one between."""
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    jumps = 0.25 * np.sign(np.sin(2 * np.pi * 0.8 * time + 0.3)) * (time > 0.3)
    return np.stack([0.8 * np.sin(2 * np.pi * 0.7 * time), jumps, 0.6 * np.sin(2 * np.pi * 1.3 * time)], axis=1)


def moved(model, entries=()):
    """Positions of the joints under the commands, (T, 3) [rad]."""
    wiring = wire(model, joints=JOINTS, actuators=JOINTS, interface="position")
    data = mujoco.MjData(model)
    if model.nv > len(JOINTS):  # the equilibrium in which an episode begins
        for _ in range(10):
            mujoco.mj_forward(model, data)
            data.qpos[:2] = -data.qfrc_bias[:2] / model.jnt_stiffness[:2]
    runner = Runner(ScalarHost(data), wiring, [tuple(entries)], np.zeros)
    runner.start(PERIOD, round(PERIOD / STEP))
    runner.host.forward()
    rows = []
    for command in commands():
        runner.advance(command[None])
        rows.append(data.qpos[-len(JOINTS) :].copy())
    return np.array(rows)


POSE = np.array([0.0, -0.7, 0.5])  # the arm leans up and forward, along x [rad]


def at_rest(model, entries):
    """Torques of the servos after 8 s [N·m]."""
    data = mujoco.MjData(model)
    data.qpos[:] = POSE
    wiring = wire(model, joints=JOINTS, actuators=JOINTS, interface="position")
    runner = Runner(ScalarHost(data), wiring, [entries], np.zeros)
    runner.start(PERIOD, round(PERIOD / STEP))
    runner.host.forward()
    for _ in range(800):
        runner.advance(POSE[None])
    return data.qfrc_actuator.copy()


def mount(compliance, frequency):
    return Entry("compliant_mount", None, {"compliance": compliance, "frequency": frequency})


@shows("compliant_mount")
@pytest.mark.parametrize(("stiffness", "inertia"), [(2000.0, 2.0), (500.0, 1.0), (10_000.0, 1.0)])
def test_a_base_that_gives_way_moves_the_arm_as_two_hinges_below_it_do(stiffness, inertia):
    whole = inertia + robots_own_inertia()
    damping = 2 * MOUNT_DAMPING * np.sqrt(stiffness * whole)
    frequency = np.sqrt(stiffness / whole) / (2 * np.pi)
    nominal, mine = moved(fixed()), moved(fixed(), [mount(1 / stiffness, frequency)])
    hinges = moved(hinged(stiffness, damping, inertia))
    shown = hinges - nominal
    assert (np.abs(shown).max(axis=0) > 0.002).all(), "it shows in every joint"
    # MuJoCo's own hinges differ as much from themselves at an eighth of the step: 3 to 12 % of what they change.
    apart = np.sqrt(np.square(mine - hinges).mean(axis=0) / np.square(shown).mean(axis=0))
    assert (apart < 0.12).all(), apart


@shows("compliant_mount")
def test_at_rest_gravity_leans_by_what_the_arms_weight_tilts_the_base():
    compliance = 0.002
    model, leaning = fixed(), fixed()
    data = mujoco.MjData(model)
    data.qpos[:] = POSE
    mujoco.mj_forward(model, data)
    first = (data.xipos * model.body_mass[:, None]).sum(axis=0)  # kg·m, from the foot, which is the world's origin
    tilt = compliance * GRAVITY * first[0] / (1 - compliance * GRAVITY * first[2])  # about y
    leaning.opt.gravity[:] = tilt * GRAVITY, 0, -GRAVITY
    nominal, expected, mine = (
        at_rest(*one) for one in ((model, ()), (leaning, ()), (model, (mount(compliance, 5.0),)))
    )
    assert np.abs(expected - nominal)[1] > 0.05
    # The servos give under it, which the moment about the foot feels: 2 %.
    np.testing.assert_allclose((mine - nominal)[1], (expected - nominal)[1], rtol=0.02)


def test_many_simulations_at_once_do_the_same_to_the_last_bit():
    model = fixed()
    wiring = wire(model, joints=JOINTS, actuators=JOINTS, interface="position")
    sims = [(mount(0.001, 6.0),), (), (mount(0.0002, 12.0),)]
    host = BatchHost(mujoco.batch.Batch(model, len(sims)))
    runner = Runner(host, wiring, sims, np.zeros)
    runner.start(PERIOD, round(PERIOD / STEP))
    runner.seen()
    host.forward()
    rows = []
    for command in commands(1.0):
        runner.advance(np.repeat(command[None], len(sims), axis=0))
        rows.append(host.state("qpos").copy())
    together = np.array(rows)
    for k, entries in enumerate(sims):
        np.testing.assert_array_equal(together[:, k], moved(model, entries)[: len(rows)])
