"""Preflight says what a recording can tell before anything is fitted, from its commands and the model's uncertainty."""

import json

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401
from tiago_mj.cli import main
from tiago_mj.gap.effects import EFFECTS


@pytest.fixture(scope="module")
def grasp(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grasp")
    assert (
        main(["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2", "--out", str(folder)]) == 0
    )
    return folder


def looked_at(folder, *more):
    path = folder.parent / "preflight.json"
    assert main(["preflight", str(folder), "--jobs", "1", "--out", str(path), *more]) == 0
    return json.loads(path.read_text())


def test_a_grasp_shows_what_it_excites_and_not_what_it_does_not(grasp, capsys):
    found = looked_at(grasp)
    by_name = {one["name"]: one for one in found["effects"]}
    assert by_name["coulomb_friction"]["visible"]
    assert 0.02 < by_name["coulomb_friction"]["smallest_visible"] < 1.0  # of some 10 N that the servo presses with
    assert by_name["command_delay"]["smallest_visible"] < 0.01
    # A gain of the sensor is not seen before it leaves what the nominal gain is known to (5 %).
    assert abs(by_name["force_gain"]["smallest_visible"] - 1) > 0.05
    assert "payload" in found["not_excited"]  # the gripper stands alone and its fingers move horizontally
    assert set(by_name) <= set(EFFECTS)
    assert "coulomb_friction" in capsys.readouterr().out


def test_effects_with_one_signature_are_said_to_be_inseparable(grasp):
    alike = [set(group) for group in looked_at(grasp)["alike"]]
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


def test_the_smallest_visible_magnitude_is_what_a_diagnosis_could_see(grasp, tmp_path):
    """Half of it changes readings by less than the noise and the model's uncertainty; the recording agrees."""
    smallest = next(one for one in looked_at(grasp)["effects"] if one["name"] == "force_bias")["smallest_visible"]
    env = gymnasium.make("tiago_mj/GripperTactile-v0")
    noise = env.unwrapped.core.load_cell.noise if hasattr(env.unwrapped, "core") else env.unwrapped.load_cell.noise
    samples = 2 * 300
    assert noise * np.sqrt(25 / samples) < abs(smallest) < 10 * noise  # between white noise alone and ten deviations


def test_recordings_without_commands_end_in_one_line(tmp_path, capsys):
    (tmp_path / "a.csv").write_text("time,position.gripper_left_finger_joint\n0,0.01\n0.1,0.01\n0.2,0.01\n")
    assert main(["preflight", str(tmp_path), "--env", "GripperTactile-v0"]) == 2
    said = capsys.readouterr().err.strip()
    assert said
    assert "\n" not in said
