"""What a motor that turns with two joints does to them, against MuJoCo's own fixed tendons over both."""

import mujoco
import mujoco.batch
import numpy as np
import pytest
from effects_bench import shows

from tiago_mj.effects import EFFECTS, Entry, model_file
from tiago_mj.effects.host import BatchHost, ScalarHost
from tiago_mj.effects.runner import Runner
from tiago_mj.effects.wiring import wire

JOINTS = ("first", "second")
STEP, PERIOD, KP, KV = 5e-4, 0.01, 40.0, 2.0  # s, s, N·m/rad, N·m·s/rad
FORCE, DAMPING = 1.5, 1.2  # N·m, N·m·s/rad


def arm(tendon="", *, as_text=False):
    """Two level links whose axes stand upright: nothing falls, and either joint's motion pushes the other."""
    actuators = "".join(f'<position name="{name}" joint="{name}" kp="{KP}" kv="{KV}"/>' for name in JOINTS)
    text = f"""<mujoco>
      <option timestep="{STEP}" integrator="implicitfast"/>
      <worldbody>
        <body><joint name="first" axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="2"/>
          <body pos=".3 0 0"><joint name="second" axis="0 0 1"/>
            <geom type="capsule" fromto="0 0 0 .25 0 0" size=".025" mass="1"/>
          </body>
        </body>
      </worldbody>
      {tendon}
      <actuator>{actuators}</actuator>
    </mujoco>"""
    return text if as_text else mujoco.MjModel.from_xml_string(text)


def over_both(turns, **numbers):
    """A fixed tendon over both joints; its friction sticks as that of our effects does."""
    told = " ".join(f'{key}="{value}"' for key, value in numbers.items())
    stick = 'solreffriction="0.001 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    return (
        f'<tendon><fixed name="motor" {told} {stick}><joint joint="first" coef="{turns}"/>'
        '<joint joint="second" coef="1"/></fixed></tendon>'
    )


def commands(seconds=3.0):
    """Set points [rad]: both joints to and fro, at other periods, then at rest."""
    time = np.arange(round(seconds / PERIOD)) * PERIOD
    wave = np.stack([0.6 * np.sin(2 * np.pi * 0.7 * time), -0.5 * np.sin(2 * np.pi * 1.1 * time)], axis=1)
    wave[time > 2.0] = wave[time <= 2.0][-1]
    return wave


def moved(model, entries=()):
    """Positions of both joints under the commands, (T, 2) [rad]."""
    wiring = wire(model, joints=JOINTS, actuators=JOINTS, interface="position")
    data = mujoco.MjData(model)
    runner = Runner(ScalarHost(data), wiring, [tuple(entries)], np.zeros)
    runner.start(PERIOD, round(PERIOD / STEP))
    rows = []
    for command in commands():
        runner.advance(command[None])
        rows.append(data.qpos.copy())
    return np.array(rows)


def effect(name, turns=1, **parameters):
    return Entry(name, ("second",), {**parameters, "against": float(turns < 0)})


@shows("coupled_motor_damping")
@pytest.mark.parametrize("turns", [1, -1])
def test_a_motors_viscous_friction_is_that_of_a_tendon_over_both_joints(turns):
    nominal, mine = moved(arm()), moved(arm(), [effect("coupled_motor_damping", turns, damping=DAMPING)])
    tendon = moved(arm(over_both(turns, damping=DAMPING)))
    assert np.abs(tendon - nominal).max() > 0.05  # it shows
    # MuJoCo's is implicit in the speed, ours a step late: 0.5 ms of motion at 3 rad/s.
    assert np.abs(mine - tendon).max() < 0.02 * np.abs(tendon - nominal).max()


@shows("coupled_motor_friction")
@pytest.mark.parametrize("turns", [1, -1])
def test_a_motors_dry_friction_is_that_of_a_tendon_over_both_joints(turns):
    nominal, mine = moved(arm()), moved(arm(), [effect("coupled_motor_friction", turns, force=FORCE)])
    tendon = moved(arm(over_both(turns, frictionloss=FORCE)))
    shown = np.abs(tendon - nominal).max()
    assert shown > 0.03
    # Bristles that give, and a constraint that creeps: to a twentieth alike.
    assert np.abs(mine - tendon).max() < 0.05 * shown


@shows("coupled_motor_friction")
def test_at_rest_a_motors_dry_friction_holds_both_joints_off_by_as_much():
    off = commands()[-1] - moved(arm(), [effect("coupled_motor_friction", force=FORCE)])[-1]
    # The servos hold still against what the motor holds: the same torque at both, and no more than its friction.
    np.testing.assert_allclose(KP * off[0], KP * off[1], atol=0.02 * FORCE)
    assert 0.05 * FORCE < abs(KP * off[0]) <= FORCE


def test_many_simulations_at_once_do_the_same_to_the_last_bit():
    model = arm()
    wiring = wire(model, joints=JOINTS, actuators=JOINTS, interface="position")
    sims = [(effect("coupled_motor_friction", force=FORCE),), (), (effect("coupled_motor_damping", damping=DAMPING),)]
    batch = mujoco.batch.Batch(model, len(sims))
    host = BatchHost(batch)
    runner = Runner(host, wiring, sims, np.zeros)
    runner.start(PERIOD, round(PERIOD / STEP))
    rows = []
    for command in commands():
        runner.advance(np.broadcast_to(command, (len(sims), 2)).copy())
        rows.append(np.array(host.state("qpos")))
    for k, entries in enumerate(sims):
        np.testing.assert_array_equal(np.array(rows)[:, k], moved(arm(), entries))


def test_the_most_that_a_fit_tries_slows_both_joints_and_nothing_diverges():
    nominal = np.abs(np.diff(moved(arm()).sum(axis=1))).max()
    for name, parameter in (("friction", "force"), ("damping", "damping")):
        most = EFFECTS[f"coupled_motor_{name}"].parameters[parameter].bounds[1][1]
        turned = moved(arm(), [effect(f"coupled_motor_{name}", **{parameter: most})]).sum(axis=1)
        assert np.abs(np.diff(turned)).max() < 0.5 * nominal, name


@pytest.mark.parametrize(("name", "parameters"), [("friction", {"force": FORCE}), ("damping", {"damping": DAMPING})])
@pytest.mark.parametrize("turns", [1, -1])
def test_a_model_file_has_the_motor_as_a_tendon_over_both_joints(name, parameters, turns, tmp_path):
    entry = effect(f"coupled_motor_{name}", turns, **parameters)
    (tmp_path / "arm.xml").write_text(arm(as_text=True))
    spec = model_file.read(tmp_path / "arm.xml", STEP)
    wiring = wire(spec.compile(), joints=JOINTS, actuators=JOINTS, interface="position")
    assert model_file.holds(spec.compile(), wiring, [entry], PERIOD, round(PERIOD / STEP))
    text = model_file.write(spec, wiring, [entry], PERIOD, round(PERIOD / STEP), "repaired")
    native, simulated, nominal = moved(mujoco.MjModel.from_xml_string(text)), moved(arm(), [entry]), moved(arm())
    assert np.abs(native - simulated).max() < 0.05 * np.abs(simulated - nominal).max()
