"""Importers of public recordings: units, signs and traps of the real data, and imports that cannot be used."""

import json

import mujoco
import numpy as np
import pytest
from real_recordings import real

from tiago_mj.cli import main
from tiago_mj.models import names
from tiago_mj.recordings.imports import public, so101, tiago_arm, xl330
from tiago_mj.recordings.lint import inspect, refuse, usable
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError


def codes(findings):
    return {(finding.code, finding.channel) for finding in findings}


@pytest.fixture(scope="module")
def tiago(tmp_path_factory):
    out = tmp_path_factory.mktemp("tiago")
    assert main(["import", "tiago-arm", str(real("tiago_arm")), "--out", str(out)]) == 0
    return read_recordings([out]).trials


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    out = tmp_path_factory.mktemp("so101")
    assert main(["import", "so101", str(real("so101")), "--out", str(out)]) == 0
    return read_recordings([out]).trials


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    out = tmp_path_factory.mktemp("xl330")
    assert main(["import", "xl330", str(real("xl330_pendulum")), "--out", str(out)]) == 0
    return read_recordings([out]).trials


def test_tiagos_currents_become_torques_that_oppose_no_motion(tiago):
    (trial,) = tiago
    assert len(trial.time) == 8022
    assert not trial.commands
    assert set(trial.efforts) == set(tiago_arm.JOINTS)
    # Unit and sign: over the excitation a motor gives energy to friction, so its work is positive; with a lost or
    # flipped sign of kmotor it would be negative for arm_3 to arm_4.
    for joint in names.ARM[:4]:
        power = trial.efforts[joint] * trial.velocities[joint]
        assert power.sum() > 0.2 * np.abs(power).sum(), joint
    # The upper arm held out sideways: tens of N·m for arm_2 (13 kg·0.3 m or so), not hundreds, not one.
    assert 10 < np.abs(trial.efforts["arm_2_joint"]).max() < 100


def test_the_lint_of_the_tiago_arm_says_what_the_recording_truly_holds(tiago):
    findings = inspect(tiago)
    refuse(tiago, findings)
    dead = {f"effort.{joint}" for joint in names.ARM[4:]}
    assert {channel for code, channel in codes(findings) if code == "dead_channel"} == dead
    assert not dead & usable(tiago[0], findings)
    assert {"clock_jitter", "quantum", "single_trial"} <= {code for code, _ in codes(findings)}
    late = [f for f in findings if f.code == "contradiction"]
    assert {f.channel for f in late} == {f"velocity.{joint}" for joint in tiago_arm.JOINTS}
    assert all("late" in f.message for f in late)
    said = {"clock_jitter", "dead_channel", "quantum", "single_trial", "contradiction"}
    assert {code for code, _ in codes(findings)} == said


@pytest.mark.slow
def test_so101s_motions_are_trials_with_commands_and_measurements_on_the_same_clock(arm):
    assert {trial.name for trial in arm} == {path.name for path in real("so101").iterdir() if path.is_dir()}
    for trial in arm:
        assert trial.sidecar.interface == "position"
        assert trial.sidecar.rate_hz == pytest.approx(49.85, abs=0.05)
        assert trial.time[0] == 0.0
        assert np.median(np.diff(trial.time)) == pytest.approx(0.02006, abs=1e-4)
        for joint, command in trial.commands.items():  # servos track: what is measured is what is commanded, but late
            if np.ptp(command) > 0.1:
                assert np.corrcoef(command[:-5], trial.positions[joint][5:])[0, 1] > 0.8, (trial.name, joint)


@pytest.mark.slow
def test_the_lint_of_so101_finds_its_traps_and_no_others(arm):
    findings = inspect(arm)
    refuse(arm, findings)
    joints = list(arm[0].positions)
    assert {channel for code, channel in codes(findings) if code == "unsigned"} == {f"effort.{j}" for j in joints}
    step = 2 * np.pi / 4096  # of the encoder
    for finding in findings:
        if finding.code == "quantum" and finding.channel.startswith("position.") and "Jaw" not in finding.channel:
            assert f"steps of {step:.4g}" in finding.message
    assert {channel for code, channel in codes(findings) if code == "unit_scale"} == {"velocity.Jaw"}
    assert {code for code, _ in codes(findings)} == {"unsigned", "quantum", "unit_scale"}
    assert all("position.Elbow" in usable(trial, findings) for trial in arm)


