"""Gains of servos that nobody knows: stated with what they are known to, fitted with everything, and never named."""

from __future__ import annotations

import json
import math

import mujoco
import numpy as np
import pytest
import yaml

from tiago_mj.gap.inference import trailing
from tiago_mj.gap.inference.hypotheses import terms
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.models import gains
from tiago_mj.models.convert import Options, convert
from tiago_mj.models.gains import GUESSED, Gain
from tiago_mj.models.stated import UNCERTAINTY, URDF_MASSES, text, uncertainty
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError

ROBOT = """
<mujoco><option timestep="0.002" integrator="implicitfast"/>{text}<worldbody><body>
<joint name="hinge" axis="0 1 0" damping=".05"/>
<geom type="capsule" size=".01" fromto="0 0 0 0 0 -.2" mass=".5"/></body></worldbody>
<actuator><position name="hinge" joint="hinge" kp="{kp}" kv="0.6"/></actuator></mujoco>
"""
URDF = """
<robot name="r"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="2"/></joint></robot>
"""


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ("kp=50±30%,kv=0.5 ± 50 %", {(None, "kp"): Gain(50, 0.3), (None, "kv"): Gain(0.5, 0.5)}),
        ("hinge.kp=+-30%", {("hinge", "kp"): Gain(None, 0.3)}),
        ("kp=1e3 guessed", {(None, "kp"): Gain(1000, GUESSED)}),
        ("20, 0.5±10%", {(None, "kp"): Gain(20, None), (None, "kv"): Gain(0.5, 0.1)}),
        ("hinge.kp=3,hinge.kd=1", {("hinge", "kp"): Gain(3, None), ("hinge", "kv"): Gain(1, None)}),
        ("guessed", {(None, "kp"): Gain(None, GUESSED), (None, "kv"): Gain(None, GUESSED)}),
        ({"kp": "50 ± 30 %", "kv": 2}, {(None, "kp"): Gain(50, 0.3), (None, "kv"): Gain(2, None)}),
        ({"hinge": {"kp": "guessed"}}, {("hinge", "kp"): Gain(None, GUESSED)}),
    ],
)
def test_gains_are_said_as_values_shares_or_guesses(said, found):
    assert gains.parsed(said) == pytest.approx(found)
    assert gains.parsed(gains.written(found)) == pytest.approx(found)


@pytest.mark.parametrize("said", ["ki=3", "kp", "kp=", "kp=much", "kp=-3", "kp=50±0%", "", 3, {"kp": True}, {}])
def test_what_is_no_gain_ends_in_one_line(said):
    with pytest.raises(ValueError, match="gain") as refused:
        gains.parsed(said)
    assert "\n" not in str(refused.value)


def recorded(folder, kp=20.0, said=None, text="", trials=5):
    """Recordings of a hinge whose servo has another position gain than the model's 20 N·m/rad."""
    model = mujoco.MjModel.from_xml_string(ROBOT.format(kp=kp, text=""))
    rng = np.random.default_rng(0)
    for k in range(trials):
        data, rows = mujoco.MjData(model), []
        goals = np.repeat(rng.uniform(-1.2, 1.2, 6), 25)
        for row, goal in enumerate(goals):
            rows.append((0.02 * row, goal, data.qpos[0] + rng.normal(0, 1e-4)))
            data.ctrl[0] = goal
            mujoco.mj_step(model, data, 10)
        lines = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
        (folder / f"t{k}.csv").write_text(f"time,command.hinge,position.hinge\n{lines}\n")
        facts = {"robot": "robot.xml", "interface": "position", "rate_hz": 50}
        facts["initial"] = {"position": {"hinge": 0.0}, "set_point": {"hinge": 0.0}}
        (folder / f"t{k}.json").write_text(json.dumps({**facts, **({"gains": said} if said else {})}))
    (folder / "robot.xml").write_text(ROBOT.format(kp=20, text=text))
    return folder


def nuisances(folder, **options):
    trials = read_recordings([folder], **options).trials
    plant = plant_of(trials, model=folder / "robot.xml")
    return plant, {term.effect: term for term in terms(plant)}


def test_what_is_stated_is_fitted_within_what_it_is_known_to(tmp_path):
    _, usual = nuisances(recorded(tmp_path, trials=1))
    assert usual["servo_stiffness"].deviation == pytest.approx(0.04)
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"gains": {"kp": "± 30 %", "hinge": {"kv": "guessed"}}}))
    plant, wide = nuisances(tmp_path, map_file=tmp_path / "map.yaml")
    assert plant.given == ()
    assert wide["servo_stiffness"].deviation == pytest.approx(0.3)
    assert wide["servo_damping"].deviation == pytest.approx(GUESSED * 0.6)


