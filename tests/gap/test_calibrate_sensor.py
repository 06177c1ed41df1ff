"""A user's own load cell: its noise, threshold and scale are found in recordings, and environments then have them."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import yaml

import tiago_mj  # noqa: F401
from tiago_mj.cli import main
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.record.environment import Plan, record
from tiago_mj.recordings.recording import RecordingError
from tiago_mj.recordings.write import write_trial
from tiago_mj.rollout.policies import make_policy
from tiago_mj.sensing.load_cell import LoadCell
from tiago_mj.sensing.sheet import named_load_cell
from tiago_mj.sensor_calibration import FALSE_CONTACTS, calibrate
from tiago_mj.sensor_calibration.rest import at_rest

#: A cell unlike the TA11: another scale, fingers that differ, a zero that is off.
MINE = LoadCell(scale=(80.0, 120.0), noise=(0.004, 0.012), bias=(0.02, -0.03))


@pytest.fixture(scope="module")
def grasps(tmp_path_factory):
    """Ten grasps felt by that cell, whose sidecars know the TA11 only, as a user's would."""
    folder = tmp_path_factory.mktemp("grasps")
    for trial in recorded(MINE, 10):
        sidecar = replace(trial.sidecar, sensing={"contact_unit": MINE.contact_unit}, raw={})
        write_trial(replace(trial, sidecar=sidecar), folder)
    return folder


def recorded(cell, episodes, **arguments):
    plan = Plan("tiago_mj/GripperTactile-v0", {"sensing": cell, **arguments}, None, None, "pi")
    return list(record(plan, lambda env: make_policy("pi", env, seed=0, trust=False), episodes=episodes, seed=0))


def calibrated(source, path, *options):
    assert main(["calibrate-sensor", str(source), "--out", str(path), *options]) == 0
    return yaml.safe_load(path.read_text())


def test_noise_bias_threshold_and_scale_lie_in_their_intervals(grasps, tmp_path):
    sheet = calibrated(grasps, tmp_path / "sensor.yaml")
    for k, side in enumerate(("right", "left")):
        found = sheet["sensors"][side]
        truth = {
            "noise": MINE.noise[k],
            "bias": MINE.bias[k],
            "scale": MINE.scale[k],
            "threshold": MINE.bias[k] + 5 * MINE.noise[k],
        }
        for name, value in truth.items():
            assert found[name]["low"] < value < found[name]["high"], (side, name)
            assert found[name]["low"] < found[name]["value"] < found[name]["high"]
        # 700 readings: the MAD's standard error is 4.4 %, a 90 % interval ± 7 %; a scale is known better than a percent
        assert found["noise"]["high"] / found["noise"]["low"] < 1.25
        assert found["scale"]["high"] / found["scale"]["low"] < 1.02
        assert found["grasps"] == 10


def test_an_environment_has_the_calibrated_cell(grasps, tmp_path):
    path = tmp_path / "sensor.yaml"
    calibrated(grasps, path)
    env = gymnasium.make("tiago_mj/GripperTactile-v0", sensing=str(path)).unwrapped
    env.reset(seed=0)
    readings = np.array([env.step([0.0, 0.0])[4]["force_raw"] for _ in range(4000)])
    assert readings.std(axis=0) == pytest.approx(MINE.noise, rel=0.1)  # calibrated to 7 %, seen to 1 %
    assert readings.mean(axis=0) == pytest.approx(MINE.bias, abs=0.001)
    assert env.load_cell.signal(np.full(2, 6.0)) - env.load_cell.bias == pytest.approx(
        np.array(MINE.scale) * 6.0 / MINE.contact_unit, rel=0.01
    )
    assert not env.load_cell.binary(readings).any()
    assert env.load_cell.binary(env.load_cell.signal(np.full(2, 1.0))).all()


def test_the_calibrated_simulator_predicts_the_grasps_it_was_made_from(grasps, tmp_path):
    """The end of the story: with the file, the simulator's readings are the recorded ones, to their noise."""
    path = tmp_path / "sensor.yaml"
    calibrated(grasps, path)
    (mine,) = recorded(named_load_cell(path), 1)
    first = next(t for t in read_recordings([grasps]).trials if t.name == "pi-000")
    rows = slice(0, 120)  # until the force controller has answered to other noise
    for k, side in enumerate(("right", "left")):
        apart = mine.forces[side][rows] - first.forces[side][rows]
        assert apart.std() < 2 * np.sqrt(2) * MINE.noise[k]


