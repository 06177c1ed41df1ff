"""A motor that turns with two joints, found in efforts along a motion whose friction is MuJoCo's own tendon's."""

import mujoco
import numpy as np
import pytest
from made_motions import record

from tiago_mj.effects import Entry
from tiago_mj.effects.wiring import wire
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.torque.strips import lay_out
from tiago_mj.gap.torque.torques import Torques

JOINTS = ("shoulder", "wrist", "flange")
FORCE, DAMPING = 0.4, 0.3  # N·m, N·m·s/rad
NAMES = ("coulomb_friction", "viscous_friction", "coupled_motor_friction", "coupled_motor_damping")


def arm(motor=""):
    """Three joints of a hanging arm; the motor, if there is one, turns with the difference of the last two."""
    stick = 'solreffriction="0.004 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    coupled = f"""<tendon><fixed name="motor" {motor} {stick}><joint joint="wrist" coef="-1"/>
      <joint joint="flange" coef="1"/></fixed></tendon>"""
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in JOINTS)
    return f"""<mujoco>
      <option timestep="0.002" integrator="implicitfast"/>
      <worldbody>
        <body><joint name="shoulder" axis="0 1 0" armature="0.1" damping="0.2"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="2"/>
          <body pos="0 0 -0.3"><joint name="wrist" axis="1 0 0" armature="0.05" damping="0.1"/>
            <geom type="capsule" fromto="0 0 0 0 0 -0.15" size="0.025" mass="0.8"/>
            <body pos="0 0 -0.15"><joint name="flange" axis="0 1 0" armature="0.05" damping="0.1"/>
              <geom type="box" pos="0 0 -0.05" size="0.03 0.02 0.04" mass="0.4"/>
            </body>
          </body>
        </body>
      </worldbody>
      {coupled if motor else ""}
      <actuator>{motors}</actuator>
    </mujoco>"""


@pytest.fixture(scope="module")
def nominal(tmp_path_factory):
    file = tmp_path_factory.mktemp("nominal") / "arm.xml"
    file.write_text(arm())
    return file


def recorded(motor):
    return record(mujoco.MjModel.from_xml_string(arm(motor)), JOINTS, spread=2.0, noise=0.005)


def test_a_joint_is_carried_by_the_next_one_towards_the_base():
    model = mujoco.MjModel.from_xml_string(arm())
    assert wire(model, joints=JOINTS, actuators=JOINTS).carrier.tolist() == [-1, 0, 1]
    fewer = ("flange", "shoulder")  # the one between is not observed
    assert wire(model, joints=fewer, actuators=fewer).carrier.tolist() == [1, -1]


@pytest.mark.parametrize("name", ["friction", "damping"])
def test_along_a_motion_both_joints_need_what_the_motor_takes(name):
    course = lay_out([recorded('damping="0.1"')], JOINTS, JOINTS)
    value = {"friction": {"force": FORCE}, "damping": {"damping": DAMPING}}[name]
    entry = Entry(f"coupled_motor_{name}", ("flange",), {**value, "against": 1.0})
    torques = Torques(mujoco.MjModel.from_xml_string(arm()), course)
    velocity = course.stack("velocity")
    speed = velocity[:, 2] - velocity[:, 1]
    force = FORCE * np.sign(speed) if name == "friction" else DAMPING * speed
    expected = course.filtered(np.stack([0 * force, -force, force], axis=1))
    np.testing.assert_allclose(torques.of([entry]) - torques.nominal, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("motor", "name", "truth"),
    [
        (f'frictionloss="{FORCE}"', "coupled_motor_friction", FORCE),
        (f'damping="{DAMPING}"', "coupled_motor_damping", DAMPING),
    ],
)
def test_friction_of_a_motor_that_turns_with_two_joints_is_found_on_both(nominal, motor, name, truth):
    found = diagnose([recorded(motor)], model=nominal, names=NAMES, threads=1)
    assert found.kind == "effect"
    (effect,) = found.best.effects
    assert (effect.name, effect.target, effect.parameters["against"].value) == (name, "flange", 1.0)
    assert next(iter(effect.parameters.values())).value == pytest.approx(truth, rel=0.05)
    assert found.shrink.closed > 0.9


def test_friction_of_two_joints_is_none_of_a_common_motor(nominal):
    model = mujoco.MjModel.from_xml_string(arm())
    for name in JOINTS[1:]:
        model.dof_frictionloss[model.joint(name).dofadr[0]] = FORCE
    found = diagnose([record(model, JOINTS, spread=2.0, noise=0.005)], model=nominal, names=NAMES, threads=1)
    assert {effect.name for effect in found.best.effects} == {"coulomb_friction"}
