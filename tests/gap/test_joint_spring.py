"""A spring at a joint is found where efforts are measured along a motion, and where commands are replayed."""

import mujoco
import numpy as np
import pytest
from made_motions import record

from tiago_mj.effects import Entry
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.torque.strips import lay_out
from tiago_mj.gap.torque.torques import Torques

JOINTS = ("shoulder", "wrist")
STIFFNESS, REST = 6.0, 0.7  # N·m/rad, rad
#: What else could pull at a joint of this arm.
RIVALS = ("coulomb_friction", "viscous_friction", "payload", "gravity_tilt", "torque_constant", "encoder_bias")


def arm(spring=""):
    """Two joints of a hanging arm; the wrist has a spring, if there is one."""
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in JOINTS)
    return f"""<mujoco>
      <compiler angle="radian"/>
      <option timestep="0.002" integrator="implicitfast"/>
      <worldbody>
        <body><joint name="shoulder" axis="0 1 0" armature="0.1" damping="0.2"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="2"/>
          <body pos="0 0 -0.3"><joint name="wrist" axis="1 0 0" armature="0.05" damping="0.1" {spring}/>
            <geom type="capsule" fromto="0 0 0 0 0 -0.15" size="0.025" mass="0.8"/>
          </body>
        </body>
      </worldbody>
      <actuator>{motors}</actuator>
    </mujoco>"""


@pytest.fixture(scope="module")
def efforts():
    model = mujoco.MjModel.from_xml_string(arm(f'stiffness="{STIFFNESS}" springref="{REST}"'))
    return record(model, JOINTS, spread=2.0, noise=0.005)


@pytest.mark.parametrize("hardening", [0.0, 0.6])
def test_along_a_motion_the_joint_needs_what_the_spring_pulls(efforts, hardening):
    course = lay_out([efforts], JOINTS, JOINTS)
    numbers = {"stiffness": STIFFNESS, "rest": REST, "hardening": hardening}
    torques = Torques(mujoco.MjModel.from_xml_string(arm()), course)
    stretch = course.stack("position")[:, 1] - REST
    pull = STIFFNESS * stretch * (1 - hardening + hardening * stretch**2)  # of a stretch of 1 rad: it has no range
    expected = course.filtered(np.stack([0 * pull, pull], axis=1))
    found = torques.of([Entry("joint_spring", ("wrist",), numbers)]) - torques.nominal
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_spring_is_found_in_efforts_with_where_it_is_slack(efforts, tmp_path):
    (tmp_path / "arm.xml").write_text(arm())
    found = diagnose([efforts], model=tmp_path / "arm.xml", names=("joint_spring", *RIVALS), threads=1)
    assert found.kind == "effect"
    (effect,) = found.best.effects
    assert (effect.name, effect.target) == ("joint_spring", "wrist")
    stiffness = effect.parameters["stiffness"]
    assert stiffness.low < STIFFNESS < stiffness.high
    assert stiffness.value == pytest.approx(STIFFNESS, rel=0.05)
    assert effect.parameters["rest"].value == pytest.approx(REST, abs=0.05)
    assert found.shrink.closed > 0.95
