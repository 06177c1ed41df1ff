"""Minari datasets in and out: small ones, in the layout of Minari 0.5; the HDF5 ones are written by minari itself."""

import json
import sys

import gymnasium
import numpy as np
import pyarrow as pa
import pyarrow.dataset
import pytest

import tiago_mj  # noqa: F401  (registers the environments)
from tiago_mj.cli import main
from tiago_mj.envs.flat import core_of
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.io import extra
from tiago_mj.recordings.read import read_recordings

STEPS = 40


def encoded(values, pad):
    """A column as Minari's Arrow storage has it: fixed lists, structures of them, as many rows as observations."""
    if isinstance(values, dict):
        parts = {name: encoded(part, pad) for name, part in values.items()}
        return pa.StructArray.from_arrays(list(parts.values()), names=list(parts))
    values = np.pad(values, [(0, pad)] + [(0, 0)] * (values.ndim - 1))
    if values.ndim == 1:
        return pa.array(values)
    kind = pa.list_(pa.from_numpy_dtype(values.dtype), values.shape[1])
    return pa.FixedSizeListArray.from_arrays(values.reshape(-1), type=kind)


def dataset(folder, episodes, spec=None, seeds=(), form="arrow"):
    data = folder / "data"
    data.mkdir(parents=True)
    for k, (observations, actions) in enumerate(episodes):
        batch = {"observations": encoded(observations, 0), "actions": encoded(actions, 1)}
        batch["rewards"] = pa.array(np.zeros(len(actions) + 1))
        pa.dataset.write_dataset(pa.table(batch), data / str(k), format=form)
        said = {"id": k, "total_steps": len(actions), **({"seed": seeds[k]} if seeds else {})}
        (data / str(k) / "metadata.json").write_text(json.dumps(said))
    content = {"total_episodes": len(episodes), "data_format": form, "dataset_id": "grasps/random-v0"}
    if spec is not None:
        content["env_spec"] = json.dumps(spec)
    (data / "metadata.json").write_text(json.dumps(content))
    return folder


def played(name, seed, **arguments):
    """Observations, actions, and the true states of an episode of random actions."""
    env = gymnasium.make(name, **arguments)
    core = core_of(env)
    observation, _ = env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    seen, acted, states, commands = [observation], [], [core.state], []
    for _ in range(STEPS):
        acted.append(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        seen.append(env.step(acted[-1])[0])
        states.append(core.state)
        commands.append(np.array(core.command))
    env.close()
    goal = isinstance(observation, dict)
    together = {key: np.stack([one[key] for one in seen]) for key in observation} if goal else np.stack(seen)
    return (together, np.stack(acted)), states, np.stack(commands)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("tiago_mj/GripperTactile-v0", {}),
        ("tiago_mj/GripperTactileGoal-v0", {"control": "position", "control_hz": 50}),
        ("tiago_mj/TIAGoReachTactile-v0", {}),
    ],
)
def test_a_dataset_of_our_environments_is_what_was_measured_and_commanded(tmp_path, name, arguments):
    seeds = [3, 4]
    runs = [played(name, seed, **arguments) for seed in seeds]
    spec = {"id": name, "entry_point": "evil:run", "kwargs": {**arguments, "task": "evil:run", "effects": {"x": {}}}}
    source = dataset(tmp_path / "d", [run[0] for run in runs], spec, seeds)
    assert main(["import", "minari", str(source), "--out", str(tmp_path / "out")]) == 0
    trials = read_recordings([tmp_path / "out"]).trials
    assert [trial.name for trial in trials] == ["episode_000000", "episode_000001"]
    for trial, (_, states, commands) in zip(trials, runs, strict=True):
        for k, joint in enumerate(trial.positions):
            np.testing.assert_array_equal(trial.positions[joint], [state.position[k] for state in states])
            np.testing.assert_array_equal(trial.velocities[joint], [state.velocity[k] for state in states])
            np.testing.assert_allclose(trial.commands[joint][:-1], commands[:, k], atol=1e-12)
            assert np.isnan(trial.commands[joint][-1])
        for k, side in enumerate(("right", "left")):
            np.testing.assert_allclose(trial.forces[side], [state.force_raw[k] for state in states], atol=1e-9)
        assert trial.sidecar.robot == name
    plant = plant_of(trials)
    assert plant.environment is not None
    objects = [trial.sidecar.object for trial in trials]
    assert (objects[0] is None) == ("Reach" in name)  # the seed says which object it was


