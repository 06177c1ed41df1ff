"""Play and elasticity as a second joint: the idiom of MuJoCo's manual, written by itself."""

import mujoco
import numpy as np
import pytest
from robots import ARM, effect, robot

from tiago_mj import cli
from tiago_mj.export import mjcf, play, replay

PLAY = [effect("backlash", "elbow", width=0.05)]


def test_a_joint_with_play_is_two_joints_and_a_tendon_that_has_what_the_joint_had(tmp_path):
    effects = [*PLAY, effect("coulomb_friction", "elbow", force=0.7)]
    one = robot(tmp_path, effects)
    written = mjcf.write(one)
    model = written.compile()
    first, second = model.joint("elbow"), model.joint("elbow_play")
    np.testing.assert_array_equal(model.jnt_bodyid[first.id], model.jnt_bodyid[second.id])
    np.testing.assert_array_equal(model.jnt_axis[first.id], model.jnt_axis[second.id])
    np.testing.assert_allclose(second.range, [-0.025, 0.025])
    assert (first.damping[0], first.frictionloss[0]) == (0, 0)
    assert not model.jnt_limited[first.id]
    assert (second.damping[0], second.frictionloss[0], second.armature[0]) == (0, 0, 0)
    both = model.tendon("elbow_total")
    assert np.max(model.tendon_damping[both.id]) == 0.051
    assert model.tendon_frictionloss[both.id] == 0.7
    assert model.tendon_armature[both.id] == 0.0031
    np.testing.assert_allclose(model.tendon_range[both.id], [-2.3, 2.2])
    np.testing.assert_allclose(model.tendon_solimp_fri[both.id], [0.9999, 0.9999, 0.001, 0.5, 2])
    np.testing.assert_allclose(model.key_qpos[0], [0.02, 0.1, -0.2, 0])
    assert model.sensor_objid[0] == both.id
    assert model.sensor_type[0] == mujoco.mjtSensor.mjSENS_TENDONPOS
    assert written.exact == ("coulomb_friction",)
    assert "a second joint with a range" in written.approximate["backlash"]
    assert "elbow + elbow_play" in " ".join(written.told)


def test_ranges_are_in_degrees_where_the_file_s_angles_are(tmp_path):
    text = ARM.replace(' angle="radian"', "").replace('range="-1.9 2.1"', 'range="-109 120"')
    text = text.replace('range="-2.3 2.2"', 'range="-132 126"')
    written = mjcf.write(robot(tmp_path, PLAY, text))
    assert (
        b'name="elbow_play" class="light" axis="0 1 0" limited="true" range="-1.4323944'
        in written.files[tmp_path / "arm.xml"]
    )
    np.testing.assert_allclose(written.compile().joint("elbow_play").range, [-0.025, 0.025])


#: What a file leaves of the mean squared gap on a smooth motion, as measured; half as much again is borne.
LEFT = [
    ([effect("backlash", "elbow", width=0.05, motor=0.004)], 0.0087),
    (PLAY, 0.0078),
    ([effect("backlash", "rail", width=0.004)], 0.0085),
    ([effect("backlash", "shoulder", width=0.03), effect("coulomb_friction", "shoulder", force=0.4)], 0.0101),
    ([effect("joint_elasticity", "shoulder", stiffness=100)], 0.0043),
    ([effect("joint_elasticity", "elbow", stiffness=60, motor=0.004, damping=0.1)], 0.071),
]


def left(folder, effects, step=0.002):
    one = robot(folder, effects, ARM.replace('timestep="0.002"', f'timestep="{step}"'), timestep=step)
    closing = replay.closing(one, mjcf.write(one).compile())
    assert closing.before > 2e-4, "the effect shows"
    return 1 - closing.closed


@pytest.mark.parametrize(("effects", "measured"), LEFT, ids=lambda own: own[0]["name"] if isinstance(own, list) else "")
def test_the_file_moves_nearly_as_the_diagnosis_simulates(effects, measured, tmp_path):
    assert left(tmp_path, effects) < 1.5 * measured


@pytest.mark.slow
@pytest.mark.parametrize(("effects", "measured"), LEFT, ids=lambda own: own[0]["name"] if isinstance(own, list) else "")
def test_with_smaller_steps_both_become_the_same(effects, measured, tmp_path):
    assert left(tmp_path, effects, 0.0005) < 0.005


def test_a_ratio_of_damping_is_not_one_of_the_motor_s_inertia(tmp_path):
    text = ARM.replace('kp="4.5" kv="0.29"', 'kp="4.5" dampratio="0.8"')
    one = robot(tmp_path, PLAY, text)
    np.testing.assert_allclose(mjcf.write(one).compile().actuator_biasprm, one.model.actuator_biasprm)


def test_where_something_couples_the_joint_to_others_the_rest_is_written_and_that_is_told(tmp_path, capsys):
    text = ARM.replace("<sensor>", '<equality><joint joint1="elbow" joint2="shoulder"/></equality>\n  <sensor>')
    effects = [*PLAY, effect("coulomb_friction", "elbow", force=0.7)]
    written = mjcf.write(robot(tmp_path, effects, text))
    assert "joint refers to joint 'elbow', which backlash splits in two" in written.lacking["backlash"]
    model = written.compile()
    assert model.joint("elbow").frictionloss[0] == 0.7
    assert model.nv == 3
    words = ["export", str(tmp_path / "diagnosis"), "--out", str(tmp_path / "out")]
    assert cli.main(words) == 0
    assert "| backlash | elbow | not | joint refers to joint 'elbow'" in capsys.readouterr().out


def test_a_joint_with_play_and_a_spring_is_not_split_twice(tmp_path):
    effects = [*PLAY, effect("joint_elasticity", "elbow", stiffness=60)]
    one = robot(tmp_path, effects)
    assert play.plays(one, {entry.name: (entry,) for entry in one.entries}) == ()
    assert not mjcf.write(one).files


#: As above, of motors that turn with two joints: MuJoCo's constraint creeps where our bristles give.
COUPLED = [
    ([effect("coupled_motor_damping", "elbow", damping=0.4)], 0.0002),
    ([effect("coupled_motor_damping", "elbow", damping=0.4, against=1.0)], 0.0002),
    ([effect("coupled_motor_friction", "elbow", force=0.3)], 0.004),
]


@pytest.mark.parametrize(("effects", "measured"), COUPLED, ids=lambda own: "")
def test_a_motor_of_two_joints_is_a_tendon_over_both(effects, measured, tmp_path):
    written = mjcf.write(robot(tmp_path, effects))
    assert (written.exact, list(written.approximate)) == ((), [effects[0]["name"]])
    model = written.compile()
    (coefficients,) = model.wrap_prm[None, :2]
    assert coefficients.tolist() == [-1.0 if "against" in effects[0]["parameters"] else 1.0, 1.0]
    assert left(tmp_path, effects) < 1.5 * measured
