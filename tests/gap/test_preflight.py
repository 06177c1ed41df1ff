"""Preflight says what a recording can tell before anything is fitted, from its commands and the model's uncertainty."""

import json
import re
import subprocess
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from made_motions import PENDULUM, pendulum
from made_motions import record as recorded_motion

import tiago_mj  # noqa: F401
from tiago_mj.cli import main
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.targets import Targets
from tiago_mj.experiment_design import command, excitation
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.recordings.write import write_trial


@pytest.fixture(scope="module")
def grasp(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grasp")
    assert (
        main(["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "1", "--out", str(folder)]) == 0
    )
    return folder


def looked_at(folder, *more):
    path = folder.parent / "preflight.json"
    assert main(["preflight", str(folder), "--jobs", "1", "--out", str(path), *more]) == 0
    return json.loads(path.read_text())


@pytest.fixture(scope="module")
def seen(grasp):
    """What preflight says of the grasp, and what it prints."""
    with redirect_stdout(StringIO()) as said:
        return looked_at(grasp), said.getvalue()


def test_a_grasp_shows_what_it_excites_and_not_what_it_does_not(seen):
    found, said = seen
    by_name = {one["name"]: one for one in found["effects"]}
    assert by_name["coulomb_friction"]["visible"]
    assert 0.02 < by_name["coulomb_friction"]["smallest_visible"] < 1.0  # of some 10 N that the servo presses with
    assert by_name["command_delay"]["smallest_visible"] < 0.01
    # A gain of the sensor is not seen before it leaves what the nominal gain is known to (5 %).
    assert abs(by_name["force_gain"]["smallest_visible"] - 1) > 0.05
    assert "payload" in found["not_excited"]  # the gripper stands alone and its fingers move horizontally
    assert set(by_name) <= set(EFFECTS)
    assert "coulomb_friction" in said


def test_effects_with_one_signature_are_said_to_be_inseparable(seen):
    alike = [set(group) for group in seen[0]["alike"]]
    assert any({"clock_offset", "command_delay"} <= group for group in alike)
    assert any({"servo_damping", "viscous_friction"} <= group for group in alike)  # the finger's servo has no damping
    assert not any({"coulomb_friction", "force_gain"} <= group for group in alike)


def test_a_robot_that_stands_still_shows_little(tmp_path):
    motion = tmp_path / "still.csv"
    rows = "".join(f"{k / 240:.6f},0,0\n" for k in range(120))
    motion.write_text("time,command.gripper_right_finger_joint,command.gripper_left_finger_joint\n" + rows)
    folder = tmp_path / "still"
    arguments = ["--env", "GripperTactile-v0", "--motion", str(motion), "--out", str(folder)]
    assert main(["record", *arguments]) == 0
    unseen = set(looked_at(folder)["not_excited"])
    assert {"coulomb_friction", "viscous_friction", "backlash", "contact_stiffness", "force_gain", "armature"} <= unseen
    assert "force_bias" not in unseen  # a bias of a reading needs no motion


def test_the_smallest_visible_magnitude_is_what_a_diagnosis_could_see(seen):
    """Half of it changes readings by less than the noise and the model's uncertainty; the recording agrees."""
    smallest = next(one for one in seen[0]["effects"] if one["name"] == "force_bias")["smallest_visible"]
    env = gymnasium.make("tiago_mj/GripperTactile-v0")
    noise = env.unwrapped.core.load_cell.noise if hasattr(env.unwrapped, "core") else env.unwrapped.load_cell.noise
    samples = 300
    assert noise * np.sqrt(25 / samples) < abs(smallest) < 10 * noise  # between white noise alone and ten deviations


def test_an_effect_is_tried_at_the_default_of_the_joint_that_it_is_on():
    limits = np.full(2, np.inf)
    targets = Targets(("rail", "elbow"), ("rail", "elbow"), (), (True, False), limits, limits, (0, 1))
    plant = SimpleNamespace(wiring=SimpleNamespace(targets=targets))
    rubs = Candidate("viscous_friction", None, "damping", (), 0.0, -80.0, 400.0, (), "N·s/m")
    defaults = [excitation._default(plant, replace(rubs, target=target)) for target in (("rail",), ("elbow",), None)]
    slide, hinge = EFFECTS["viscous_friction"].parameters["damping"].default
    assert slide != hinge
    assert defaults == [slide, hinge, slide]


def test_deviations_are_said_as_many_as_they_are_and_not_by_millions(capsys):
    one = {"target": "all", "visible": True, "parameter": "force", "smallest_visible": 1.0, "unit": "N"}
    rows = [
        {**one, "name": f"e{n}", "distance_at_default": far, "by_readings": False}
        for n, far in ((1, 1.2), (2, 4), (3, 3e6))
    ]
    command._show({"trials": 1, "robot": "r", "effects": rows, "not_excited": [], "alike": [], "notes": []}, ())
    said = capsys.readouterr().out
    assert "1 deviation " in said
    assert "4 deviations " in said
    assert "over 10000 deviations" in said


def test_recordings_without_commands_end_in_one_line(tmp_path, capsys):
    (tmp_path / "a.csv").write_text("time,position.gripper_left_finger_joint\n0,0.01\n0.1,0.01\n0.2,0.01\n")
    assert main(["preflight", str(tmp_path), "--env", "GripperTactile-v0"]) == 2
    said = capsys.readouterr().err.strip()
    assert said
    assert "\n" not in said


# Along a motion ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def swinging(tmp_path_factory):
    """A pendulum's motion and effort without commands, and one whose speed never changes but for its sign."""
    folder = tmp_path_factory.mktemp("pendulum")
    (folder / "pendulum.xml").write_text(PENDULUM)
    trial = recorded_motion(pendulum(), ("swing",), spread=1.2, seconds=16)
    sidecar = replace(trial.sidecar, robot="pendulum.xml")
    write_trial(replace(trial, sidecar=sidecar), folder / "swing")
    (folder / "swing" / "pendulum.xml").write_text(PENDULUM)
    return folder / "swing"


def test_a_motion_with_efforts_shows_friction_inertia_and_weight_joint_by_joint(swinging, capsys):
    found = looked_at(swinging)
    by_name = {one["name"]: one for one in found["effects"]}
    friction = by_name["coulomb_friction"]
    assert friction["visible"]
    assert friction["target"] == "all"
    assert 0 < abs(friction["smallest_visible"]) < 0.1  # of a few newton-metres; noise is 1 % of them
    assert by_name["viscous_friction"]["visible"]
    assert by_name["payload"]["visible"]
    assert "command_delay" not in by_name
    assert any("effects on commands" in note for note in found["notes"])
    # One joint that swings about its rest: what turns the base turns the encoder's zero.
    assert any({"gravity_tilt", "encoder_bias"} <= set(group) for group in found["alike"])
    said = capsys.readouterr().out
    assert "coulomb_friction" in said
    assert re.search("Cannot be told apart: .*encoder_bias", said)


def test_what_is_given_is_part_of_what_a_preflight_compares_with(swinging):
    """With a load of 2 kg that is said to be there friction by load shows sooner: the drive carries more."""
    known = ["--effects", json.dumps({"payload": {"mass": 2.0}})]
    light, loaded = (
        {one["name"]: one["smallest_visible"] for one in looked_at(swinging, *more)["effects"]} for more in ([], known)
    )
    assert loaded["load_dependent_friction"] < light["load_dependent_friction"] / 2
    assert loaded["payload"] > 2 * light["payload"], "what is known of a tool's weight is a share of it"


def test_efforts_that_are_none_end_in_one_line(tmp_path, capsys):
    rows = "".join(f"{k / 100},{0.01 * k},0\n" for k in range(300))
    (tmp_path / "a.csv").write_text("time,position.swing,effort.swing\n" + rows)
    (tmp_path / "pendulum.xml").write_text(PENDULUM)
    assert main(["preflight", str(tmp_path / "a.csv"), "--model", str(tmp_path / "pendulum.xml")]) == 2
    said = capsys.readouterr().err.strip()
    assert "effort.swing" in said
    assert "\n" not in said


@pytest.mark.slow
def test_a_pendulum_is_tried_with_inertia_that_it_can_lack(tmp_path, capsys):
    """TIAGo's magnitudes took all inertia of two small links, and what diverged was visible from 6e-9 kg·m²."""
    example = Path(__file__).parents[2] / "examples" / "pendulum"
    subprocess.run([sys.executable, example / "make_logs.py", "--out", tmp_path / "logs"], check=True)
    for number in range(2, 8):
        (tmp_path / "logs" / f"log-{number}.csv").unlink()
    assert main(["convert", str(example / "pendulum.urdf"), "--out", str(tmp_path / "pendulum.xml")]) == 0
    words = ["--model", str(tmp_path / "pendulum.xml"), "--map", str(example / "logs.yaml"), "--jobs", "1", "--json"]
    capsys.readouterr()
    assert main(["preflight", str(tmp_path / "logs"), *words]) == 0
    out, err = capsys.readouterr()
    assert "MuJoCo" not in err
    armature = next(one for one in json.loads(out)["effects"] if one["name"] == "armature")
    assert abs(armature["smallest_visible"]) > 1e-5
