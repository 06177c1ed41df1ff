"""Lint: what is wrong is found, what is right raises no alarm."""

from dataclasses import replace

import numpy as np
import pytest

import tiago_mj
from tiago_mj.models import names
from tiago_mj.recordings.lint import JointRanges, check_names, inspect, refuse, usable
from tiago_mj.recordings.record import Motion, Plan, make, random_motion, record
from tiago_mj.recordings.recording import CODES, KINDS, Finding, RecordingError, channels
from tiago_mj.rollout.policies import make_policy

RIGHT, LEFT = names.FINGERS
SEEDS = 20
#: Findings about a trial on its own account are no alarms.
EXPECTED = {"single_trial"}


def recorded(identifier, policy, *, episodes, seed=0, effects=None):
    plan = Plan(f"tiago_mj/{identifier}", {}, effects, None, policy)
    return list(
        record(plan, lambda env: make_policy(policy, env, seed=seed, trust=False), episodes=episodes, seed=seed)
    )


def ranges_of(identifier):
    env = make(Plan(f"tiago_mj/{identifier}", {}, None, None, ""))
    ranges = JointRanges.of_model(env.unwrapped.model)
    env.close()
    return ranges


@pytest.fixture(scope="module")
def grasps():
    """Three grasps of the nominal gripper under the force controller."""
    return recorded("GripperTactile-v0", "pi", episodes=3)


@pytest.fixture(scope="module")
def moves():
    """Two motions of the empty gripper in which the fingers go both ways, differently."""
    trials = []
    for number in range(2):
        time = np.arange(960) / 240
        away = np.where(time < 1.0, -0.022, 0.0)  # to the middle of the range, so that no set point is clipped
        wave = {RIGHT: np.sin(2 * np.pi * (0.8 + 0.3 * number) * time), LEFT: np.sin(2 * np.pi * 1.3 * time + 2.0)}
        motion = Motion("sweep", time, {joint: away + 0.04 * sine for joint, sine in wave.items()})
        plan = Plan("tiago_mj/GripperClose-v0", {}, None, motion, "sweep")
        trials += record(plan, lambda env: None, episodes=1, seed=number)
    return trials


@pytest.fixture(scope="module")
def ranges():
    return ranges_of("GripperTactile-v0")


def changed(trials, change, only=None):
    """Trials with channels replaced: ``change`` maps names to functions of (values, trial)."""
    out = []
    for number, trial in enumerate(trials):
        fields = {attribute: dict(getattr(trial, attribute)) for attribute in KINDS.values()}
        if only is None or number in only:
            for name, function in change.items():
                kind, _, rest = name.partition(".")
                fields[KINDS[kind]][rest] = function(fields[KINDS[kind]][rest].copy(), trial)
        out.append(replace(trial, **fields))
    return out


def found(trials, ranges=None, *, refuses=None):
    """Codes and channels."""
    return {
        (finding.code, finding.channel)
        for finding in inspect(trials, ranges)
        if finding.code not in EXPECTED and refuses in (None, finding.refuses)
    }


def scaled(factor):
    return lambda values, trial: values * factor


