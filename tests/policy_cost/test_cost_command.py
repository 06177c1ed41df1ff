"""``tiago-mj cost``: what it prints and refuses; logged rollouts, diagnosed and costed as they are."""

import json

import numpy as np
import pytest
from toy import Toy, knows

from tiago_mj import cli
from tiago_mj.gap.result import Explanation, FittedNumber, Named, Result, Shrink, Value, Verdict
from tiago_mj.policy_cost import cost, rollouts
from tiago_mj.policy_cost.doubts import others_of, sentences
from tiago_mj.policy_cost.magnitudes import NUMBERS, items_of
from tiago_mj.policy_cost.report import text
from tiago_mj.recordings.read import read_recordings
from tiago_mj.rollout import policies

ENV = "GripperTactile-v0"
EFFECTS = '{"force_bias": {"offset": 0.1}, "object_mass": {"factor": 1.05}}'
CALIBRATION = """\
schema: tiago_mj.calibration/1
robot: GripperTactile-v0
effects:
- {name: force_bias, target: all, parameters: {offset: {value: 0.1, low: 0.09, high: 0.11, unit: sensor units}}}
- {name: object_mass, target: all, parameters: {factor: {value: 1.05}}}
"""


@pytest.fixture
def diagnosis(tmp_path):
    folder = tmp_path / "diagnosis"
    folder.mkdir()
    (folder / "calibration.yaml").write_text(CALIBRATION)
    return folder


