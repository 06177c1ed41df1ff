"""``tiago-mj record``: what it writes is what a robot's logger would have seen."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401  (registers the environments)
from tiago_mj.cli import main
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.models import names
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.record import ModelPlan, Plan, make, random_motion, read_motion, record, record_model
from tiago_mj.recordings.recording import RecordingError, Sidecar, Trial, channels
from tiago_mj.rollout.policies import make_policy

RIGHT, LEFT = names.FINGERS
PENDULUM = """<mujoco><option timestep="0.002"/><worldbody><body><joint name="hinge" axis="0 1 0" range="-90 90"
 damping="0.01"/><geom type="capsule" fromto="0 0 0 0 0 -.1" size=".01" mass=".2"/></body></worldbody>
 <actuator><{kind} name="motor" joint="hinge" {gains}/></actuator></mujoco>"""


def recorded(identifier="tiago_mj/GripperTactile-v0", *, policy="pi", seed=3, episodes=1, effects=None, **arguments):
    plan = Plan(identifier, arguments, effects, None, policy)
    return list(
        record(plan, lambda env: make_policy(policy, env, seed=seed, trust=False), episodes=episodes, seed=seed)
    )


def test_row_k_is_the_observation_and_the_command_that_was_sent_upon_it():
    (trial,) = recorded(policy="random")
    env = gymnasium.make("tiago_mj/GripperTactileGoal-v0")
    observation, _ = env.reset(seed=3)
    for k in range(300):
        np.testing.assert_array_equal(trial.positions[RIGHT][k], observation["observation"][0])
        np.testing.assert_array_equal(trial.velocities[LEFT][k], observation["observation"][3])
        np.testing.assert_array_equal(trial.forces["left"][k], observation["observation"][5])
        command = np.array([trial.commands[RIGHT][k], trial.commands[LEFT][k]])
        observation, *_ = env.step(command / env.unwrapped.velocity_limit)
    np.testing.assert_array_equal(trial.positions[RIGHT][300], observation["observation"][0])
    assert np.isnan(trial.commands[RIGHT][300])
    np.testing.assert_allclose(np.diff(trial.time), 1 / 240, rtol=1e-9)


def test_the_sidecar_says_what_a_replay_needs():
    (trial,) = recorded(object_offset=0.003, sensing="released", goal=0.05)
    facts = trial.sidecar
    assert (facts.robot, facts.interface) == ("tiago_mj/GripperTactile-v0", "velocity")
    assert facts.rate_hz == pytest.approx(240)
    assert facts.servo["name"] == "pal"
    assert facts.servo["stiffness"] == {RIGHT: 2000.0, LEFT: 2000.0}
    assert facts.sensing["scale"] == 0.01
    assert facts.object["radius_m"] == 0.02
    assert facts.object["offset_m"] == 0.003
    assert facts.initial["position"] == {RIGHT: trial.positions[RIGHT][0], LEFT: trial.positions[LEFT][0]}
    assert facts.initial["set_point"] == {RIGHT: 0.045, LEFT: 0.045}
    assert facts.goal == [0.05, 0.05]
    assert facts.source["seed"] == 3


def test_a_recording_does_not_reveal_the_effects_that_made_it():
    effects = [
        {"name": "servo_stiffness", "parameters": {"factor": 0.5}},
        {"name": "object_size", "parameters": {"radius": 0.002}},
        {"name": "object_offset", "parameters": {"distance": 0.004}},
        {"name": "force_limit", "parameters": {"limit": 7.0}},
        {"name": "force_noise", "parameters": {"factor": 2.0}},
    ]
    (real,) = recorded(effects=effects)
    (nominal,) = recorded()
    assert real.sidecar == nominal.sidecar
    assert not np.array_equal(real.forces["right"], nominal.forces["right"])


def test_positions_are_the_measured_ones():
    (biased,) = recorded(effects={"encoder_bias": {"offset": 0.001}}, policy="random")
    (nominal,) = recorded(policy="random")
    np.testing.assert_allclose(biased.positions[RIGHT] - nominal.positions[RIGHT], 0.001, atol=1e-12)
    assert biased.sidecar.initial["position"][RIGHT] == pytest.approx(0.046)


def test_the_command_writes_one_file_and_sidecar_per_episode_and_the_same_seed_the_same_bytes(tmp_path, capsys):
    call = ["record", "--env", "GripperTactile-v0", "--policy", "pi", "--episodes", "3", "--seed", "5", "--out"]
    for folder in ("a", "b"):
        assert main([*call, str(tmp_path / folder)]) == 0
    assert "3 recordings" in capsys.readouterr().out
    written = sorted(path.name for path in (tmp_path / "a").iterdir())
    stems = ("pi-005", "pi-006", "pi-007")
    assert written == sorted(f"{stem}.{end}" for stem in stems for end in ("json", "parquet"))
    for name in written:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    result = read_recordings([tmp_path / "a"])
    assert [trial.name for trial in result.trials] == list(stems)
    assert not result.findings


@pytest.mark.parametrize("end", ["csv", "yaml"])
def test_a_motion_is_played_with_every_command_held_until_the_next(tmp_path, end):
    path = tmp_path / f"close.{end}"
    if end == "csv":
        path.write_text(f"time,command.{RIGHT}\n5.0,-0.02\n5.1,0.01\n5.25,0.0\n")
    else:
        path.write_text(
            f"interface: velocity\nrate_hz: 100\ntime: [0, 0.1, 0.25]\ncommand.{RIGHT}: [-0.02, 0.01, 0.0]\n"
        )
    out = tmp_path / "out"
    assert main(["record", "--env", "GripperClose-v0", "--motion", str(path), "--out", str(out)]) == 0
    (trial,) = read_recordings([out]).trials
    rate = 240 if end == "csv" else 100
    assert trial.sidecar.rate_hz == pytest.approx(rate)
    assert len(trial.time) == round(0.25 * rate) + 2
    sent = trial.commands[RIGHT]
    first, second = round(0.1 * rate), round(0.25 * rate)
    np.testing.assert_array_equal(sent[:first], -0.02)
    np.testing.assert_array_equal(sent[first:second], 0.01)
    np.testing.assert_array_equal(sent[second:-1], 0.0)
    np.testing.assert_array_equal(trial.commands[LEFT][:-1], 0.0)


def test_a_motion_longer_than_the_tasks_time_limit_is_played_to_its_end(tmp_path):
    motion = random_motion({RIGHT: -0.02}, {RIGHT: 0.02}, seconds=3.0, rate_hz=240, seed=1)
    (trial,) = record(Plan("tiago_mj/GripperClose-v0", {}, None, motion, "long"), lambda env: None, episodes=1, seed=0)
    assert trial.time[-1] == pytest.approx(3.0)
    np.testing.assert_allclose(trial.commands[RIGHT][:-1], motion.commands[RIGHT], rtol=0, atol=1e-15)


def test_a_position_motion_commands_positions(tmp_path):
    path = tmp_path / "steps.yaml"
    path.write_text(f"interface: position\ntime: [0, 0.5]\ncommand.{RIGHT}: [0.045, 0.03]\n")
    out = tmp_path / "out"
    assert main(["record", "--env", "GripperClose-v0", "--motion", str(path), "--out", str(out)]) == 0
    (trial,) = read_recordings([out]).trials
    assert trial.sidecar.interface == "position"
    assert trial.commands[RIGHT][0] == pytest.approx(0.045)
    assert trial.commands[RIGHT][-2] == pytest.approx(0.03)
    np.testing.assert_allclose(trial.commands[LEFT][:-1], 0.045, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "gains", "interface"),
    [
        ("position", 'kp="5" ctrlrange="-1 1"', "position"),
        ("motor", 'ctrlrange="-0.2 0.2"', "effort"),
        ("intvelocity", 'kp="5" actrange="-1 1" ctrlrange="-1 1"', "velocity"),
    ],
)
def test_any_mjcf_is_recorded_by_the_names_of_its_parts(tmp_path, kind, gains, interface):
    model = tmp_path / "arm.xml"
    model.write_text(PENDULUM.format(kind=kind, gains=gains))
    out = tmp_path / "out"
    call = ["record", "--model", str(model), "--policy", "random", "--episodes", "2", "--out", str(out)]
    assert main(call) == 0
    trials = read_recordings([out]).trials
    assert [trial.sidecar.interface for trial in trials] == [interface] * 2
    assert list(channels(trials[0])) == ["position.hinge", "velocity.hinge", "effort.hinge"]
    assert trials[0].sidecar.robot == str(model)
    assert np.ptp(trials[0].positions["hinge"]) > 0.01
    assert not np.array_equal(trials[0].commands["motor"], trials[1].commands["motor"])


def test_a_plain_model_takes_effects_too(tmp_path):
    model = tmp_path / "arm.xml"
    model.write_text(PENDULUM.format(kind="position", gains='kp="5" ctrlrange="-1 1"'))
    nominal_plan = ModelPlan(model, None, "x", rate_hz=100.0)
    (nominal,) = record_model(nominal_plan, episodes=1, seed=0)
    plan = replace(nominal_plan, effects={"viscous_friction": {"damping": 0.5}})
    (real,) = record_model(plan, episodes=1, seed=0)
    behind = nominal.positions["hinge"] - real.positions["hinge"]
    speed = real.velocities["hinge"]
    # A servo of 5 N·m/rad lags by damping / stiffness = 0.1 s more; the speed is not quite the one of 0.1 s ago.
    assert behind @ speed / (speed @ speed) == pytest.approx(0.1, rel=0.2)
    assert real.sidecar == nominal.sidecar


def test_what_a_calibration_says_and_more_are_recorded_one_on_top_of_the_other(tmp_path):
    model = tmp_path / "arm.xml"
    model.write_text(PENDULUM.format(kind="position", gains='kp="5" ctrlrange="-1 1"'))
    known = tmp_path / "calibration.yaml"
    known.write_text(
        "schema: tiago_mj.calibration/1\neffects:\n- name: viscous_friction\n  target: hinge\n"
        "  parameters: {damping: {value: 0.2, low: 0.1, high: 0.3, unit: N}}\n"
    )
    command = ["record", "--model", str(model), "--policy", "random"]
    both = ["--effects", str(known), "--effects", '{"viscous_friction": {"damping": 0.3}}']
    assert main([*command, *both, "--out", str(tmp_path / "both")]) == 0
    assert main([*command, "--effects", '{"viscous_friction": {"damping": 0.5}}', "--out", str(tmp_path / "one")]) == 0
    two, one = (read_recordings([tmp_path / name]).trials[0] for name in ("both", "one"))
    np.testing.assert_allclose(two.positions["hinge"], one.positions["hinge"], atol=1e-12)


def line_of(capsys, *call):
    with_out = [*call] if "--out" in call else [*call, "--out", "nowhere"]
    try:
        status = main(with_out)
    except SystemExit as leaving:
        status = leaving.code
    error = capsys.readouterr().err
    assert status == 2
    assert error.count("\n") == 1
    return error


def test_unusable_arguments_end_in_one_line(tmp_path, capsys):
    wild = tmp_path / "wild.csv"
    wild.write_text(f"time,command.{RIGHT}\n0,0.0\n1,0.5\n")
    strange = tmp_path / "strange.csv"
    strange.write_text("time,command.tail\n0,0.0\n1,0.5\n")
    unsorted = tmp_path / "unsorted.yaml"
    unsorted.write_text(f"time: [0, 0]\ncommand.{RIGHT}: [0, 0]\n")
    passive = tmp_path / "passive.xml"
    passive.write_text("<mujoco><worldbody><body><joint name='j'/><geom size='.1'/></body></worldbody></mujoco>")
    gripper = ["record", "--env", "GripperTactile-v0"]
    for call, said in [
        ([*gripper, "--motion", str(wild)], "limits are -0.08 and 0.08"),
        ([*gripper, "--motion", str(strange)], "'tail'"),
        ([*gripper, "--motion", str(unsorted)], "increase"),
        ([*gripper, "--motion", str(tmp_path / "none.csv")], "no such file"),
        ([*gripper, "--policy", "pi", "--effects", "{broken"], "JSON"),
        ([*gripper, "--policy", "pi", "--effects", "nofile.yaml"], "nofile.yaml"),
        ([*gripper, "--policy", "pi", "--effects", '{"gremlins": {}}'], "gremlins"),
        ([*gripper, "--policy", "pi", "--episodes", "0"], "--episodes"),
        ([*gripper, "--policy", "wing-it"], "wing-it"),
        ([*gripper, "--policy", "pi", "--arguments", '{"effects": {}}'], "--effects"),
        (["record", "--env", "NoSuch-v0", "--policy", "pi"], "NoSuch-v0"),
        (["record", "--model", str(tmp_path / "no.xml"), "--policy", "random"], "no such file"),
        (["record", "--model", str(passive), "--policy", "random"], "no actuator"),
        (["record", "--model", str(passive), "--policy", "pi"], "needs an environment"),
        (["record", "--policy", "pi"], "--env"),
    ]:
        assert said in line_of(capsys, *call)


def test_motion_files_say_when_they_are_for_another_interface(tmp_path):
    path = tmp_path / "steps.yaml"
    path.write_text(f"interface: position\ntime: [0, 0.5]\ncommand.{RIGHT}: [0.045, 0.03]\n")
    plan = Plan("tiago_mj/GripperClose-v0", {"control": "velocity"}, None, read_motion(path), "x")
    with pytest.raises(ValueError, match="commands a position"):
        next(record(plan, lambda env: None, episodes=1, seed=0))
    make(plan).close()


def test_the_sidecar_is_plain_json(tmp_path):
    call = ["record", "--env", "TIAGoPushTactile-v0", "--policy", "random", "--out", str(tmp_path)]
    assert main(call) == 0

    def no_constant(name):
        raise AssertionError(name)

    facts = json.loads((tmp_path / "random-000.json").read_text(), parse_constant=no_constant)
    assert facts["schema"] == "tiago_mj.recording/1"
    assert len(facts["object"]["position_m"]) == 2


@pytest.mark.parametrize("name", ["arm.urdf", "arm.xml"])
def test_a_urdf_as_a_model_says_that_it_is_to_be_converted_first(name, tmp_path, capsys):
    (tmp_path / name).write_text('<?xml version="1.0"?>\n<robot name="arm"><link name="base"/></robot>')
    words = ["--model", str(tmp_path / name)]
    assert main(["record", *words, "--policy", "random", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "is a URDF, not MJCF: give arm." in said
    assert f"by: tiago-mj convert {tmp_path / name} --out arm." in said
    assert said.count("\n") == 1
    trial = Trial("a", np.zeros(1), {}, {}, {}, {}, {}, Sidecar(), "a.csv")
    with pytest.raises(RecordingError, match=r"is a URDF, not MJCF: .* by: tiago-mj convert"):
        plant_of([trial], model=tmp_path / name)


def test_a_model_that_diverges_is_not_recorded(tmp_path, capsys):
    model = tmp_path / "stiff.xml"
    model.write_text(PENDULUM.format(kind="position", gains='kp="1e6" ctrlrange="-1 1"'))
    assert main(["record", "--model", str(model), "--policy", "random", "--out", str(tmp_path / "out")]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert "stiff.xml diverges after 0.02 s" in last
    assert "nothing is recorded" in last
    assert not (tmp_path / "out").exists()


class Blown(gymnasium.Wrapper):
    """Bursts after the first step."""

    def step(self, action):
        self.unwrapped.data.qvel[0] = 1e12
        return self.env.step(action)


def test_an_environment_that_diverges_is_not_recorded():
    plan = Plan("tiago_mj/GripperTactile-v0", {}, None, None, "random")
    episodes = record(
        plan, lambda env: make_policy("random", env, seed=3, trust=False), episodes=1, seed=3, through=Blown
    )
    with pytest.raises(ValueError, match="diverges in the episode of seed 3"):
        list(episodes)
