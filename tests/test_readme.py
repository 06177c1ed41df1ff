"""The README's own words: its commands do what it says, as they stand."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.models.convert import convert
from tiago_mj.recordings import lint
from tiago_mj.recordings.read import read_recordings

ROOT = Path(__file__).resolve().parents[1]
PENDULUM = ROOT / "examples" / "pendulum"


def block(name: str) -> str:
    """The shell block of a command."""
    found = re.findall(rf"<!-- command: {name} -->\n```sh\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.S)
    assert len(found) == 1, f"one block of {name}"
    return found[0]


def run(words: str, folder: Path) -> None:
    """Run a block as a user does, in a folder that holds the examples."""
    shutil.copytree(ROOT / "examples", folder / "examples")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["sh", "-ec", words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_the_pendulums_logs_are_those_of_its_urdf_but_for_the_elbow(tmp_path: Path) -> None:
    """They are accepted, and the converted model follows them at the shoulder; the elbow trails by its friction."""
    subprocess.run([sys.executable, PENDULUM / "make_logs.py", "--out", tmp_path / "logs"], check=True)
    convert(PENDULUM / "pendulum.urdf", tmp_path / "pendulum.xml")
    defaults = {"robot": str(tmp_path / "pendulum.xml")}
    trials = read_recordings([tmp_path / "logs"], map_file=PENDULUM / "logs.yaml", defaults=defaults).trials
    plant = plant_of(trials)
    findings = lint.inspect_all(trials, plant)
    lint.refuse(trials, findings)
    assert {finding.code for finding in findings} <= {"quantum"}
    assert len(trials) == 8
    assert {round(float(trial.time[-1] + 0.01), 6) for trial in trials} == {6.0}
    simulated = replay.simulate(
        plant, replay.grid(plant, trials), [(k, ()) for k in range(8)], replay.Run(threads=1)
    ).position
    measured = np.stack([np.stack([trial.positions[j] for j in plant.joints], axis=1) for trial in trials])
    shoulder, elbow = np.sqrt(((simulated - measured) ** 2).mean(axis=(0, 1)))
    assert elbow > 2 * shoulder, "the elbow's friction of 0.25 N·m over 18 N·m/rad is 14 mrad"


@pytest.mark.slow
def test_your_robot_in_ten_minutes_word_for_word(tmp_path: Path) -> None:
    run(block("own-robot"), tmp_path)
    out = tmp_path / "out" / "pendulum" / "diagnosis"
    verdict = json.loads((out / "diagnosis.json").read_text())["verdict"]
    assert [(one["name"], one["target"]) for one in verdict["effects"]] in (
        [("coulomb_friction", "elbow")],
        [("coulomb_friction", ["elbow"])],
    )
    value = verdict["effects"][0]["parameters"]["force"]
    assert value["low"] <= 0.25 <= value["high"]
    repaired = mujoco.MjModel.from_xml_path(str(out / "repaired.xml"))
    assert repaired.joint("elbow").frictionloss[0] == pytest.approx(value["value"])
    assert not list(tmp_path.rglob("MUJOCO_LOG.TXT"))
