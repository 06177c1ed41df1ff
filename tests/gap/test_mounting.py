"""A payload's place is proposed before effects are screened."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_motions import holds, named, record
from test_place import after, measured
from test_repaired import robot

from tiago_mj.effects import read_effects
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import Fitter
from tiago_mj.gap.inference.hypotheses import Candidate, candidates, terms
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.search import mounting, second_parameter
from tiago_mj.gap.simulation import replay, sizes
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.recordings.recording import Sidecar, Trial

AXIS = """<mujoco><worldbody><body name="carriage"><joint name="axis" type="slide" axis="1 0 0"/>
<geom size="0.1" mass="3"/></body></worldbody><actuator><motor name="axis" joint="axis"/></actuator></mujoco>"""
REACHES = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><joint damping="0.1" frictionloss="0.05" armature="0.01"/><geom type="capsule" size="0.02"/></default>
  <worldbody>
    <body name="upper">
      <joint name="turn" axis="0 0 1"/>
      <geom fromto="0 0 0 0.1 0 0" mass="2"/>
      <body name="middle" pos="0.1 0 0">
        <joint name="lift" axis="0 1 0"/>
        <geom fromto="0 0 0 0.3 0 0" mass="1.5"/>
        <body name="last" pos="0.3 0 0">
          <joint name="roll" axis="1 0 0"/>
          <geom fromto="0 0 0 0.06 0 0" mass="0.4"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="turn" name="turn"/><motor joint="lift" name="lift"/><motor joint="roll" name="roll"/>
  </actuator>
</mujoco>
"""
JOINTS = ("turn", "lift", "roll")
#: Of the last link, along its axis [m].
CENTRE = 0.03
TRUTH = {"mass": 0.5, "x": 0.2, "z": -0.1}


def searched(tmp_path, truth: dict[str, float]) -> tuple[Fitter, tuple[Candidate, ...]]:
    """A fitter to recordings of commands of an arm with a load, and the payload of the library."""
    plant, trial, _ = robot(tmp_path)
    plant, trials = measured(plant, trial, truth)
    predict, nominal = predictor(plant, trials, threads=1)
    data = noise_model.select_trials(predict.data, [0, 1])
    own = tuple(t for t in terms(plant) if not t.per_trial)
    flat = np.zeros((len(own), *data.value.shape))
    fitter = Fitter(predict, Subset((0, 1)), data, np.full(len(data.channels), 0.5), own, flat)
    pool = candidates(plant, ["payload"], None, sizes.sizes(plant, trials, nominal))
    return fitter.linearized_at(Point((), np.zeros(0), np.zeros(fitter.size))), pool


def loaded(
    mass: float, at: tuple[float, float, float], dry: tuple[float, ...] = (), viscous: tuple[float, ...] = ()
) -> Trial:
    """Motion and drive torques of an arm with a mass at a place of its last link [m], and friction on its joints."""
    spec = mujoco.MjSpec.from_string(REACHES)
    ball = spec.body("last").add_body(pos=at)
    ball.explicitinertial, ball.mass, ball.inertia, ball.ipos = True, mass, np.full(3, 1e-9), np.zeros(3)
    model = spec.compile()
    model.dof_frictionloss[:] += dry or 0.0
    model.dof_damping[:] += viscous or 0.0
    return record(model, JOINTS, spread=1.0)


def diagnosed(tmp_path, recorded: Trial) -> Diagnosis:
    file = tmp_path / "reaches.xml"
    file.write_text(REACHES)
    return diagnose([recorded], model=file, seed=0, threads=1)


def test_a_load_is_found_where_it_hangs_along_a_motion(tmp_path):
    found = diagnosed(tmp_path, loaded(0.8, (0.2, 0.0, 0.15)))
    assert (found.kind, named(found.best)) == ("effect", {"payload"})
    load = found.best.effects[0].parameters
    assert holds(load["mass"], 0.8)
    for key, truth in (("x", 0.2 - CENTRE), ("y", 0.0), ("z", 0.15)):
        assert holds(load[key], truth), key
    assert load["z"].value == pytest.approx(0.15, abs=0.03)
    assert found.shrink.closed > 0.99
    near = [e.parameters for one in found.ranking if one.probability > 1e-9 for e in one.effects]
    told = [of[key] for of in near for key in ("x", "y", "z") if key in of]
    assert told
    assert all(place.low is not None for place in told), "a place that was proposed and not fitted"


