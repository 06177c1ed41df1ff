"""Effects that are known already are part of every simulation, and what is tried comes on top of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_motions import diagnosed, pendulum, record

from tiago_mj.cli import main
from tiago_mj.effects import read_effects
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.read import read_recordings

FRICTION = {"coulomb_friction": {"force": 2.5}}
PAIRS = [
    (FRICTION, {"command_delay": {"seconds": 0.02}}),
    (FRICTION, {"encoder_scale": {"factor": 1.03}}),
    ({"force_gain": {"factor": 1.3}}, FRICTION),
    ({"force_gain": {"factor": 1.3}}, {"force_lag": {"time_constant": 0.02}}),
    ({"encoder_bias": {"offset": 0.001}}, {"velocity_filter": {}}),
]


def recorded(folder, effects):
    words = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2", "--seed", "5"]
    assert main([*words, "--effects", json.dumps(effects), "--out", str(folder)]) == 0
    return read_recordings([folder]).trials


@pytest.mark.parametrize(("known", "sought"), PAIRS, ids=str)
def test_a_recording_with_two_effects_is_replayed_by_one_that_is_given_and_the_other_on_top(tmp_path, known, sought):
    trials = recorded(tmp_path, {**known, **sought})
    given, more = read_effects(known), read_effects(sought)
    plant = plant_of(trials, given=given)
    on = replay.grid(plant, trials)
    sims = [(k, more) for k in range(len(trials))]
    signals = replay.simulate(plant, on, sims)
    for k, trial in enumerate(trials):
        for j, joint in enumerate(plant.joints):
            np.testing.assert_allclose(signals.position[k, :, j], trial.positions[joint], atol=1e-12)
            np.testing.assert_allclose(signals.velocity[k, :, j], trial.velocities[joint], atol=1e-12)
        for s, sensor in enumerate(plant.sensors):
            assert (trial.forces[sensor] - signals.reading[k, :, s]).std() == pytest.approx(0.0077, rel=0.3)
    # The same through what the fits call, where sensors' effects are applied to kept runs, as here at rows alone.
    predict, _ = predictor(plant, trials)
    np.testing.assert_allclose(
        replace(predict, off=None, between=False)(sims), noise_model.predicted(predict.data, signals), rtol=0, atol=1e-9
    )


def test_two_given_entries_of_one_effect_on_one_target_combine_with_what_is_tried(tmp_path):
    trials = recorded(tmp_path, FRICTION)
    on_top = replay.simulate(
        plant := plant_of(trials, given=read_effects({"coulomb_friction": {"force": 1.5}})),
        replay.grid(plant, trials),
        [(0, read_effects({"coulomb_friction": {"force": 1.0}}))],
    )
    np.testing.assert_allclose(on_top.position[0, :, 0], trials[0].positions[plant.joints[0]], atol=1e-12)


def test_a_given_effect_on_what_the_robot_does_not_have_is_refused(tmp_path):
    trials = recorded(tmp_path, FRICTION)
    with pytest.raises(ValueError, match=r"target 'elbow'.*targets are"):
        plant_of(trials, given=read_effects([{"name": "coulomb_friction", "target": "elbow"}]))


def test_a_given_friction_by_load_has_no_part_in_what_becomes_of_commands(tmp_path):
    trials = recorded(tmp_path, FRICTION)
    plant = plant_of(trials, given=read_effects({"load_dependent_friction": {"coefficient": 0.3}, **FRICTION}))
    late = read_effects({"command_delay": {"seconds": 0.02}})
    chain = replay.only_commands(plant, [late, late])
    assert [effect.name for effect in chain.effects] == ["command_delay"]
    early = replace(plant, given=late)
    assert [effect.name for effect in replay.only_commands(early, [()]).effects] == ["command_delay"]


def test_along_a_motion_a_given_friction_of_half_its_size_leaves_the_other_half():
    rubbing = pendulum()
    rubbing.dof_frictionloss[:] += 0.3
    trial = record(rubbing, ("swing",), spread=1.2, seconds=25)
    found = diagnosed(trial, given=read_effects({"coulomb_friction": {"force": 0.15}}))
    assert [effect.name for effect in found.best.effects] == ["coulomb_friction"]
    assert found.best.effects[0].parameters["force"].value == pytest.approx(0.15, abs=0.02)