def test_a_dataset_of_another_environment_needs_a_map_that_says_what_is_what(tmp_path, capsys):
    rng = np.random.default_rng(0)
    state = np.cumsum(rng.normal(size=(STEPS + 1, 4)), axis=0)
    source = dataset(tmp_path / "d", [({"state": state}, rng.uniform(-1, 1, (STEPS, 1)))], {"id": "CartPole-v1"})
    call = ["import", "minari", str(source), "--out", str(tmp_path / "out")]
    assert main(call) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "CartPole-v1" in said
    assert "observations.state.0, observations.state.1" in said
    map_file = tmp_path / "map.yaml"
    columns = (
        "columns:\n  observations.state.2: {kind: position, name: pole, unit: deg}\n"
        "  actions.0: {kind: command, name: cart, scale: 10}\n"
    )
    for content, wrong in (
        (columns + "robot: cartpole.xml\ninterface: effort\n", "rate_hz is None"),
        (columns.replace("state.2", "state.9") + "rate_hz: 50\n", "has no column 'observations.state.9'"),
        (columns + "rate_hz: 50\ninterface: effort\n", "which robot is recorded is unknown"),
    ):
        map_file.write_text(content)
        assert main([*call, "--map", str(map_file)]) == 2
        said = capsys.readouterr().err
        assert wrong in said
        assert said.count("\n") == 1
    map_file.write_text(columns + "rate_hz: 50\nrobot: cartpole.xml\ninterface: effort\n")
    assert main([*call, "--map", str(map_file)]) == 0
    (trial,) = read_recordings([tmp_path / "out"]).trials
    np.testing.assert_allclose(trial.positions["pole"], np.deg2rad(state[:, 2]))
    assert trial.time[-1] == pytest.approx(STEPS / 50)
    assert np.abs(trial.commands["cart"][:-1]).max() > 5


def damaged(source, how):
    data = source / "data"
    if how == "no metadata":
        (data / "metadata.json").unlink()
    elif how == "no json":
        (data / "metadata.json").write_text("{")
    elif how == "format":
        (data / "metadata.json").write_text(json.dumps({"data_format": "zip"}))
    elif how == "cut off":
        file = next((data / "0").glob("*.arrow"))
        file.write_bytes(file.read_bytes()[:200])
    elif how == "missing":
        for path in (data / "1").iterdir():
            path.unlink()
        (data / "1").rmdir()


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("no metadata", "data/metadata.json is missing"),
        ("no json", "metadata.json is not readable"),
        ("format", "data_format is 'zip'"),
        ("cut off", "episode 0: not a whole arrow file"),
        ("missing", "1 of 2 episodes are there"),
    ],
)
def test_a_damaged_dataset_ends_in_one_line(tmp_path, capsys, how, said):
    episode = (np.zeros((STEPS + 1, 6)), np.zeros((STEPS, 2), dtype=np.float32))
    source = dataset(tmp_path / "d", [episode, episode], {"id": "tiago_mj/GripperTactile-v0"})
    damaged(source, how)
    assert main(["import", "minari", str(source), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


# With minari ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def store(tmp_path, monkeypatch):
    pytest.importorskip("h5py")
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    return minari


def test_recorded_episodes_are_a_minari_dataset_and_come_back_the_same(tmp_path, store, capsys):
    call = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "2", "--out", str(tmp_path / "a")]
    call += ["--arguments", '{"control_hz": 50}', "--minari", "gripper/pi-v0"]
    assert main(call) == 0
    loaded = store.load_dataset("gripper/pi-v0")
    assert (loaded.total_episodes, loaded.total_steps) == (2, 600)
    env = loaded.recover_environment()
    assert core_of(env).dt == pytest.approx(0.02)
    episode = loaded[1]
    assert env.observation_space.contains(episode.observations[0])
    first, _ = env.reset(seed=1)
    np.testing.assert_array_equal(episode.observations[0], first)
    assert episode.truncations[-1]
    source = tmp_path / "datasets" / "gripper" / "pi-v0"
    assert main(["import", "minari", str(source), "--out", str(tmp_path / "b")]) == 0
    for one, other in zip(
        read_recordings([tmp_path / "a"]).trials, read_recordings([tmp_path / "b"]).trials, strict=True
    ):
        np.testing.assert_array_equal(one.time, other.time)
        for name in one.positions:
            np.testing.assert_array_equal(one.positions[name], other.positions[name])
            np.testing.assert_allclose(one.commands[name], other.commands[name], atol=1e-8)
        np.testing.assert_array_equal(one.forces["left"], other.forces["left"])
        assert one.sidecar.object == other.sidecar.object
        assert one.sidecar.initial == other.sidecar.initial
    capsys.readouterr()
    assert main(call) == 2  # it is there already, and nothing is overwritten
    assert "there is such a dataset" in capsys.readouterr().err
    file = source / "data" / "main_data.hdf5"
    file.write_bytes(file.read_bytes()[:2000])
    assert main(["import", "minari", str(source), "--out", str(tmp_path / "c")]) == 2
    assert "main_data.hdf5: not a whole HDF5 file" in capsys.readouterr().err


def test_a_name_that_is_no_datasets_is_refused_before_anything_is_recorded(tmp_path, store, capsys):
    out = tmp_path / "out"
    call = ["record", "--policy", "random", "--out", str(out), "--minari"]
    assert main([*call, "no version", "--env", "GripperTactile-v0"]) == 2
    assert "--minari no version" in capsys.readouterr().err
    assert main([*call, "a-v0", "--model", "arm.xml"]) == 2
    assert "--minari is of --env" in capsys.readouterr().err
    assert not out.exists()


def test_without_minari_it_is_said_how_to_have_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "minari", None)
    monkeypatch.setitem(sys.modules, "minari.dataset.minari_dataset", None)
    call = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--out", str(tmp_path / "a"), "--minari", "a-v0"]
    assert main(call) != 0
    assert extra.install("minari") in capsys.readouterr().err
