"""The diagnosis names what was put into the simulator, and nothing where nothing was, from files to files."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401
from tiago_mj.cli import main
from tiago_mj.effects import EFFECTS, read_effects
from tiago_mj.gap.decision.verdict import most_probable
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.session import split
from tiago_mj.recordings.grid import grid_step
from tiago_mj.recordings.read import read_recordings

#: Enough rivals to be confused with, few enough for a test.
SHORT = (
    "command_delay",
    "coulomb_friction",
    "backlash",
    "servo_stiffness",
    "force_gain",
    "force_lag",
    "force_noise",
)


def record(folder, effects=None, episodes=3, env="GripperTactile-v0", seed=0):
    arguments = ["record", "--env", env, "--policy", "pi", "--episodes", str(episodes), "--seed", str(seed)]
    if effects is not None:
        arguments += ["--effects", json.dumps(effects)]
    assert main([*arguments, "--out", str(folder)]) == 0
    return read_recordings([folder]).trials


@pytest.mark.parametrize(
    "effects",
    [
        None,
        {"coulomb_friction": {}},
        {"armature": {}},
        {"command_delay": {}, "force_gain": {}},
        {"clock_skew": {}},
        {"encoder_bias": {}},
        {"encoder_scale": {}},
    ],
    ids=str,
)
def test_a_replay_of_a_recording_is_the_recording_without_its_noise(tmp_path, effects):
    trials = record(tmp_path, effects, episodes=2)
    plant = plant_of(trials)
    on = replay.grid(plant, trials)
    signals = replay.simulate(plant, on, [(k, read_effects(effects)) for k in range(len(trials))])
    for k, trial in enumerate(trials):
        for j, joint in enumerate(plant.joints):
            np.testing.assert_allclose(signals.position[k, :, j], trial.positions[joint], atol=1e-12)
        for s, sensor in enumerate(plant.sensors):
            left = trial.forces[sensor] - signals.reading[k, :, s]
            assert left.std() == pytest.approx(0.0077, rel=0.2)  # 300 samples: a standard error of 4 %


def test_sensor_effects_on_kept_runs_are_those_of_a_new_run(tmp_path):
    trials = record(tmp_path, episodes=1)
    plant = plant_of(trials)
    on = replay.grid(plant, trials)
    true = replay.simulate(plant, on, [(0, ())])
    for effects in (
        {"force_lag": {}},
        {"force_drift": {}},
        {"pad_creep": {}},
        {"velocity_filter": {}},
        {"clock_offset": {}},
    ):
        sims = [(0, read_effects(effects))]
        again = replay.simulate(plant, on, sims)
        measured = replay.measure(plant, on, true, sims)
        for signal in ("position", "velocity", "reading"):
            np.testing.assert_allclose(getattr(measured, signal), getattr(again, signal), atol=1e-12)


@pytest.mark.parametrize(
    ("effects", "within", "episodes"),
    [
        ({"coulomb_friction": {"force": 2.5}}, (2.4, 2.6), 2),
        pytest.param({"force_lag": {"time_constant": 0.02}}, (0.018, 0.022), 3, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_one_effect_is_named_with_its_value_and_closes_the_gap_on_trials_kept_aside(
    tmp_path, effects, within, episodes
):
    found = diagnose(record(tmp_path, effects, episodes), names=SHORT, threads=1)
    assert found.kind == "effect"
    (named,) = found.best.effects
    assert EFFECTS[named.name].gap_class == EFFECTS[next(iter(effects))].gap_class  # a delay may be the clock's
    (value,) = named.parameters.values()
    assert within[0] < value.value < within[1]
    assert found.shrink.closed > 0.95
    assert found.splits["test"]
    assert not set(found.splits["test"]) & {*found.splits["train"], *found.splits["validation"]}


def test_without_a_gap_nothing_is_named(tmp_path):
    found = diagnose(record(tmp_path), names=SHORT, threads=1)
    assert found.kind == "no_gap"
    assert found.best.effects == ()
    assert found.shrink.closed is None


@pytest.mark.slow
def test_a_grasp_that_goes_another_way_is_set_aside_and_said(tmp_path):
    """One of five has its object 8 mm farther off than it is said to be, which no nominal number makes up for."""
    effects = {"coulomb_friction": {"force": 2.5}}
    trials = list(record(tmp_path / "as said", effects, episodes=4))
    (odd,) = record(tmp_path / "elsewhere", {**effects, "object_offset": {"distance": 0.008}}, episodes=1, seed=7)
    found = diagnose([*trials[:2], replace(odd, name="odd"), *trials[2:]], names=("coulomb_friction", "force_gain"))
    (named,) = found.best.effects
    # Last bits of a contact, and so the processor, decide where the fit ends: at 2.5 N, or at 2.8 with 2.3 variances
    # left, of which something is said to remain.
    assert (found.kind, named.name) == ("effect", "coulomb_friction")
    assert 2.4 < named.parameters["force"].value < 2.9
    assert found.shrink.closed > 0.95
    assert any("odd" in note and "departs from the simulator's" in note for note in found.notes)


@pytest.mark.slow
def test_a_pair_is_named_though_neither_of_it_is_the_best_single(tmp_path):
    """A dead band alone explains friction and delay better than either: what finds the pair is the sum of changes."""
    trials = record(tmp_path, {"coulomb_friction": {"force": 3.0}, "command_delay": {"seconds": 0.03}}, episodes=4)
    names = ("command_deadband", "coulomb_friction", "command_delay", "command_lag", "backlash", "servo_damping")
    found = diagnose(trials, names=names, threads=1)
    assert {e.name for e in found.best.effects} == {"coulomb_friction", "command_delay"}
    # Four grasps leave a lag of two poles some per cent.
    assert found.best.probability > 0.9 * most_probable(found.best)
    assert found.shrink.closed > 0.95


@pytest.mark.slow
def test_each_finger_may_have_an_effect_of_its_own(tmp_path):
    effects = [
        {"name": "coulomb_friction", "target": ["gripper_right_finger_joint"], "parameters": {"force": 3.0}},
        {"name": "rate_limit", "target": ["gripper_left_finger_joint"], "parameters": {"velocity": 0.03}},
    ]
    names = ("coulomb_friction", "rate_limit", "command_delay", "servo_stiffness")
    found = diagnose(record(tmp_path, effects), names=names, threads=1)
    assert {(e.name, e.target) for e in found.best.effects} == {(e["name"], e["target"][0]) for e in effects}


@pytest.mark.slow
def test_the_repaired_simulator_predicts_the_return_that_was_measured(tmp_path):
    """A servo of a third of the stiffness presses less: the nominal simulator promises a better return."""
    trials = record(tmp_path, {"command_lag": {"time_constant": 0.2}}, episodes=4)
    found = diagnose(trials, names=("command_lag", "force_gain"), policy="pi", threads=1)
    task = found.shrink.task
    assert task["policy"] == "pi"
    assert abs(task["repaired"] - task["measured"]) < 0.2 * abs(task["nominal"] - task["measured"])


def test_an_effect_on_one_finger_is_named_there(tmp_path):
    one = [{"name": "coulomb_friction", "target": "gripper_left_finger_joint", "parameters": {"force": 2.5}}]
    found = diagnose(record(tmp_path, one, episodes=2), names=("coulomb_friction", "force_gain"), threads=1)
    (named,) = found.best.effects
    assert (named.name, named.target) == ("coulomb_friction", "gripper_left_finger_joint")


@pytest.mark.slow
def test_an_effect_that_the_library_lacks_is_not_given_a_name_with_confidence(tmp_path):
    """Leave one out: neither the true effect nor anything of its class is among the candidates."""
    found = diagnose(record(tmp_path, {"pad_creep": {"fraction": 0.4}}), names=("force_gain", "backlash"), threads=1)
    assert found.kind == "unknown" or found.remains


def test_simulations_do_not_depend_on_the_number_of_threads(tmp_path):
    trials = record(tmp_path, episodes=2)
    plant = plant_of(trials)
    on = replay.grid(plant, trials)
    sims = [(k % 2, read_effects({"coulomb_friction": {"force": float(k)}})) for k in range(8)]
    one, many = (replay.simulate(plant, on, sims, replay.Run(threads=n)) for n in (1, 4))
    for name in ("position", "velocity", "effort", "reading", "newtons"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))


def test_from_files_to_files(tmp_path, capsys):
    record(tmp_path / "recordings", {"force_gain": {"factor": 1.4}}, episodes=2)
    others = ",".join(name for name in EFFECTS if name not in ("force_gain", "force_nonlinearity", "force_bias"))
    status = main(
        ["diagnose", str(tmp_path / "recordings"), "--out", str(tmp_path / "out"), "--without", others, "--jobs", "1"]
    )
    assert status == 0
    written = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert written["schema"] == "tiago_mj.diagnosis/1"
    assert written["verdict"]["kind"] in ("effect", "ambiguous")
    named = {e["name"] for a in written["verdict"]["alternatives"] for e in a["effects"]}
    assert "force_gain" in named  # two grasps of one depth: a gain or a nonlinearity
    assert (tmp_path / "out" / "report.html").stat().st_size > 1e6
    repaired = gymnasium.make("tiago_mj/GripperTactile-v0", effects=str(tmp_path / "out" / "calibration.yaml"))
    repaired.reset(seed=0)
    assert "force" in capsys.readouterr().out


@pytest.mark.parametrize("what", ["nothing", "empty", "another robot"])
def test_recordings_that_cannot_be_used_end_in_one_line_and_status_2(tmp_path, capsys, what):
    folder = tmp_path / "recordings"
    if what == "nothing":
        folder.mkdir()
    elif what == "empty":
        folder.mkdir()
        (folder / "a.csv").write_text("time,command.gripper_left_finger_joint\n")
    else:
        record(folder, episodes=1)
        sidecar = next(folder.glob("*.json"))
        sidecar.write_text(sidecar.read_text().replace("GripperTactile-v0", "PR2-v0"))
    capsys.readouterr()
    assert main(["diagnose", str(folder), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.strip()
    assert said
    assert "\n" not in said
    assert not (tmp_path / "out").exists()


def test_test_trials_are_kept_apart_and_one_trial_is_never_its_own_test():
    for count in range(1, 30):
        names = [f"t{k}" for k in range(count)]
        parts = split(names)
        assert sorted(sum(parts.values(), ())) == sorted(names)
        assert bool(parts["test"]) == (count > 1)
        assert parts["train"]


def test_a_grid_is_found_where_there_is_one():
    rng = np.random.default_rng(0)
    noisy = rng.normal(0, 0.01, 500)
    assert grid_step(noisy) == 0.0
    assert grid_step(np.round(noisy / 0.002) * 0.002) == pytest.approx(0.002)
