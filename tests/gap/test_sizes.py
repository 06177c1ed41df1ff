"""Forces of a robot are those of the motion that was recorded, and of nothing before or after it."""

import mujoco
import numpy as np
import pytest

from benchmarks.real import logs
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.simulation import sizes
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

#: An axis of 10 kg under a servo of 1e5 N/m, which moves a tenth of a meter away from its zero.
AXIS = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody><body><joint name="axis" type="slide" axis="1 0 0"/><geom size="0.1" mass="10"/></body></worldbody>
  <actuator><position name="axis" joint="axis" kp="1e5" kv="1e3"/></actuator>
</mujoco>
"""
RATE, ACCELERATION, PLACE = 100, 0.5, 0.3


def swing(seconds: float, friction: float = 0.0) -> logs.Log:
    """The set point accelerates with at most 0.5 m/s² around a place away from zero; the axis follows it."""
    model = mujoco.MjModel.from_xml_string(AXIS)
    model.dof_frictionloss[0] = friction
    data = mujoco.MjData(model)
    data.qpos[0] = PLACE
    time = np.arange(round(seconds * RATE)) / RATE
    wave = 2 * np.pi * 0.5
    sent = PLACE + ACCELERATION / wave**2 * (1 - np.cos(wave * time))
    position = []
    for point in sent:
        position.append(data.qpos[0])
        data.ctrl[0] = point
        mujoco.mj_step(model, data, nstep=5)
    return logs.log(
        f"swing-{seconds:g}",
        time,
        command={"axis": sent},
        position={"axis": np.array(position)},
        interface="position",
        initial={"position": {"axis": PLACE}, "set_point": {"axis": PLACE}},
    )


def test_forces_are_those_of_the_motion(tmp_path):
    """At least mass times acceleration, 5 N, and at most what the servo gives for the set point's step in a row; from
    zero, where no command was sent, to its place the servo would give 30 kN."""
    logs.write([swing(2.0), swing(3.0)], tmp_path, AXIS, ())
    trials = read_recordings([tmp_path / logs.RECORDINGS]).trials
    plant = plant_of(trials, model=tmp_path / "robot.xml")
    _, nominal = predictor(plant, trials, threads=1)
    (size,) = sizes.sizes(plant, trials, nominal)
    fastest = ACCELERATION / np.pi
    assert 10 * ACCELERATION < size.force < 1e5 * fastest / RATE
    assert size.speed == pytest.approx(fastest, rel=0.1)


def test_bounds_of_friction_grow_with_what_stops_the_joint(tmp_path):
    """A joint whose motion takes 5 N and whose friction takes 2 kN, of which MuJoCo's soft friction gives a part at
    creeping speeds: what the servo gives there bounds it, and not the force of the motion."""
    friction = 2000.0
    logs.write([swing(2.0, friction), swing(3.0, friction)], tmp_path, AXIS, ())
    trials = read_recordings([tmp_path / logs.RECORDINGS]).trials
    plant = plant_of(trials, model=tmp_path / "robot.xml")
    _, nominal = predictor(plant, trials, threads=1)
    (size,) = sizes.sizes(plant, trials, nominal)
    assert 0.7 * friction < size.force < 1.5 * friction
