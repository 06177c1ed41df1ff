"""Recordings that several tests of the search fit."""

import pytest

from tiago_mj.cli import main
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings


@pytest.fixture(scope="module")
def grasps(tmp_path_factory):
    """Two simulated grasps: the nominal simulator, what is replayed, and what was measured."""
    folder = tmp_path_factory.mktemp("grasps")
    words = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2", "--seed", "3"]
    assert main([*words, "--out", str(folder)]) == 0
    trials = read_recordings([folder]).trials
    plant = plant_of(trials)
    return plant, replay.grid(plant, trials), noise_model.collect(plant, trials)
