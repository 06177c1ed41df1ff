"""Lint of recordings of a user's own model: what is at fault is named, recording or model, in one line each."""

from dataclasses import replace

import numpy as np
import pytest

from tiago_mj.cli import main
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.lint import believed, inspect_all, refuse, summary, usable
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.record import Motion
from tiago_mj.recordings.record.plain import ModelPlan, record_model
from tiago_mj.recordings.recording import Finding, RecordingError
from tiago_mj.recordings.write import write_trial

ARM = """
<mujoco>
  <compiler {compiler}/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" range="{range}" damping="0.5" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" range="{range}" damping="0.5" armature="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="motor_1" joint="shoulder" kp="200" kv="20"/>
    <position name="motor_2" joint="elbow" kp="200" kv="20"/>
  </actuator>
</mujoco>
"""
RADIANS = {"compiler": 'angle="radian"', "range": "-2.5 2.5"}


def model_file(folder, **changes):
    path = folder / "arm.xml"
    path.write_text(ARM.format(**{**RADIANS, **changes}))
    return path


def moves(path, episodes=2, alike=0.0):
    """Both joints follow sines; of ``alike`` the elbow has the shoulder's motion."""
    time = np.arange(400) / 100
    trials = []
    for number in range(episodes):
        one = np.sin(2 * np.pi * 0.5 * time + number)
        other = alike * one + (1 - alike) * np.sin(2 * np.pi * (0.8 + 0.1 * number) * time)
        motion = Motion("sweep", time, {"motor_1": 0.8 * one, "motor_2": 0.8 * other}, "position", 100.0)
        trials += record_model(ModelPlan(path, motion, "sweep", robot=str(path)), episodes=1, seed=number)
    return trials


def without(trials, *kinds):
    return [replace(trial, **{kind: {} for kind in kinds}) for trial in trials]


def exchanged(trials, kind, one, other):
    out = []
    for trial in trials:
        columns = getattr(trial, kind)
        out.append(replace(trial, **{kind: {**columns, one: columns[other], other: columns[one]}}))
    return out


def looked_at(trials, model):
    return inspect_all(trials, plant_of(trials, model=model))


@pytest.mark.parametrize("alike", [0.0, 0.7])
@pytest.mark.parametrize("kind", ["positions", "commands"])
@pytest.mark.parametrize("bare", [("efforts",), ("efforts", "velocities")])
def test_exchanged_joints_are_found_whatever_their_actuators_are_called(tmp_path, kind, alike, bare):
    path = model_file(tmp_path)
    trials = without(moves(path, alike=alike), *bare)
    assert not looked_at(trials, path)
    pair = ("motor_1", "motor_2") if kind == "commands" else ("shoulder", "elbow")
    wrong = exchanged(trials, kind, *pair)
    findings = [f for f in looked_at(wrong, path) if f.refuses]
    assert {f.code for f in findings} == {"swapped_channels"}
    assert all("'shoulder' and 'elbow' are exchanged" in f.message for f in findings)
    with pytest.raises(RecordingError, match="exchanged"):
        refuse(wrong, findings)


def test_degrees_are_found_by_the_servos_of_joints_without_a_range(tmp_path):
    path = model_file(tmp_path)
    text = path.read_text().replace(' range="-2.5 2.5"', "").replace('kp="200"', 'kp="200" ctrlrange="-1 1"')
    path.write_text(text)
    trials = without(moves(path), "velocities", "efforts")
    assert not [f for f in looked_at(trials, path) if f.code in ("degrees", "unit_scale", "sign", "contradiction")]
    turned = [
        replace(
            trial,
            positions={name: np.degrees(values) for name, values in trial.positions.items()},
            commands={name: np.degrees(values) for name, values in trial.commands.items()},
        )
        for trial in trials
    ]
    found = [f for f in looked_at(turned, path) if f.refuses]
    assert {f.code for f in found} == {"degrees"}
    assert {f.channel for f in found} >= {"position.elbow", "command.motor_2"}
    assert "its servo's set point (ctrlrange) from -1 to 1: so it is in deg: write" in str(found[0])