@pytest.mark.parametrize("seeds", [2, pytest.param(SEEDS, marks=pytest.mark.slow)])
def test_clean_recordings_of_every_environment_raise_no_alarm(seeds):
    """Several seeds of every task under random actions, and of the tactile ones under the force controller."""
    quick = {"GripperTactile-v0": "pi", "TIAGoTactile-v0": None}
    skipped = {"GripperTactileGoal-v0", "TIAGoTactileGoal-v0", "GripperCloseGoal-v0"}  # the same simulation
    for identifier in tiago_mj.ENVIRONMENTS:
        if identifier in skipped:
            continue
        ranges = ranges_of(identifier)
        for policy in filter(None, ("random", quick.get(identifier))):
            half = identifier.startswith("TIAGo")  # a whole robot is slow to make and to step
            trials = recorded(identifier, policy, episodes=seeds // 2 if half else seeds)
            assert found(trials, ranges) == set(), (identifier, policy)
            for trial in trials:
                assert found([trial], ranges) == set(), (identifier, policy, trial.name)


@pytest.mark.parametrize(
    ("policy", "episodes"),
    [("pi", 1), *(pytest.param(policy, 2, marks=pytest.mark.slow) for policy in ("pi", "random"))],
)
def test_no_effect_of_the_library_at_its_default_is_taken_for_a_fault_of_the_log(policy, episodes, ranges):
    """A refusal would keep the effect from being diagnosed."""
    from tiago_mj.effects import EFFECTS

    for name in EFFECTS:
        trials = recorded("GripperTactile-v0", policy, episodes=episodes, effects={name: {}})
        refuse(trials, inspect(trials, ranges))


@pytest.mark.parametrize(
    ("channel", "factor", "code"),
    [
        (f"position.{RIGHT}", 1000.0, "unit_scale"),
        (f"velocity.{LEFT}", 1000.0, "unit_scale"),
        (f"position.{RIGHT}", 180 / np.pi, "degrees"),
    ],
)
def test_one_channel_in_another_unit_is_refused_without_any_model(grasps, channel, factor, code):
    trials = changed(grasps, {channel: scaled(factor)})
    assert (code, channel) in found(trials, refuses=True)
    with pytest.raises(RecordingError, match=channel):
        refuse(trials, inspect(trials))


def test_a_whole_recording_in_millimetres_is_refused_where_the_model_is_known(grasps, ranges):
    change = {f"{kind}.{joint}": scaled(1e3) for kind in ("position", "velocity", "command") for joint in names.FINGERS}
    trials = changed(grasps, change)
    assert ("unit_scale", f"position.{RIGHT}") in found(trials, ranges, refuses=True)
    with pytest.raises(RecordingError, match='"units"') as caught:
        refuse(trials, inspect(trials, ranges))
    assert "\n" not in str(caught.value)


def test_a_whole_arm_in_degrees_is_refused_where_the_model_is_known():
    trials = recorded("TIAGoReach-v0", "random", episodes=2)
    change = {
        f"{kind}.{joint}": scaled(180 / np.pi) for kind in ("position", "velocity", "command") for joint in names.ARM
    }
    wrong = found(changed(trials, change), ranges_of("TIAGoReach-v0"), refuses=True)
    assert {code for code, _ in wrong} == {"degrees"}
    assert any(channel.startswith("position.arm_") for _, channel in wrong)


@pytest.mark.parametrize("kind", ["position", "velocity", "command", "effort", "force"])
def test_a_flipped_sign_is_refused_and_the_flipped_channel_named(grasps, moves, kind):
    name = "force.left" if kind == "force" else f"{kind}.{LEFT}"
    trials = moves if kind == "effort" else grasps  # a finger that only closes may as well log a magnitude
    assert found(changed(trials, {name: scaled(-1.0)}), refuses=True) == {("sign", name)}


def test_an_effort_of_a_closing_finger_without_its_sign_is_left_out_of_use(grasps):
    name = f"effort.{RIGHT}"
    findings = inspect(changed(grasps, {name: lambda values, trial: np.abs(values)}))
    assert {(f.code, f.channel) for f in findings} == {("unsigned", name)}
    assert name not in usable(grasps[0], findings)


@pytest.mark.parametrize("kind", ["position", "velocity", "command", "force"])
def test_exchanged_fingers_are_refused_and_the_exchanged_columns_named(grasps, moves, kind):
    one, other = ("right", "left") if kind == "force" else (RIGHT, LEFT)
    trials = moves if kind != "force" else grasps  # random motion seldom touches
    change = {
        f"{kind}.{one}": lambda values, trial: getattr(trial, KINDS[kind])[other],
        f"{kind}.{other}": lambda values, trial: getattr(trial, KINDS[kind])[one],
    }
    wrong = found(changed(trials, change), refuses=True)
    assert wrong == {("swapped_channels", f"{kind}.{one}")}


def test_an_effort_without_sign_is_left_out_of_use(moves):
    name = f"effort.{RIGHT}"
    trials = changed(moves, {name: lambda values, trial: np.abs(values)})
    findings = inspect(trials)
    assert ("unsigned", name) in {(f.code, f.channel) for f in findings}
    refuse(trials, findings)
    assert usable(trials[0], findings) == set(channels(trials[0])) - {name}


@pytest.mark.parametrize(
    "name",
    ["force.right", f"position.{RIGHT}", f"velocity.{LEFT}", f"effort.{LEFT}"],
    ids=lambda name: name.split(".")[0],
)
def test_a_dead_channel_is_left_out_of_use(grasps, name):
    trials = changed(grasps, {name: lambda values, trial: np.full_like(values, 0.0)}, only=[1])
    findings = inspect(trials)
    assert ("dead_channel", name, trials[1].source) in {(f.code, f.channel, f.file) for f in findings}
    assert name not in usable(trials[1], findings)
    assert name in usable(trials[0], findings)


def test_a_recording_in_which_everything_is_constant_is_refused(grasps):
    constant = {name: lambda values, trial: np.full_like(values, 0.02) for name in channels(grasps[0])}
    trials = changed(grasps[:1], constant)
    with pytest.raises(RecordingError, match="no usable channel"):
        refuse(trials, inspect(trials))


@pytest.mark.parametrize(("name", "begin"), [("force.right", 60), (f"position.{LEFT}", 20), (f"velocity.{LEFT}", 50)])
def test_a_channel_that_freezes_is_found_with_its_times(grasps, name, begin):
    def freeze(values, trial):
        values[begin : begin + 60] = values[begin]
        return values

    findings = inspect(changed(grasps, {name: freeze}, only=[2]))
    stuck = [finding for finding in findings if finding.code == "stuck"]
    assert [(f.channel, f.file) for f in stuck] == [(name, grasps[2].source)]
    assert f"from {begin / 240:.4g}" in stuck[0].message


@pytest.mark.parametrize(("name", "step"), [(f"position.{RIGHT}", 2e-4), ("force.left", 0.02)])
def test_a_quantum_is_found_and_its_step_named(grasps, name, step):
    trials = changed(grasps, {name: lambda values, trial: np.round(values / step) * step})
    found_here = [f for f in inspect(trials) if f.code == "quantum"]
    assert {f.channel for f in found_here} == {name}
    assert all(f"steps of {step:.4g}" in f.message for f in found_here)
    assert name in usable(trials[0], found_here)


def test_a_plateau_is_found(grasps):
    trials = changed(grasps, {"force.right": lambda values, trial: np.minimum(values, 0.8)})
    assert ("saturation", "force.right") in found(trials)


def test_jitter_and_gaps_of_the_clock_are_said(grasps):
    rng = np.random.default_rng(0)
    trial = grasps[0]
    jittery = replace(trial, time=trial.time + np.append(0.0, rng.uniform(-1e-3, 1e-3, len(trial.time) - 1)))
    assert ("clock_jitter", "time") in found([jittery])
    late = trial.time.copy()
    late[100:] += 0.2
    (gap,) = [f for f in inspect([replace(trial, time=late)]) if f.code == "time_gap"]
    assert f"{late[99]:.4g} s" in gap.message


def test_streams_of_different_rates_are_judged_each_on_its_own(grasps):
    def every(step, first):
        def thin(values, trial):
            out = np.full_like(values, np.nan)
            out[first::step] = values[first::step]
            return out

        return thin

    change = {name: every(2, 0) for name in channels(grasps[0], kinds=("position", "velocity", "effort"))}
    change |= {name: every(8, 4) for name in channels(grasps[0], kinds=("command",))}
    assert found(sidecar(changed(grasps, change), rate_hz=30.0)) == set()


def sidecar(trials, **changes):
    return [replace(trial, sidecar=replace(trial.sidecar, **changes)) for trial in trials]


def test_sidecars_that_contradict_their_columns_are_found(grasps):
    assert ("contradiction", "time") in found(sidecar(grasps, rate_hz=100.0), refuses=True)
    assert ("contradiction", "time") in found(sidecar(grasps, rate_hz=280.0), refuses=False)
    away = sidecar(grasps, initial={"position": {RIGHT: 0.03}})
    assert ("contradiction", f"position.{RIGHT}") in found(away, refuses=False)
    assert f"position.{RIGHT}" in usable(away[0], inspect(away))
    millimetres = sidecar(grasps, initial={"position": {RIGHT: 45.0}})
    assert ("unit_scale", f"position.{RIGHT}") in found(millimetres, refuses=True)
    assert ("contradiction", "") in found(sidecar(grasps, initial={"position": {"elbow": 0.0}}), refuses=False)


def test_a_sidecar_with_the_wrong_interface_is_refused():
    motion = random_motion({RIGHT: 0.01}, {RIGHT: 0.04}, seconds=4.0, rate_hz=240, seed=1)
    plan = Plan("tiago_mj/GripperClose-v0", {"control": "position"}, None, motion, "sweep")
    trials = list(record(plan, lambda env: None, episodes=1, seed=0))
    assert found(trials) == set()
    wrong = found(sidecar(trials, interface="velocity"), refuses=True)
    assert ("contradiction", f"command.{RIGHT}") in wrong


def test_a_velocity_that_is_no_derivative_is_left_out_of_use(moves):
    trials = changed(moves, {f"velocity.{LEFT}": lambda values, trial: values[::-1]})
    findings = inspect(trials)
    assert ("contradiction", f"velocity.{LEFT}") in {(f.code, f.channel) for f in findings}
    assert f"velocity.{LEFT}" not in usable(trials[0], findings)


def test_a_late_velocity_is_said_and_used():
    trials = recorded("TIAGoReach-v0", "random", episodes=1)
    joint = "arm_1_joint"
    time = np.arange(0, 10, 0.01)
    swing = replace(
        trials[0],
        time=time,
        commands={},
        positions={joint: np.sin(2 * time)},
        velocities={joint: 2 * np.cos(2 * (time - 0.15))},
        efforts={},
        sidecar=replace(trials[0].sidecar, rate_hz=100.0, interface=None, initial=None),
    )
    findings = inspect([swing])
    (late,) = [f for f in findings if f.code == "contradiction"]
    assert "0.15 s" in late.message
    assert late.channel in usable(swing, findings)


def test_a_damped_servo_that_lags_against_its_effort_has_no_flipped_sign():
    """A servo of 2000 N·m/rad and 400 N·m·s/rad lags by a fifth of a second, whatever its effort is; a load that drives
    the joint makes its effort point against the motion, and so against the lag."""
    trial = recorded("TIAGoReach-v0", "random", episodes=1)[0]
    joint, time = "arm_1_joint", np.arange(0, 10, 0.01)
    position, speed = np.sin(time), np.cos(time)
    effort = -60 * speed + 15 * np.sin(3 * time)
    command = position + (effort + 400 * speed) / 2000
    sidecar = replace(trial.sidecar, rate_hz=100.0, interface="position", initial=None)

    measured = {"positions": {joint: position}, "velocities": {}, "efforts": {joint: effort}}
    swing = replace(trial, time=time, commands={joint: command}, sidecar=sidecar, **measured)
    assert np.corrcoef(command - position, effort)[0, 1] < -0.9
    assert not [found for found in inspect([swing]) if found.code == "sign"]


def test_a_velocity_behind_a_slow_filter_is_used_as_what_it_is_and_a_reversed_one_is_refused():
    (trial,) = recorded("TIAGoReach-v0", "random", episodes=1)
    joint, time = "arm_1_joint", np.arange(0, 10, 0.01)
    frequency, slow = 6.0, 0.3  # by 61 degrees late, and 0.49 times as large
    turn, gain = np.arctan(frequency * slow), 1 / np.hypot(1, frequency * slow)

    def swing(velocity):
        sidecar = replace(trial.sidecar, rate_hz=100.0, interface=None, initial=None)
        positions = {joint: np.sin(frequency * time)}
        return replace(
            trial,
            time=time,
            commands={},
            positions=positions,
            velocities={joint: velocity},
            efforts={},
            sidecar=sidecar,
        )

    late = swing(frequency * gain * np.cos(frequency * time - turn))
    (said,) = [f for f in inspect([late]) if f.channel == f"velocity.{joint}"]
    assert said.code == "contradiction"
    assert not said.discredits
    assert f"velocity.{joint}" in usable(late, inspect([late]))
    reversed_sign = swing(-frequency * np.cos(frequency * time))
    assert any(f.code == "sign" and f.refuses for f in inspect([reversed_sign]))


def test_a_filter_that_leaves_little_of_one_trial_is_the_same_one_in_all():
    trials = recorded("TIAGoReach-v0", "random", episodes=1)
    joint, time = "arm_1_joint", np.arange(0, 10, 0.01)

    def swing(frequency, late):
        velocity = 2 * np.cos(frequency * (time - late))
        sidecar = replace(trials[0].sidecar, rate_hz=100.0, interface=None, initial=None)
        return replace(
            trials[0],
            time=time,
            commands={},
            positions={joint: np.sin(frequency * time) * 2 / frequency},
            velocities={joint: velocity},
            efforts={},
            sidecar=sidecar,
            source=f"{frequency}.parquet",
        )

    slow, slower, fast = swing(2, 0.15), swing(2.2, 0.15), swing(11, 0.15)  # a quarter of a turn late, where it is fast
    channel = f"velocity.{joint}"
    assert channel not in usable(fast, inspect([fast]))
    findings = inspect([slow, slower, fast])
    assert all(channel in usable(trial, findings) for trial in (slow, slower, fast))


def test_one_recording_alone_is_said_and_how_far_the_gap_closes_is_left_to_the_verdict(grasps):
    (found,) = inspect(grasps[:1])
    assert found.code == "single_trial"
    assert "closed" not in found.message, "it may be cut into parts, some of which are kept aside"
    assert inspect(grasps) == ()


def test_names_that_the_model_lacks_are_refused(grasps):
    assert not list(check_names(grasps, names.FINGERS, names.FINGERS, names.SIDES))
    line = r"column position\.gripper_right_finger_joint: the model has no joint"
    with pytest.raises(RecordingError, match=line):
        refuse(grasps, list(check_names(grasps, ["wrist"], names.FINGERS, names.SIDES)))
    with pytest.raises(RecordingError, match="no actuator"):
        refuse(grasps, list(check_names(grasps, names.FINGERS, ["motor"], names.SIDES)))


def test_refusing_findings_come_first_and_are_counted(grasps):
    trials = changed(grasps, {f"position.{RIGHT}": scaled(1e3), f"velocity.{LEFT}": scaled(1e3)})
    findings = inspect(trials)
    assert findings[0].refuses
    with pytest.raises(RecordingError, match="more such findings"):
        refuse(trials, findings)


def test_a_finding_has_one_of_the_codes():
    with pytest.raises(ValueError, match="gremlins"):
        Finding("gremlins", "a.csv", "", "")
    assert len(set(CODES)) == 19
