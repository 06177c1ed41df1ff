"""Trials of one robot with objects of their own, replayed together."""

from dataclasses import replace

import numpy as np

from tiago_mj.cli import main
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.models import scene
from tiago_mj.recordings.read import read_recordings


def test_a_trial_with_another_object_is_replayed_as_in_a_scene_that_has_it(tmp_path):
    """Bit by bit: every number of the model that the object sets is set, those of its inertia included."""
    words = ["record", "--env", "TIAGoTactile-v0", "--policy", "pi", "--episodes", "1", "--seed", "1"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    (usual,) = read_recordings([tmp_path]).trials
    other = dict(usual.sidecar.object)
    other |= {"mass_kg": 3 * other["mass_kg"], "radius_m": 1.2 * other["radius_m"]}
    heavier = replace(usual, name="heavier", sidecar=replace(usual.sidecar, object=other))
    plant = plant_of([usual, heavier])
    together = replay.simulate(plant, replay.grid(plant, [usual, heavier]), [(0, ()), (1, ())], replay.Run(threads=1))
    alone = plant_of([heavier])
    (start,) = alone.starts.values()
    scene.set_object(alone.model, start.item)
    apart = replay.simulate(alone, replay.grid(alone, [heavier]), [(0, ())], replay.Run(threads=1))
    assert np.array_equal(together.position[1], apart.position[0])
    assert np.array_equal(together.newtons[1], apart.newtons[0])