def test_the_pendulums_model_is_its_mass_at_its_length(pendulum):
    model = mujoco.MjModel.from_xml_path(pendulum[0].sidecar.robot)
    data = mujoco.MjData(model)
    data.qpos[0] = np.pi / 2
    mujoco.mj_forward(model, data)
    assert data.qfrc_bias[0] == pytest.approx(0.49 * 9.81 * 0.10, rel=1e-6)  # m g l, pulling back to 0
    data.qpos[0] = 0.2
    data.qvel[0] = 0.0
    mujoco.mj_forward(model, data)
    # A point mass: acceleration = -g/l sin q, but for the sphere's own 0.4 % of inertia.
    assert data.qacc[0] == pytest.approx(-9.81 / 0.10 * np.sin(0.2), rel=0.005)


def test_the_servos_pwm_is_its_gain_times_the_position_error(pendulum):
    """What the nominal stiffness of the position servo rests on."""
    for trial in pendulum:
        on = trial.extras["torque_enable"] > 0
        error = (trial.extras["goal_position"] - trial.positions["pendulum"])[on]
        slope = float(trial.extras["pwm"][on] @ error / (error @ error))
        assert slope / trial.sidecar.servo["kp"] == pytest.approx(xl330.PWM_PER_RADIAN, rel=0.02), trial.name


def test_the_imported_torque_carries_the_pendulums_weight(pendulum):
    """Lifted slowly, the motor's torque is m g l sin q and friction: sign and order of magnitude agree."""
    for trial in pendulum:
        if not trial.name.startswith("up_and_down"):
            continue
        q, torque = trial.positions["pendulum"], trial.commands["pendulum"]
        weight = 0.49 * 9.81 * 0.10 * np.sin(q)
        assert np.corrcoef(weight, torque)[0, 1] > 0.9
        # Friction resists the lift, and the data sheet's stall torques at three voltages differ by 30 % from a line
        # through zero: a factor of 2 is what both allow.
        assert 0.5 < float(weight @ torque / (weight @ weight)) < 2.0


def test_the_torque_is_zero_while_it_is_switched_off(pendulum):
    for trial in pendulum:
        off = trial.extras["torque_enable"] == 0
        assert off.any() == trial.name.startswith("lift_and_drop")
        np.testing.assert_array_equal(trial.commands["pendulum"][off], 0.0)
        if off.any():  # and it swings freely: back through the bottom
            swing = trial.positions["pendulum"][off]
            assert swing.min() < 0 < swing.max()


def test_the_lint_of_the_pendulum_says_what_it_truly_holds(pendulum):
    findings = inspect(pendulum)
    refuse(pendulum, findings)
    assert {code for code, _ in codes(findings)} == {"clock_jitter", "quantum"}
    jittery = {f.file for f in findings if f.code == "clock_jitter"}
    assert jittery == {t.source for t in pendulum if t.name.startswith("lift_and_drop")}


def test_goal_positions_are_commands_on_request_one_folder_a_gain(tmp_path):
    call = ["import", "xl330", str(real("xl330_pendulum")), "--commands", "position", "--out", str(tmp_path)]
    assert main(call) == 0
    for gain in (100, 200):
        trials = read_recordings([tmp_path / f"kp{gain}"]).trials
        assert len(trials) == 4
        model = mujoco.MjModel.from_xml_path(trials[0].sidecar.robot)
        stiffness = gain * 4096 / (2 * np.pi) / 256 / 885 * 7.4 * 0.52 / 5.0
        assert model.actuator_gainprm[0, 0] == pytest.approx(stiffness, rel=1e-5)
        for trial in trials:
            assert trial.sidecar.interface == "position"
            assert (trial.extras["torque_enable"] > 0).all()
            np.testing.assert_array_equal(trial.commands["pendulum"], trial.extras["goal_position"])


