"""A model that makes one physics step for each row of the recordings is compared as it steps."""

import mujoco
import numpy as np
import pytest

from benchmarks.real import logs
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference.predictor import Predictor, predictor
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

PERIOD = 0.002
AXIS = """
<mujoco>
  <option timestep="{step}" integrator="Euler" gravity="0 0 0"/>
  <worldbody><body><joint name="axis" type="slide" axis="1 0 0"/><geom size="0.1" mass="10"/></body></worldbody>
  <actuator><position name="axis" joint="axis" kp="2e4" kv="600"/></actuator>
</mujoco>
"""
RUBS = (Entry("viscous_friction", None, {"damping": 40.0}),)


def beside(folder, step):
    """Simulations beside a recording of the model that steps once a row, with friction."""
    model = mujoco.MjModel.from_xml_string(AXIS.format(step=PERIOD))
    model.dof_damping[0] += 40.0
    data = mujoco.MjData(model)
    time = np.arange(500) * PERIOD
    sent = 0.05 * np.sin(2 * np.pi * time)
    position = []
    for point in sent:
        position.append(data.qpos[0])
        data.ctrl[0] = point
        mujoco.mj_step(model, data)
    given = {"position": {"axis": 0.0}, "set_point": {"axis": 0.0}}
    made = logs.log(
        "swing",
        time,
        command={"axis": sent},
        position={"axis": np.array(position)},
        interface="position",
        initial=given,
    )
    logs.write([made], folder, AXIS.format(step=step), ())
    trials = read_recordings([folder / logs.RECORDINGS]).trials
    return predictor(plant_of(trials, model=folder / "robot.xml"), trials, threads=1)[0]


def left(predict: Predictor) -> float:
    """Largest difference beside the true effect [m]."""
    return float(np.nanmax(np.abs(predict.data.value - predict([(0, RUBS)]))))


def test_nothing_is_put_right_beside_an_explanation(tmp_path):
    predict = beside(tmp_path, PERIOD)
    assert left(predict) < 1e-9
    assert predict.with_step_correction(1.0) is None
    assert left(predict.corrected_beside([(0, RUBS)])) < 1e-9


def test_of_shorter_steps_the_error_is_known(tmp_path):
    predict = beside(tmp_path, PERIOD / 4)
    other = predict.with_step_correction(1.0 - predict.corrected)
    assert other is not None
    assert other.corrected != predict.corrected
    assert left(predict) == pytest.approx(left(other), rel=0.5)
    assert left(predict) > 1e-6