def test_a_load_at_the_centre_is_given_no_other_place_along_a_motion(tmp_path):
    found = diagnosed(tmp_path, loaded(0.8, (CENTRE, 0.0, 0.0)))
    assert (found.kind, named(found.best)) == ("effect", {"payload"})
    assert set(found.best.effects[0].parameters) == {"mass"}
    assert holds(found.best.effects[0].parameters["mass"], 0.8)


@pytest.mark.parametrize(
    ("dry", "viscous"),
    [
        ((0.8, 1.2, 0.2), (0.6, 0.9, 0.05)),
        pytest.param((1.5, 0.8, 0.1), (0.1, 1.5, 0.02), marks=pytest.mark.slow),
    ],
    ids=["one", "other"],
)
def test_a_load_is_found_beside_friction_that_differs_from_joint_to_joint(tmp_path, dry, viscous):
    """Each alone is less than a torque constant of a third would explain, beside which none of them is missed."""
    found = diagnosed(tmp_path, loaded(0.8, (0.2, 0.0, 0.15), dry, viscous))
    assert found.kind == "effect"
    assert named(found.best) == {"payload", "coulomb_friction", "viscous_friction"}
    of = {(one.name, one.target): one.parameters for one in found.best.effects}
    assert holds(of["payload", "all"]["mass"], 0.8)
    assert of["payload", "all"]["z"].value == pytest.approx(0.15, abs=0.03)
    for joint, friction in zip(JOINTS, dry, strict=True):
        assert of["coulomb_friction", joint]["force"].value == pytest.approx(friction, rel=0.2), joint
    assert of["viscous_friction", "lift"]["damping"].value == pytest.approx(viscous[1], rel=0.1)
    assert found.shrink.closed > 0.99


def test_no_place_is_proposed_where_commands_are_replayed(tmp_path):
    fitter, pool = searched(tmp_path, TRUTH)
    assert mounting.proposed(fitter, Point((), np.zeros(0), np.zeros(fitter.size)), pool) == ()


def test_coordinates_of_a_place_are_no_second_parameters(tmp_path):
    _, (part,) = searched(tmp_path, TRUTH)
    assert second_parameter._second_parameters(replace(part, fixed=(("x", 0.1), ("y", 0.0), ("z", -0.2)))) == []


def test_what_a_proposed_place_explained_counts_once(tmp_path):
    """The evidence of the fit has it already: fitted once more, only the price of the place changes."""
    plant, trial, _ = robot(tmp_path)
    plant, trials = measured(plant, trial, TRUTH)
    near = after(plant, trials, 0.5, fixed=(("x", 0.2), ("y", 0.0), ("z", -0.1)))
    told = dict(near.parts[0].fixed)
    assert told == pytest.approx({"x": 0.2, "z": -0.1}, abs=2e-3), "along y no place shows"
    assert abs(near.evidence) < 10
    assert after(plant, trials, 0.5).evidence > 1000


def test_a_load_is_placed_on_a_body_that_mujoco_takes_for_a_simple_one(tmp_path):
    """One whose centre of mass is where its joint is: MuJoCo refuses to move it unless it was told before."""
    (tmp_path / "axis.xml").write_text(AXIS)
    rows = 200
    time = np.arange(rows) / 100
    effort = {"axis": 8 * np.sin(3 * time)}
    moved = {"axis": 0.2 * np.sin(3 * time)}
    sidecar = Sidecar("tiago_mj.recording/1", "one", robot=str(tmp_path / "axis.xml"), rate_hz=100.0)
    trial = Trial("one", time, effort, moved, {}, {}, {}, replace(sidecar, interface="effort"), "one.csv")
    plant = plant_of([trial])
    load = read_effects({"payload": {"mass": 0.3, "x": 0.1}})
    (run,) = replay.simulate(plant, replay.grid(plant, [trial]), [(0, load)], replay.Run(threads=1)).position
    assert np.isfinite(run).all()