# Without the data -----------------------------------------------------------------------------------------------------


def test_sources_that_are_not_there_end_in_one_line(tmp_path, capsys):
    for kind in ("tiago-arm", "so101", "xl330"):
        for source in (tmp_path / "nowhere", tmp_path):
            assert main(["import", kind, str(source), "--out", str(tmp_path / "out")]) == 2
            error = capsys.readouterr().err
            assert error.count("\n") == 1
            assert str(tmp_path) in error
    assert not (tmp_path / "out").exists()


def write_run(folder, **changes):
    entry = {
        **{"position": 0.0, "speed": 0.0, "load": 65535, "input_volts": 7.4, "timestamp": 0.0},
        **{"goal_position": 0.1, "torque_enable": True},
    }
    entries = [{**entry, "timestamp": 0.005 * k, "position": 0.001 * k} for k in range(40)]
    facts = {"mass": 0.49, "length": 0.1, "kp": 100, "vin": 7.4, "motor": "xl330"}
    facts |= {"trajectory": "test", "entries": entries, **changes}
    path = folder / "run.json"
    path.write_text(json.dumps(facts))
    return path


def test_the_pwms_sign_is_that_of_16_bits(tmp_path):
    run = xl330.read_run(write_run(tmp_path))
    assert (run.pwm == -1).all()
    assert (run.torque < 0).all()


def test_a_file_of_another_motor_is_refused_by_its_name(tmp_path):
    for motor, said in (("mx106", "of the motor 'mx106'"), (None, "does not say which motor")):
        with pytest.raises(RecordingError, match=said):
            xl330.read_run(write_run(tmp_path, motor=motor))


def test_files_of_another_format_are_refused(tmp_path):
    for change in ({"entries": []}, {"entries": [{"position": 0.0}]}, {"mass": None}):
        with pytest.raises(RecordingError, match=r"run\.json"):
            xl330.read_run(write_run(tmp_path, **change))
    motion = tmp_path / "jog"
    motion.mkdir()
    (motion / "joint_list.txt").write_text("a\nb\n")
    (motion / "control.csv").write_text('type,timestamp,positions\nC,1.0,"[0.0, 0.0]"\n')
    (motion / "state_motor.csv").write_text(
        'type,timestamp,positions,velocities,torques\nS,1.0,"[0.0]","[0.0]","[0.0]"\n'
    )
    with pytest.raises(RecordingError, match="2 numbers"):
        list(so101.trials(str(motion)))


@pytest.mark.parametrize("data", [tiago_arm.DATA, so101.DATA, xl330.DATA], ids=lambda data: data.name)
def test_files_to_download_are_named_by_commit_and_checksum(data):
    for file, digest in data.sha256.items():
        assert data.url(file).startswith(f"https://raw.githubusercontent.com/{data.repository}/{data.commit}/")
        assert len(digest) == 64
    assert len(data.commit) == 40


def test_the_checksums_are_those_of_the_files(tmp_path):
    import hashlib

    for data, folder in ((tiago_arm.DATA, "tiago_arm"), (so101.DATA, "so101"), (xl330.DATA, "xl330_pendulum")):
        for file, digest in data.sha256.items():
            content = (real(folder) / file).read_bytes()
            assert hashlib.sha256(content).hexdigest() == digest, file


def test_download_fetches_every_file_with_its_checksum(tmp_path, monkeypatch):
    """The network is not used: what would be fetched is recorded."""
    import pooch

    asked = []
    monkeypatch.setattr(pooch, "os_cache", lambda name: tmp_path / name)
    monkeypatch.setattr(
        pooch, "retrieve", lambda url, known_hash, fname, path: asked.append((url, known_hash, path / fname))
    )
    folder = public.folder_of(so101.DATA, public.DOWNLOAD)
    assert {path for *_, path in asked} == {folder / file for file in so101.DATA.sha256}
    assert all(known.startswith("sha256:") for _, known, _ in asked)