def costed(capsys, *words):
    assert cli.main(["cost", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def complaint(capsys, *words):
    status = cli.main(["cost", *map(str, words)])
    said = capsys.readouterr()
    assert status == 2
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


def test_a_biased_reading_costs_the_force_controller_and_a_heavier_object_hardly_does(diagnosis, capsys):
    words = (diagnosis, "--policy", "pi", "--episodes", "3", "--draws", "2")
    data = costed(capsys, *words)
    assert data["env"] == f"tiago_mj/{ENV}"
    assert (data["episodes"], data["draws"]) == (3, 2)
    assert data["mend_first"] == "force_bias"
    by_name = {row["name"]: row["mended"]["episode_return"] for row in data["effects"]}
    assert by_name["force_bias"]["low"] > 10
    assert abs(by_name["object_mass"]["mean"]) < 1
    assert cli.main(["cost", *map(str, words)]) == 0
    said = capsys.readouterr().out
    assert data["answer"] in said
    assert "force_bias: 0.1 sensor units (0.09 sensor units to 0.11 sensor units)" in said
    assert "To mend an effect is to take it from the robot" in said


def test_many_processes_say_what_one_says(diagnosis, capsys):
    words = (diagnosis, "--policy", "random", "--episodes", "2", "--draws", "2")
    assert costed(capsys, *words) == costed(capsys, *words, "--jobs", "2")


def test_what_lies_here_does_not_change_whom_a_name_means(diagnosis, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("pi", "ppo-steady", "mine.zip"):
        (tmp_path / name).mkdir()
    assert [policies.absolute(name) for name in ("pi", "ppo-steady", "none")] == ["pi", "ppo-steady", "none"]
    assert policies.absolute("mine.zip") == str(tmp_path / "mine.zip")
    assert cli.main(["cost", str(diagnosis), "--policy", "pi", "--episodes", "1", "--draws", "1", "--json"]) == 0
    assert cli.main(["rollout", "--env", "GripperTactileSteady-v0", "--policy", "ppo-steady", "--json"]) == 0


def test_a_function_of_a_module_acts_where_it_is_trusted(diagnosis, tmp_path, monkeypatch, capsys):
    (tmp_path / "my_policy.py").write_text("import numpy as np\n\ndef close(observation):\n    return -np.ones(2)\n")
    monkeypatch.chdir(tmp_path)
    words = (diagnosis, "--policy", "my_policy:close", "--episodes", "2", "--draws", "1")
    assert "--trust" in complaint(capsys, *words)
    data = costed(capsys, *words, "--trust")
    assert data["policy"] == "my_policy:close"
    assert "MODULE:FUNCTION" in complaint(capsys, diagnosis, "--policy", "my_policy:open", "--trust")


def test_the_log_of_a_rollout_is_a_recording_whose_actions_are_replayed(diagnosis, tmp_path, capsys):
    logs = tmp_path / "logs"
    words = ["rollout", "--env", ENV, "--policy", "pi", "--episodes", "2", "--record", str(logs)]
    assert cli.main([*words, "--env-option", f"effects={EFFECTS}"]) == 0
    said = capsys.readouterr().out
    assert f"recordings: {logs}" in said
    played = [float(line.split()[2]) for line in said.splitlines()[2:4]]
    trials = read_recordings([logs]).trials
    assert [trial.name for trial in trials] == ["pi-000", "pi-001"]
    assert all(np.isfinite(next(iter(trial.commands.values()))[:-1]).all() for trial in trials)
    assert "effects" not in trials[0].sidecar.raw["arguments"]
    data = costed(capsys, diagnosis, "--rollouts", logs, "--draws", "1")
    assert data["policy"] is None
    assert data["episodes"] == 2
    assert data["notes"][0].startswith("Open loop")
    # The same actions, effects, object and noise: the return that was played, but for the drawn magnitude.
    assert data["repaired"]["episode_return"]["mean"] == pytest.approx(np.mean(played), rel=0.02)
    assert data["measured_return"] == pytest.approx(np.mean(played), abs=0.01)
    assert data["notes"][-1].startswith("Measured return of the rollouts: −")
    closed = costed(capsys, diagnosis, "--rollouts", logs, "--policy", "pi", "--draws", "1")
    assert closed["repaired"]["episode_return"]["mean"] == pytest.approx(np.mean(played), rel=0.02)
    assert closed["notes"][0].startswith("To mend an effect")


def test_a_reward_of_what_nobody_measured_has_no_measured_return(tmp_path):
    """The steady task rewards a still object, whose speed no recording has."""
    words = ["record", "--env", "GripperTactileSteady-v0", "--policy", "pi", "--out", str(tmp_path / "logs")]
    assert cli.main(words) == 0
    logged = rollouts.read([tmp_path / "logs"], None)
    assert logged.measured == [None]
    (played,) = rollouts.simulate(logged, (), None)
    assert played.success == 1


def test_recording_writes_what_record_writes(tmp_path, capsys):
    assert cli.main(["rollout", "--env", ENV, "--policy", "pi", "--record", str(tmp_path / "one")]) == 0
    assert cli.main(["record", "--env", ENV, "--policy", "pi", "--out", str(tmp_path / "two")]) == 0
    for name in ("pi-000.parquet", "pi-000.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    words = ["rollout", "--env", ENV, "--policy", "pi", "--record", str(tmp_path / "three"), "--jobs", "2"]
    assert cli.main(words) == 2
    assert not (tmp_path / "three").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "give --policy, or --rollouts"),
        (["--policy", "nobody"], "is unknown"),
        (["--policy", "pi", "--env", "Nowhere-v0"], "environment 'Nowhere-v0' is unknown"),
        (["--policy", "pi", "--episodes", "0"], "--episodes is 0"),
        (["--policy", "pi", "--draws", "0"], "--draws is 0"),
        (["--policy", "pi", "--env-option", "goal=99"], "goal"),
        (["--rollouts", "nowhere"], "nowhere"),
        (["--rollouts", "nowhere", "--env-option", "goal=1"], "leave one out"),
    ],
)
def test_what_cannot_be_used_is_one_line(diagnosis, capsys, words, said):
    assert said in complaint(capsys, diagnosis, *words)


def test_a_diagnosis_of_a_model_needs_an_environment_of_ones_own(diagnosis, capsys):
    file = diagnosis / "calibration.yaml"
    file.write_text(CALIBRATION.replace("GripperTactile-v0", "arm.xml"))
    assert "tiago_mj.policy_cost.cost" in complaint(capsys, diagnosis, "--policy", "pi")
    file.write_text(CALIBRATION.replace("robot: GripperTactile-v0\n", ""))
    assert "give --env" in complaint(capsys, diagnosis, "--policy", "pi")
    assert "no diagnosis at" in complaint(capsys, diagnosis / "elsewhere", "--policy", "pi")


def test_rollouts_of_a_plain_model_have_no_return(diagnosis, tmp_path, capsys):
    model = tmp_path / "arm.xml"
    model.write_text(
        '<mujoco><worldbody><body><joint name="j" armature=".1"/><geom size=".1"/></body></worldbody>'
        '<actuator><position name="j" joint="j" kp="20" kv="1" ctrlrange="-1 1"/></actuator></mujoco>'
    )
    logs = tmp_path / "logs"
    assert cli.main(["record", "--model", str(model), "--policy", "random", "--out", str(logs)]) == 0
    capsys.readouterr()
    assert "needs the reward of an environment" in complaint(capsys, diagnosis, "--rollouts", logs)


def test_rollouts_that_say_no_goal_are_one_line_that_names_no_option(diagnosis, tmp_path, capsys):
    assert cli.main(["record", "--env", ENV, "--policy", "pi", "--out", str(tmp_path / "logs")]) == 0
    sidecar = tmp_path / "logs" / "pi-000.json"
    said = json.loads(sidecar.read_text())
    del said["goal"]
    sidecar.write_text(json.dumps(said))
    capsys.readouterr()
    assert "pi-000.parquet: a return needs the goal" in complaint(capsys, diagnosis, "--rollouts", tmp_path / "logs")


def test_other_explanations_are_costed_with_what_was_known_before_and_doubts_are_said():
    value = {"seconds": Value(0.02, 0.018, 0.022, "s")}
    best, other = Named("command_delay", "all", value), Named("clock_offset", "all", value)
    number = FittedNumber("object_mass", "all", "factor", 1.1, 1.0, 1.2, "-", 1.0)
    result = Result(
        verdict=Verdict("ambiguous", (best,), 0.5, (Explanation((best,), 0.5), Explanation((other,), 0.4)), part=True),
        where=(),
        stage=None,
        shrink=Shrink(None, None, 1.0, None, None, None),
        ranking=(),
        numbers=(number,),
        findings=(),
        next_motion=None,
        splits={},
        complete=False,
        seed=0,
        version="",
        seconds=0.0,
    )
    assert [item.label for item in items_of(result)] == ["command_delay", NUMBERS]
    items = (*items_of(result), *items_of([{"name": "payload", "parameters": {"mass": 0.1}}]))
    (instead,) = others_of(result, items)
    assert [item.label for item in instead] == ["clock_offset", "payload"]
    assert [said.split()[0] for said in sentences(result)] == ["The", "A"]
    assert others_of(None, items) == ()
    assert sentences(None) == []
    found = cost(Toy, knows, result, episodes=2, draws=2)
    assert [one.label for one in found.others] == ["clock_offset"]
    assert "cannot tell this from clock_offset" in text(found, "", [])