def test_a_model_whose_radians_are_read_as_degrees_is_named_and_not_the_recording(tmp_path):
    trials = moves(model_file(tmp_path))
    path = model_file(tmp_path, compiler="")  # MuJoCo reads degrees: ± 2.5°
    (finding,) = [f for f in looked_at(trials, path) if f.refuses]
    assert 'angle="radian"' in finding.message
    assert "the model" in finding.message
    assert not finding.channel


def test_a_stated_unit_is_not_asked_for_again(tmp_path):
    path = model_file(tmp_path)
    folder = tmp_path / "degrees"
    for trial in moves(path):
        turned = {j: np.degrees(values) for j, values in trial.positions.items()}
        write_trial(replace(trial, positions=turned, velocities={}, efforts={}), folder)
    columns = "".join(f"  position.{j}: {{kind: position, name: {j}, unit: deg}}\n" for j in ("shoulder", "elbow"))
    (tmp_path / "map.yaml").write_text("columns:\n" + columns)
    read = read_recordings([folder], map_file=tmp_path / "map.yaml")
    assert not [f for f in looked_at(read.trials, path) if f.refuses]
    small = model_file(tmp_path, range="-0.3 0.3")  # stated, converted, and still beyond what the model allows
    refusing = [f for f in looked_at(read.trials, small) if f.refuses]
    assert {f.channel for f in refusing} >= {"position.shoulder", "command.motor_1"}
    assert all("stated to be in deg and converted: mend that unit, or the model's range" in f.message for f in refusing)


def test_a_velocity_that_contradicts_a_converted_position_names_the_conversion(tmp_path):
    path = model_file(tmp_path)
    folder = tmp_path / "mixed"
    for trial in moves(path):
        write_trial(replace(trial, efforts={}), folder)  # both are radians; the map says that positions are degrees
    columns = "".join(f"  position.{j}: {{kind: position, name: {j}, unit: deg}}\n" for j in ("shoulder", "elbow"))
    (tmp_path / "map.yaml").write_text("columns:\n" + columns)
    read = read_recordings([folder], map_file=tmp_path / "map.yaml")
    findings = [f for f in looked_at(read.trials, path) if f.code == "degrees"]
    assert findings
    assert all("stated to be in deg and converted: take that unit out" in f.message for f in findings)


def test_a_conversion_of_degrees_is_one_line_however_many_files_and_columns(tmp_path):
    path = model_file(tmp_path)
    folder = tmp_path / "degrees"
    for trial in moves(path, episodes=6):
        turned = {j: np.degrees(values) for j, values in trial.positions.items()}
        write_trial(replace(trial, positions=turned, velocities={}, efforts={}), folder)
    columns = "".join(f"  position.{j}: {{kind: position, name: {j}, unit: deg}}\n" for j in ("shoulder", "elbow"))
    (tmp_path / "map.yaml").write_text("columns:\n" + columns)
    read = read_recordings([folder], map_file=tmp_path / "map.yaml")
    assert len(read.findings) == 12
    (row,) = summary(read.findings)
    assert str(row).startswith("degrees: sweep-000.parquet and 5 more recordings, position.shoulder, position.elbow: ")


def test_findings_that_differ_in_numbers_alone_are_one_kind_and_others_are_not():
    def finding(code, file, channel, message, **more):
        return Finding(code, file, channel, message, **more)

    rows = summary(
        [
            finding("quantum", "a.csv", "position.x", "it comes in steps of 0.001: smaller changes are not seen"),
            finding("quantum", "b.csv", "force.left", "it comes in steps of 2e-05: smaller changes are not seen"),
            finding("degrees", "a.csv", "position.x", "stated to be in deg; multiplied by 0.0174533", repaired=True),
            finding("dead_channel", "a.csv", "force.left", "it reads 0 throughout", discredits=True),
            finding("sign", "a.csv", "command.x", "the joint moves against it", refuses=True),
        ]
    )
    assert [row.code for row in rows] == ["sign", "dead_channel", "quantum", "degrees"]
    quantum = rows[2]
    assert quantum.channels == ("position.x", "force.left")
    assert str(quantum).startswith("quantum: a.csv, b.csv, position.x, force.left: such as: it comes in steps of 0.001")