def rubbing(force, episodes=3, without=()):
    """Grasps by fingers with dry friction, which the model lacks."""
    friction = {"coulomb_friction": {"force": force}}
    plan = Plan("tiago_mj/GripperTactile-v0", {"sensing": MINE}, friction, None, "pi")
    trials = record(plan, lambda env: make_policy("pi", env, seed=0, trust=False), episodes=episodes, seed=0)
    sidecars = {"sensing": {"contact_unit": MINE.contact_unit}, "raw": {}}
    return [replace(t, sidecar=replace(t.sidecar, **sidecars), **{kind: {} for kind in without}) for t in trials]


@pytest.mark.parametrize("without", [(), ("efforts", "velocities")], ids=str)
def test_friction_that_the_model_lacks_widens_the_scale_to_what_holds_the_truth(without):
    found = calibrate(rubbing(0.5, without=without), threads=1)
    for scale, truth in zip(found.scales, MINE.scale, strict=True):
        low, high = (v * found.contact_unit for v in scale.interval)
        assert low < truth < high
        assert high / low < 1.5
        assert scale.lost[0] == pytest.approx(0.5, rel=0.1)
    (note,) = found.notes
    assert "friction" in note
    assert "--effects" in note


def test_friction_of_half_the_grasp_leaves_no_scale_unless_it_is_given(tmp_path, capsys):
    for trial in rubbing(3.5):
        write_trial(trial, tmp_path / "grasps")
    sheet = calibrated(tmp_path / "grasps", tmp_path / "sensor.yaml")
    assert "scale" not in sheet
    (note,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note")]
    assert "no scale" in note
    assert "--effects calibration.yaml" in note
    known = ["--effects", json.dumps({"coulomb_friction": {"force": 3.5}, "force_gain": {}})]
    sheet = calibrated(tmp_path / "grasps", tmp_path / "sensor.yaml", *known)
    for side, truth in zip(("right", "left"), MINE.scale, strict=True):
        assert sheet["sensors"][side]["scale"]["low"] < truth < sheet["sensors"][side]["scale"]["high"]
        assert sheet["sensors"][side]["scale"]["value"] == pytest.approx(truth, rel=0.01)
    assert "force_gain of --effects: left out" in capsys.readouterr().out


def test_cells_that_read_more_on_the_way_back_have_a_wide_scale():
    plan = Plan("tiago_mj/GripperTactile-v0", {"sensing": MINE}, {"force_hysteresis": {}}, None, "pi")
    trials = list(record(plan, lambda env: make_policy("pi", env, seed=0, trust=False), episodes=3, seed=0))
    found = calibrate(trials, threads=1)
    assert all(scale.turned > 0.02 for scale in found.scales)
    assert any("has fallen against where it has risen" in note for note in found.notes)


def test_a_rarer_false_contact_needs_a_higher_threshold(grasps):
    trials = read_recordings([grasps]).trials
    often, rarely = (calibrate(trials, false_contacts=p, threads=1).rests[0] for p in (1.35e-3, FALSE_CONTACTS))
    z = (often.threshold(1.35e-3)[0] - often.bias) / often.noise
    assert z == pytest.approx(3.0, abs=0.001)  # the paper's code: 3 standard deviations, one reading in 740
    assert (rarely.threshold()[0] - rarely.bias) / rarely.noise == pytest.approx(5.0)


def test_averaged_readings_are_told_from_quiet_ones():
    """A mean of four readings scatters half as much and repeats itself: fewer independent readings, the same sample."""
    plain, averaged = (recorded(LoadCell(average=k), 4) for k in (1, 4))
    one, four = (at_rest(trials)[0] for trials in (plain, averaged))
    assert four.noise == pytest.approx(one.noise / 2, rel=0.25)
    assert four.independent < 0.5 * four.readings
    assert calibrate(averaged, threads=1).average == 4


def test_rest_alone_gives_noise_and_threshold(tmp_path):
    rng = np.random.default_rng(0)
    rows = [f"{k / 100:.2f},{a:.6f},{b:.6f}" for k, (a, b) in enumerate(rng.normal(0.1, 0.005, (2000, 2)))]
    (tmp_path / "rest.csv").write_text("time,force.right,force.left\n" + "\n".join(rows) + "\n")
    sheet = calibrated(tmp_path / "rest.csv", tmp_path / "sensor.yaml")
    assert "scale" not in sheet
    assert "scale" not in sheet["sensors"]["left"]
    assert sheet["sensors"]["left"]["noise"]["low"] < 0.005 < sheet["sensors"]["left"]["noise"]["high"]
    assert sheet["threshold"] == pytest.approx([0.125] * 2, rel=0.03)
    cell = gymnasium.make("tiago_mj/GripperTactile-v0", sensing=str(tmp_path / "sensor.yaml")).unwrapped.load_cell
    assert cell.scale == 100.0  # the TA11's, where nothing else is known


def test_intervals_of_the_noise_hold_the_truth_as_often_as_they_say(tmp_path):
    """90 % intervals, 200 draws: 90 ± 2.1 %; four standard errors are allowed."""
    template = recorded(LoadCell(), 1)[0]
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(200):
        forces = {"right": rng.normal(0.0, 0.01, len(template.time))}
        low, high = at_rest([replace(template, forces=forces)])[0].noise_interval
        hits += low < 0.01 < high
    assert 0.815 < hits / 200 < 0.985


def test_grasps_of_another_object_are_not_matched(tmp_path):
    trials = recorded(LoadCell(), 2, object_width=0.06)
    for trial in trials:
        trial.sidecar.object.update(radius_m=0.01, width_m=0.02)  # what the user wrote: touched much later
    found = calibrate(trials, threads=1)
    assert not found.scales
    assert any("no grasp as simulated" in note for note in found.notes)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("no force", "no load cell"),
        ("no rest", "no rest"),
        ("dead", "without any noise"),
        ("nothing", "no such file"),
        ("no yaml", "ends with .yaml"),
        ("probability", "probability"),
    ],
)
def test_what_cannot_be_calibrated_ends_in_one_line(tmp_path, capsys, change, says):
    rng = np.random.default_rng(0)
    time = np.arange(200) / 25
    command = np.sin(time) if change == "no rest" else np.zeros(200)
    force = np.zeros(200) if change == "dead" else rng.normal(0, 0.01, 200)
    columns = {"time": time, "command.a": command, "position.a": 0.02 + 0.001 * np.sin(time), "force.right": force}
    if change == "no force":
        del columns["force.right"]
    file = tmp_path / "trial.csv"
    np.savetxt(file, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    file.with_suffix(".json").write_text(json.dumps({"interface": "position", "robot": "gripper_ta11"}))
    source = tmp_path / "absent" if change == "nothing" else file
    out = tmp_path / ("sensor.txt" if change == "no yaml" else "sensor.yaml")
    options = ["--false-contacts", "2"] if change == "probability" else []
    assert main(["calibrate-sensor", str(source), "--out", str(out), *options]) == 2
    said = capsys.readouterr().err.strip()
    assert says in said
    assert "\n" not in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no sensor file"),
        ("schema: tiago_mj.calibration/1\n", "describes no load cell"),
        ("schema: tiago_mj.sensor/1\n", "says nothing"),
        ("schema: tiago_mj.sensor/1\nnoise: [1, 2, 3]\n", "noise"),
        ("schema: tiago_mj.sensor/1\nscale: loud\n", "scale"),
        ("{", "no valid YAML"),
    ],
)
def test_a_sensor_file_that_is_none_is_refused_by_name(tmp_path, content, says):
    path = tmp_path / "sensor.yaml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match=says) as fault:
        gymnasium.make("tiago_mj/GripperTactile-v0", sensing=str(path))
    assert "sensor.yaml" in str(fault.value)


def test_recordings_without_rest_name_the_mend():
    (trial,) = recorded(LoadCell(), 1)
    with pytest.raises(RecordingError, match="record some seconds with the fingers open"):
        at_rest([trial], [np.ones(len(trial.time), dtype=bool)])
