"""Public recordings of real servos, diagnosed: what is named, and that it is named for a reason.

TIAGo's arm is in test_inverse_diagnosis.py, the fingertip in
test_ta11_story.py.
"""

import dataclasses
import itertools
from dataclasses import replace

import numpy as np
import pytest
from real_recordings import real

from tiago_mj.cli import main
from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings import lint, travel
from tiago_mj.recordings.imports import so101
from tiago_mj.recordings.nominal_priors import known_to
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError, Sidecar, Trial
from tiago_mj.recordings.trials import correlation_time, cut, cut_long, repeatability, too_long

#: Rhoban/bam, bam/params/xl330/m1.json: reflected inertia [kg·m²] that its authors fitted to their own runs.
PUBLISHED_ARMATURE = 0.0018
#: Enough effects to be wrong with, few enough to be quick.
SOME = ("coulomb_friction", "load_dependent_friction", "viscous_friction", "armature", "payload", "encoder_bias")


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    out = tmp_path_factory.mktemp("xl330")
    assert main(["import", "xl330", str(real("xl330_pendulum")), "--out", str(out)]) == 0
    return read_recordings([out]).trials


@pytest.fixture(scope="module")
def wrist(tmp_path_factory):
    out = tmp_path_factory.mktemp("so101")
    motion = real("so101") / "step_response"
    assert main(["import", "so101", str(motion), "--apart", "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {
        *("Rotation", "Pitch", "Elbow"),
        "Wrist_Pitch",
        "Wrist_Roll",
        "Jaw",
    }
    return read_recordings([out / "Wrist_Roll"]).trials


def named(explanation):
    return {effect.name for effect in explanation.effects}


def diagnosed(trials, **options):
    findings = lint.inspect(trials)
    return diagnose(trials, findings=findings, usable=lint.believed(trials, findings), threads=2, **options)


# XL-330 ---------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_pendulums_servo_rubs_and_reflects_its_rotors_inertia(pendulum):
    found = diagnosed(pendulum, names=SOME)
    assert found.kind in ("effect", "ambiguous")
    for explanation in (found.best, *found.alternatives):
        assert "friction" in {EFFECTS[name].gap_class for name in named(explanation)}
        assert "armature" in named(explanation)
    armature = next(e for e in found.best.effects if e.name == "armature").parameters["mass"]
    # Two motors of one type and two ways to fit: within a half of the published, and well away from none.
    assert abs(armature.value / PUBLISHED_ARMATURE - 1) < 0.5
    assert armature.low > 0
    # Compared up to 12 Hz or more, where torques that are logged 13 ms late leave some of it.
    assert found.shrink.closed > 0.85
    assert found.splits["test"]
    assert any("torque_constant is known to 0.3" in note for note in found.notes)


@pytest.mark.slow
def test_torques_of_other_trajectories_do_not_name_the_pendulums_friction(pendulum):
    """The same numbers in another order: each trajectory with the torques of another."""
    efforts = [trial.commands["pendulum"] for trial in pendulum]
    torn = []
    for k, trial in enumerate(pendulum):
        other = efforts[(k + 2) % len(efforts)]
        other = np.interp(np.linspace(0, 1, len(trial.time)), np.linspace(0, 1, len(other)), other)
        torn.append(dataclasses.replace(trial, commands={"pendulum": other}, efforts={"pendulum": other}))
    found = diagnosed(torn, names=SOME)
    assert found.kind in ("unknown", "no_gap") or (found.shrink.closed or 0.0) < 0.5


@pytest.mark.slow
def test_a_pendulum_that_counts_the_other_way_is_told_so(pendulum):
    flipped = [
        dataclasses.replace(trial, efforts={"pendulum": -trial.efforts["pendulum"]}, commands={}) for trial in pendulum
    ]
    kept = [trial for trial in flipped if not trial.name.startswith("lift_and_drop")]
    found = diagnosed(kept, names=SOME)
    assert "sign" in {finding.code for finding in found.findings}


# SO-101 ---------------------------------------------------------------------------------------------------------------


def test_the_lint_of_a_servo_alone_finds_the_unsigned_torque_and_the_encoders_step(wrist):
    findings = lint.inspect(wrist)
    assert "effort.Wrist_Roll" in {f.channel for f in findings if f.code == "unsigned"}
    said = {f.message for f in findings if f.code == "quantum" and f.channel == "position.Wrist_Roll"}
    assert any("0.001534" in message for message in said)


@pytest.mark.slow
def test_the_wrist_of_the_small_arm_rubs(wrist):
    names = ("coulomb_friction", "viscous_friction", "command_delay")
    found = diagnosed(wrist, names=names)
    assert any(EFFECTS[effect.name].gap_class == "friction" for effect in found.best.effects)
    assert found.shrink.closed > 0.5


def test_commands_of_another_joint_do_not_explain_the_wrist(wrist, tmp_path):
    names = ("coulomb_friction", "viscous_friction", "command_delay")
    torn = [
        dataclasses.replace(trial, commands={"Wrist_Roll": other.commands["Wrist_Roll"][: len(trial.time)]})
        for trial, other in zip(wrist, (*wrist[2:], *wrist[:2]), strict=True)
        if len(other.time) >= len(trial.time)
    ]
    findings = lint.inspect(torn)
    try:
        lint.refuse(torn, findings)
        found = diagnosed(torn, names=names)
    except RecordingError:
        return
    assert found.kind == "unknown" or (found.shrink.closed or 0.0) < 0.5


# Without the data -----------------------------------------------------------------------------------------------------


def recording(command, rate=50.0, lag=5):
    time = np.arange(len(command)) / rate
    position = np.concatenate([np.full(lag, command[0]), command[:-lag]])
    side = Sidecar("tiago_mj.recording/1", "long", "servo.xml", rate, "position", None, None, None, None)
    return Trial("long", time, {"hinge": command}, {"hinge": position}, {}, {}, {}, side, "long.parquet")


def test_a_long_recording_is_cut_where_it_rests():
    swing = np.sin(np.arange(500) / 50 * 2)
    swing[-1] = 0.0
    whole = recording(np.concatenate([np.r_[swing, np.full(100, swing[-1])] for _ in range(4)]))
    parts = cut(whole)
    assert len(parts) == 4
    for part in parts:
        assert part.time[0] == 0.0
        start = part.sidecar.raw["cut_from_s"][0]
        row = int(np.searchsorted(whole.time, start))
        assert part.sidecar.initial["position"]["hinge"] == whole.positions["hinge"][row]
        assert abs(part.sidecar.initial.get("velocity", {}).get("hinge", 0.0)) < 0.3  # rad/s: it rested
    assert len({part.name for part in parts}) == 4


def test_one_without_rests_is_cut_into_blocks_farther_apart_than_its_error_lasts():
    whole = recording(np.sin(np.arange(3000) / 50 * 3))
    parts = cut(whole)
    assert len(parts) >= 4
    ends = [part.sidecar.raw["cut_from_s"] for part in parts]
    gap = min(correlation_time(whole), 2.5)  # no more is given up than a quarter of a part
    for (_, end), (begin, _) in itertools.pairwise(ends):
        assert begin - end >= gap - 0.03
    middle = parts[1]
    row = int(np.searchsorted(whole.time, ends[1][0]))
    speed = np.gradient(whole.positions["hinge"], whole.time)[row]
    assert middle.sidecar.initial["velocity"]["hinge"] == pytest.approx(speed, rel=0.02)
    assert middle.sidecar.initial["set_point"]["hinge"] == whole.commands["hinge"][row]


@pytest.mark.slow
def test_a_lone_long_recording_is_diagnosed_as_several_trials(tmp_path):
    model = tmp_path / "servo.xml"
    model.write_text(so101.servo("hinge"))
    size = np.where(np.arange(1500) < 1000, 0.08, 0.2)  # the last part, which is tested on, moves farther
    whole = recording(size * np.sin(np.arange(1500) / 50 * 3))
    found = diagnose([whole], model=model, names=("coulomb_friction", "command_delay"), threads=2)
    assert found.splits["test"]
    assert found.splits["train"]
    assert any("cut into" in note for note in found.notes)
    assert any("less far" in note and "hinge" in note for note in found.notes)
    assert found.shrink.before is not None


def test_several_long_recordings_are_cut_and_short_ones_beside_them_are_not():
    long = [replace(recording(np.sin(np.arange(100 * 50) / 50 * (3 + k))), name=f"long{k}") for k in range(3)]
    short = replace(recording(np.sin(np.arange(1500) / 50)), name="short")  # 30 s
    parts = cut_long([*long, short])
    assert not any(too_long(part) for part in parts)
    assert [part.name for part in parts if part.name.startswith("short")] == ["short"]
    for k in range(3):
        own = [part for part in parts if part.name.startswith(f"long{k}")]
        assert len(own) >= 8
        assert sum(part.time[-1] for part in own) > 70.0
    assert len(cut_long([short, replace(short, name="other")])) > 2  # two alone leave nothing to choose by


def test_a_lone_short_recording_is_cut_into_shorter_parts():
    def alone(seconds: float) -> list[float]:
        return [part.time[-1] for part in cut_long([recording(np.sin(np.arange(round(50 * seconds)) / 50 * 3))])]

    assert len(alone(4.0)) == 1  # parts of less than 2.5 s tell too little
    assert len(alone(9.0)) in (3, 4)  # some is given up to gaps
    assert min(alone(9.0)) > 1.8
    assert len(alone(16.0)) in (4, 5)
    assert len(alone(20.0)) in (4, 5)
    assert len(alone(24.0)) == 2
    half = recording(np.sin(np.arange(600) / 50 * 3))
    assert len(cut_long([half, replace(half, name="other")])) == 4


def test_parts_of_a_recording_are_compared_in_the_channels_that_the_recording_is_believed_in(tmp_path):
    (tmp_path / "servo.xml").write_text(so101.servo("hinge"))
    turn = np.arange(100 * 50) / 50
    whole = recording(np.sin(3 * turn))
    whole = replace(whole, sidecar=replace(whole.sidecar, robot=str(tmp_path / "servo.xml")))
    whole = replace(whole, velocities={"hinge": np.cos(7 * turn)})  # of another motion: it is left out
    plant = plant_of([whole])
    trusted = lint.believed([whole], lint.inspect_all([whole], plant))
    assert trusted == {"long.parquet": {"position.hinge"}}
    tenths = cut_long([whole])
    for parts in (tenths, cut(tenths[0], 3.0)):  # parts of parts, too
        assert len(parts) > 2
        data = noise_model.collect(plant, parts, trusted)
        assert data.channels == ("position.hinge",)
        assert np.isfinite(data.value).any(axis=(1, 2)).all()


def test_rows_as_well_as_seconds_decide_what_is_too_long():
    fast = recording(np.sin(np.arange(18_000) / 1000 * 9), rate=1000.0)
    parts = cut_long([fast] * 3)
    assert len(parts) > 3
    assert all(len(part.time) <= 15_000 for part in parts)


def test_a_long_stretch_without_rests_among_rests_is_cut_too():
    swing = np.r_[np.sin(np.arange(500) / 50 * 2), np.zeros(100)]
    whole = recording(np.concatenate([*[swing] * 20, np.sin(np.arange(4500) / 50 * 3)]))
    parts = cut_long([whole])
    assert not any(too_long(part) for part in parts)
    last = parts[-1]
    begin, end = last.sidecar.raw["cut_from_s"]
    row = int(np.searchsorted(whole.time, begin - 1e-9))
    assert last.positions["hinge"][0] == whole.positions["hinge"][row]
    assert end == pytest.approx(begin + last.time[-1])


@pytest.mark.parametrize(("trained", "tested", "said"), [(0.4, 1.2, True), (1.2, 0.4, False), (1.0, 1.2, False)])
def test_motions_that_were_smaller_in_training_than_in_the_test_are_told(trained, tested, said):
    swing = np.sin(np.arange(300) / 50 * 3)
    made = [
        replace(recording(size * swing), name=name) for name, size in (("a", trained), ("b", trained), ("c", tested))
    ]
    notes = travel.notes(made, {"train": ["a"], "validation": ["b"], "test": ["c"]})
    assert len(notes) == said
    if said:
        assert "hinge (0.8 against 2.4 rad)" in notes[0]


def test_motions_that_were_slower_in_training_are_told():
    slow, fast = (recording(np.sin(np.arange(600) / 50 * speed)) for speed in (1, 4))
    (note,) = travel.notes([replace(slow, name="a"), replace(fast, name="b")], {"train": ["a"], "test": ["b"]})
    assert "less fast" in note
    assert "rad/s" in note


def test_a_short_recording_stays_whole():
    whole = recording(np.sin(np.arange(500) / 50))
    assert cut(whole) == (whole,)


def test_what_comes_back_differently_each_time_is_how_well_a_position_is_known():
    random = np.random.default_rng(0)
    command = np.tile(np.sin(np.arange(200) / 200 * 2 * np.pi), 20)
    whole = recording(command)
    noisy = dataclasses.replace(whole, positions={"hinge": whole.positions["hinge"] + 0.01 * random.normal(size=4000)})
    assert repeatability([noisy], "hinge") == pytest.approx(0.01, rel=0.05)
    assert repeatability([recording(np.cumsum(random.normal(size=2000)))], "hinge") == 0.0  # nothing comes again


def test_how_well_a_number_is_known_is_read_from_the_sidecars():
    whole = recording(np.sin(np.arange(200) / 50))
    said = dataclasses.replace(whole.sidecar, raw={"uncertainty": {"torque_constant": 0.3, "position": 0.01}})
    known = dataclasses.replace(whole, sidecar=said)
    assert known_to([known]) == {("torque_constant", None): 0.3}
    wrong = dataclasses.replace(whole, sidecar=dataclasses.replace(said, raw={"uncertainty": {"armature": -1}}))
    with pytest.raises(RecordingError, match=r"uncertainty\.armature"):
        known_to([wrong])
    other = dataclasses.replace(said, raw={"uncertainty": {"torque_constant": 0.1}})
    with pytest.raises(RecordingError, match="torque_constant"):
        known_to([known, dataclasses.replace(known, sidecar=other)])