# Coarse grids --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def grasps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grasps")
    words = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "3", "--out", str(folder)]
    assert main(words) == 0
    return read_recordings([folder]).trials


def rounded(trial, step, rows=slice(None)):
    return replace(
        trial,
        time=trial.time[rows],
        commands={k: v[rows] for k, v in trial.commands.items()},
        positions={k: v[rows] for k, v in trial.positions.items()},
        velocities={k: v[rows] for k, v in trial.velocities.items()},
        efforts={k: v[rows] for k, v in trial.efforts.items()},
        forces={k: np.round(v[rows] / step) * step for k, v in trial.forces.items()},
    )


@pytest.mark.parametrize("noise", [None, 0.0077])
@pytest.mark.parametrize("trials", ["some touch", "none touches"])
def test_a_load_cell_whose_grid_hides_its_noise_is_not_dead(grasps, trials, noise):
    """Ten times their noise: at rest they read one value."""
    free = slice(0, 60)  # before contact
    some = [rounded(t, 0.075, free if k or trials == "none touches" else slice(None)) for k, t in enumerate(grasps)]
    some = [replace(t, sidecar=replace(t.sidecar, sensing={"noise": noise} if noise else {})) for t in some]
    plant = plant_of(grasps)
    findings = inspect_all(some, plant)
    assert "dead_channel" not in {f.code for f in findings}
    assert all("force.left" in usable(t, findings) for t in some)
    refuse(some, findings)


def test_of_two_coarse_cells_the_one_that_reads_nothing_while_the_other_is_pressed_is_dead(grasps):
    some = [rounded(t, 0.075) for t in grasps]
    some = [replace(t, forces={**t.forces, "left": np.zeros(len(t.time))}) for t in some]
    dead = [f for f in inspect_all(some, plant_of(grasps)) if f.code == "dead_channel"]
    assert {f.channel for f in dead} == {"force.left"}
    assert "while force.right is pressed" in dead[0].message


def test_a_coarse_cell_that_nothing_touches_in_one_recording_is_not_dead_while_the_other_is_pressed(grasps):
    some = [rounded(t, 0.15) for t in grasps]
    some[1] = replace(some[1], forces={**some[1].forces, "left": np.zeros(len(some[1].time))})
    assert np.ptp(some[1].forces["right"]) > 0.5
    findings = inspect_all(some, plant_of(grasps))
    assert not [f for f in findings if f.discredits]
    assert all("force.left" in names for names in believed(some, findings).values())