def test_a_stated_value_is_the_nominal_one(tmp_path):
    plant, found = nuisances(recorded(tmp_path, said="kp=50±30%,kv=0.9", trials=1))
    by_name = {entry.name: entry.parameters for entry in plant.given}
    assert by_name["servo_stiffness"] == pytest.approx({"factor": 2.5})
    assert by_name["servo_damping"] == pytest.approx({"damping": 0.3})
    assert found["servo_stiffness"].deviation == pytest.approx(0.3)


def test_gains_of_what_is_no_servo_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="gains of elbow, which is no position servo: there are hinge"):
        nuisances(recorded(tmp_path, said="elbow.kp=50", trials=1))


@pytest.mark.parametrize(("stated", "known"), [(None, GUESSED), ("kp=50±30%,kv=3", 0.3)])
def test_a_converted_model_says_which_gains_were_guessed(tmp_path, stated, known):
    (tmp_path / "r.urdf").write_text(URDF)
    told = {} if stated is None else gains.parsed(stated)
    report = convert(tmp_path / "r.urdf", tmp_path / "r.xml", options=Options(gains=told))
    assert any("guessed" in line for line in report.lines()) == (stated is None)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "r.xml"))
    assert (model.actuator_gainprm[0, 0] == 50) == (stated is not None)
    said = text(model, gains.TEXT)
    assert gains.parsed(said)["hinge", "kp"].known_to == pytest.approx(known)
    recorded(tmp_path, text=f'<custom><text name="{gains.TEXT}" data="{said}"/></custom>', trials=1)
    assert nuisances(tmp_path)[1]["servo_stiffness"].deviation == pytest.approx(known)


def test_a_converted_model_says_how_well_its_masses_are_known_and_a_recording_counts_more(tmp_path):
    (tmp_path / "r.urdf").write_text(URDF)
    report = convert(tmp_path / "r.urdf", tmp_path / "r.xml")
    assert any("masses of the links" in line and "20 %" in line for line in report.lines())
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "r.xml"))
    assert uncertainty(model) == {("link_mass", None): URDF_MASSES}
    silent = convert(tmp_path / "r.urdf", tmp_path / "s.xml", options=Options(masses=None))
    assert uncertainty(silent.spec.compile()) == {}
    said = f'<custom><text name="{UNCERTAINTY}" data="{text(model, UNCERTAINTY)}"/></custom>'
    recorded(tmp_path, text=said, trials=1)
    assert nuisances(tmp_path)[1]["link_mass"].deviation == pytest.approx(0.2)
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"uncertainty": {"link_mass": 0.05}}))
    assert nuisances(tmp_path, map_file=tmp_path / "map.yaml")[1]["link_mass"].deviation == pytest.approx(0.05)


@pytest.mark.parametrize("said", ["", "of a poem", "link_mass=", "link_mass=-1", "link_mass=0.2,", "link_mass=nan"])
def test_a_text_of_that_name_that_says_something_else_is_anothers(said):
    custom = f'<custom><text name="{UNCERTAINTY}" data="{said or " "}"/></custom>'
    assert uncertainty(mujoco.MjModel.from_xml_string(ROBOT.format(kp=1, text=custom))) == {}


def test_nothing_stands_in_for_a_gain_that_was_guessed(tmp_path):
    """A servo a third softer sags and trails more; an encoder's scale explains some of it."""
    folder = recorded(tmp_path, kp=13.0)
    stiff = diagnose(read_recordings([folder]).trials, names=("encoder_scale",), threads=1)
    assert [effect.name for effect in stiff.best.effects] == ["encoder_scale"]
    freed = read_recordings([folder], defaults={"gains": "guessed"}).trials
    assert diagnose(freed, names=("encoder_scale",), threads=1).kind == "no_gap"


def test_a_servo_that_is_a_little_behind_is_simulated_to_a_share_of_that(tmp_path):
    trials = read_recordings([recorded(tmp_path, trials=1)]).trials
    plant = plant_of(trials, model=tmp_path / "robot.xml")
    measured = trials[0].positions["hinge"][None]
    jumps = trailing.share_of_range(plant, trials, 0, measured)
    assert jumps == pytest.approx(1.0)  # behind by every step of the set point
    sent = {"hinge": measured[0] + 0.01 * math.pi * np.sin(np.arange(measured.shape[1]))}
    close = [trials[0].__class__(**{**trials[0].__dict__, "commands": sent})]
    assert trailing.share_of_range(plant, close, 0, measured)[0] < 0.1
