"""Baselines on made-up cases: what they read off, and what they cannot answer."""

import json

import mujoco
import numpy as np
import pytest

from benchmarks.real import __main__ as command
from benchmarks.real import baselines, logs
from benchmarks.real.baselines import regression, simulation
from benchmarks.real.baselines.files import NotForThis
from benchmarks.real.cases import CASES
from benchmarks.real.declare import REGRESSION

COULOMB, VISCOUS, GAIN = 0.3, 0.2, 1.4
MODEL = """<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 -1 0" armature="0.01"/>
      <inertial pos="0 0 -0.2" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>
    </body>
  </worldbody>
  <actuator>{}</actuator>
</mujoco>
"""
SERVO = '<position name="hinge" joint="hinge" kp="20" kv="0.5"/>'


def recorded(folder, *, efforts):
    """A servo that has friction and another stiffness, or efforts along its motion; the nominal model has neither."""
    model = mujoco.MjModel.from_xml_string(MODEL.format(SERVO))
    model.dof_frictionloss[:], model.dof_damping[:] = COULOMB, VISCOUS
    if not efforts:
        model.dof_frictionloss[:] = model.dof_damping[:] = 0
        model.actuator_gainprm[0, 0] *= GAIN
        model.actuator_biasprm[0, 1] *= GAIN
    data = mujoco.MjData(model)
    made = []
    for k in range(2):
        time = np.arange(6000) * 0.002
        command = 0.8 * np.sin((3 + k) * time) + 0.4 * np.sin(7.3 * time)
        mujoco.mj_resetData(model, data)
        rows = []
        for sent in command:
            data.ctrl[0] = sent
            mujoco.mj_forward(model, data)
            rows.append((data.qpos[0], data.actuator_force[0]))
            mujoco.mj_step(model, data)
        noise = np.random.default_rng(k).standard_normal((2, len(rows)))
        position, effort = np.array(rows).T + noise * [[1e-4 if efforts else 2e-3], [0.2]]
        beside = {"effort": {"hinge": effort}} if efforts else {"command": {"hinge": command}, "interface": "position"}
        made.append(logs.log(f"t{k}", time, position={"hinge": position}, **beside))
    logs.write(made, folder, MODEL.format('<motor name="hinge" joint="hinge"/>' if efforts else SERVO))
    return folder


@pytest.fixture(scope="module")
def servo(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("servo"), efforts=False)


def test_a_regression_finds_friction_in_efforts(tmp_path):
    said = regression.answer(CASES["emps-efforts-friction"], recorded(tmp_path, efforts=True))
    assert set(said["names"]) - {"armature@hinge"} == {"coulomb_friction@hinge", "viscous_friction@hinge"}
    assert abs(said["values"].get("armature@hinge", 0.0)) < 0.003  # half a step of the simulation
    assert said["values"]["coulomb_friction@hinge"] == pytest.approx(COULOMB, rel=0.1)
    assert said["values"]["viscous_friction@hinge"] == pytest.approx(VISCOUS, rel=0.1)


def test_a_regression_finds_a_servos_stiffness_in_commands(servo):
    said = regression.answer(CASES["emps-commands-gain"], servo)
    assert set(said["names"]) - {"armature@hinge"} == {"servo_stiffness@hinge"}
    assert said["values"]["servo_stiffness@hinge"] == pytest.approx(GAIN, rel=0.05)


def test_a_regression_names_nothing_where_nothing_is_gained():
    random = np.random.default_rng(0)
    rows = {name: random.standard_normal(4000) for name in ("viscous_friction", "coulomb_friction")}
    columns = {**rows, regression.CONSTANT: np.ones(4000)}
    fitted = np.arange(4000) // 100 % 2 == 0
    noise = random.standard_normal(4000)
    assert regression.read_off(noise, columns, fitted) == {}
    found = regression.read_off(noise + 2 * rows["viscous_friction"], columns, fitted)
    assert found == {"viscous_friction": pytest.approx(2.0, rel=0.1)}
    assert regression.read_off(noise - 2 * rows["viscous_friction"], columns, fitted) == {}  # below nothing


def test_a_simulation_at_the_truth_leaves_nothing(servo):
    problem = simulation.Problem(servo)
    truth = np.zeros(len(simulation.NAMES))
    truth[0] = np.log(GAIN) / simulation.FACTOR
    nothing, true = problem.loss(np.array([np.zeros_like(truth), truth]), fitted=True)
    assert np.sqrt(true) == pytest.approx(2e-3, rel=0.05)  # the noise
    assert nothing > 10 * true
    said = simulation.read_off(problem, truth)
    assert said["names"] == ["servo_stiffness@hinge"]
    assert said["values"]["servo_stiffness@hinge"] == pytest.approx(GAIN)
    assert simulation.read_off(problem, np.zeros_like(truth))["kind"] == "no_gap"


@pytest.mark.parametrize("case", [case for case in CASES.values() if case.causes], ids=lambda case: case.name)
def test_a_regression_is_no_baseline_where_one_gave_the_truth(case, tmp_path):
    if any(cause.known_by == REGRESSION for cause in case.causes):
        with pytest.raises(NotForThis, match="regression"):
            regression.answer(case, tmp_path)


def test_what_cannot_be_simulated_is_said(tmp_path):
    with pytest.raises(NotForThis, match="servo"):
        simulation.Problem(recorded(tmp_path, efforts=True))


def test_a_method_answers_what_it_can_and_goes_on_where_it_stopped(tmp_path, monkeypatch):
    case, other = CASES["emps-efforts-friction"], CASES["simple-pendulum-ddp"]
    made = []

    def convert(case, data, folder):
        made.append(case.name)
        return recorded(folder, efforts=True)

    monkeypatch.setattr(baselines.run, "convert", convert)
    said = []
    first = baselines.answers("regression", [case, other], tmp_path, tmp_path / "out", said.append)
    assert list(first) == [case.name]
    assert "no answer" in said[1]
    assert first == baselines.answers("regression", [case], tmp_path, tmp_path / "out", said.append)
    assert made == [case.name, other.name]
    assert json.loads((tmp_path / "out" / "regression.json").read_text()) == first
    assert command.main(["submit", str(tmp_path / "out" / "regression.json")]) == 0


def test_what_is_known_belongs_to_the_nominal_model(tmp_path):
    folder = recorded(tmp_path, efforts=True)
    known = [{"name": "coulomb_friction", "target": "hinge", "parameters": {"force": COULOMB}}]
    (folder / logs.KNOWN).write_text(json.dumps(known))
    said = regression.answer(CASES["emps-efforts-friction"], folder)
    assert set(said["names"]) - {"armature@hinge"} == {"viscous_friction@hinge"}