def test_a_coarse_cell_that_holds_a_line_is_not_stuck(grasps):
    """At 24 Hz every reading of a ramp is another line, as if there were noise, and then the force is held."""
    step, some = 0.15, []
    for number, trial in enumerate(grasps):
        cut = rounded(trial, step, slice(None, None, 10))
        ramp = step * np.arange(4 * len(cut.time) // 10)
        held = np.full(len(cut.time) // 2, ramp[-1])
        pressed = np.concatenate(
            [ramp, held, ramp[::-1][: len(cut.time) - len(ramp) - len(held)] + (2 + number) * step]
        )
        some.append(replace(cut, forces={**cut.forces, "left": pressed}))
    assert not [f for f in inspect_all(some, plant_of(grasps)) if f.code == "stuck"]


def test_what_is_dead_in_one_recording_is_compared_in_the_others(grasps):
    broken = replace(grasps[1], forces={**grasps[1].forces, "right": np.zeros(len(grasps[1].time))})
    some = [grasps[0], broken, grasps[2]]
    plant = plant_of(some)
    findings = inspect_all(some, plant)
    assert {(f.code, f.channel, f.file) for f in findings if f.discredits} == {
        ("dead_channel", "force.right", broken.source)
    }
    data = noise_model.collect(plant, some, believed(some, findings))
    read = np.isfinite(data.value[:, :, data.channels.index("force.right")]).any(axis=1)
    assert list(read) == [True, False, True]
    assert np.isfinite(data.sigma).all()


def test_a_stated_grid_excuses_an_encoder_that_never_changes_by_less(tmp_path):
    path = model_file(tmp_path)
    (slow,) = moves(path, episodes=1)
    still = replace(slow, efforts={}, positions={**slow.positions, "elbow": np.full(len(slow.time), 0.1)})
    dead = ("dead_channel", "position.elbow")
    assert dead in {(f.code, f.channel) for f in looked_at([still], path)}

    def stating(step):
        raw = {**still.sidecar.raw, "quantum": {"position.elbow": step}}
        return replace(still, sidecar=replace(still.sidecar, raw=raw))

    far = float(np.ptp(slow.positions["elbow"]))
    assert dead not in {(f.code, f.channel) for f in looked_at([stating(far)], path)}
    assert dead in {(f.code, f.channel) for f in looked_at([stating(far / 10)], path)}


@pytest.mark.parametrize(
    ("said", "mend"),
    [
        ("0.1", "write steps by kind or column"),
        ({"force": -0.1}, "a positive number"),
        ({"force": True}, "a positive number"),
        ({"fource": 0.1}, "none of its columns"),
    ],
)
def test_a_stated_grid_that_cannot_be_is_refused_in_one_line(grasps, said, mend):
    wrong = [replace(t, sidecar=replace(t.sidecar, raw={**t.sidecar.raw, "quantum": said})) for t in grasps]
    with pytest.raises(RecordingError, match=mend) as fault:
        plant_of(wrong)
    assert "\n" not in str(fault.value)


def test_recordings_of_one_robot_state_one_grid(grasps):
    def stating(trial, step):
        return replace(trial, sidecar=replace(trial.sidecar, raw={**trial.sidecar.raw, "quantum": {"force": step}}))

    assert plant_of([stating(t, 0.1) for t in grasps]).grids == {"force.right": 0.1, "force.left": 0.1}
    with pytest.raises(RecordingError, match="one sensor has one grid"):
        plant_of([stating(t, 0.1 * (k + 1)) for k, t in enumerate(grasps)])


def test_an_encoder_of_eight_bits_is_not_dead_where_the_joint_moves_less_than_its_step(tmp_path):
    path = model_file(tmp_path)
    step = 2 * np.pi / 256
    far, near = moves(path, episodes=2)
    time = np.arange(400) / 100
    small = {"motor_1": 0.006 * np.sin(3 * time) + 0.05, "motor_2": 0.006 * np.sin(4 * time) + 0.05}
    plan = ModelPlan(path, Motion("small", time, small, "position", 100.0), "small", robot=str(path))
    (held,) = record_model(plan, episodes=1, seed=5)
    rest = slice(150, None)  # it has arrived
    held = replace(
        held,
        time=held.time[rest] - held.time[150],
        commands={k: v[rest] for k, v in held.commands.items()},
        positions={k: v[rest] for k, v in held.positions.items()},
        velocities={k: v[rest] for k, v in held.velocities.items()},
        efforts={},
        sidecar=replace(held.sidecar, initial=None),
    )
    coarse = [
        replace(t, efforts={}, positions={j: np.round(v / step) * step for j, v in t.positions.items()})
        for t in (far, near, held)
    ]
    assert all(np.ptp(v) == 0 for v in coarse[2].positions.values())
    assert "dead_channel" not in {f.code for f in looked_at(coarse, path)}
    stopped = replace(coarse[0], positions={**coarse[0].positions, "elbow": np.zeros(400 + 1)[: len(far.time)]})
    assert ("dead_channel", "position.elbow") in {(f.code, f.channel) for f in looked_at([stopped, *coarse[1:]], path)}
