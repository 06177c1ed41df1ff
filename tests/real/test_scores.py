"""Grades of made-up answers, a submission's complaints, and a run that goes on where it stopped."""

import json

import pytest

from benchmarks.real import __main__ as command
from benchmarks.real import run, submit
from benchmarks.real.cases import CASES
from benchmarks.real.score import HALF, RIGHT, SILENT, WRONG, Answer, Named, judge, of_diagnosis, summary
from tiago_mj.effects import EFFECTS

EMPS = CASES["emps-efforts-friction"]
ARM = CASES["ur10e-gain"]
NOTHING = CASES["emps-efforts-nothing"]


def named(**values):
    return tuple(Named.of(name.replace("__", "@"), value) for name, value in values.items())


def grade(case, kind="effect", remains=False, alternatives=(), **values):
    return judge(case, Answer(kind, named(**values), alternatives, remains)).grade


def test_both_causes_with_their_values_are_right():
    assert grade(EMPS, coulomb_friction=20.0, viscous_friction=210.0) == RIGHT
    assert grade(EMPS, coulomb_friction__axis=20.0, viscous_friction__axis=210.0) == RIGHT
    assert grade(EMPS, kind="ambiguous", coulomb_friction=20.0, viscous_friction=210.0) == RIGHT


def test_a_stated_remainder_takes_nothing_away():
    assert grade(EMPS, remains=True, coulomb_friction=20.0, viscous_friction=210.0) == RIGHT


def test_another_member_of_the_class_with_the_same_number_is_right():
    assert grade(EMPS, coulomb_friction=20.0, servo_damping=210.0) == RIGHT


def test_a_value_within_fifteen_per_cent_is_right_and_beyond_is_half():
    assert grade(EMPS, coulomb_friction=20.39 * 1.149, viscous_friction=203.5) == RIGHT
    assert grade(EMPS, coulomb_friction=20.39 * 1.2, viscous_friction=203.5) == HALF
    assert grade(EMPS, coulomb_friction=None, viscous_friction=203.5) == HALF


def test_a_value_within_the_truths_own_uncertainty_is_right():
    rolls = CASES["so101-wrist-roll"]
    (cause,) = rolls.causes
    assert cause.low < 0.85 * cause.value
    assert grade(rolls, coulomb_friction=1.01 * cause.low) == RIGHT


def test_a_member_whose_value_cannot_be_compared_is_half():
    assert grade(EMPS, stribeck_friction=20.0, viscous_friction=203.5) == HALF


def test_another_name_of_the_truth_has_its_own_values():
    rolls = CASES["so101-wrist-roll"]
    assert grade(rolls, backlash=0.02) == RIGHT
    assert grade(rolls, backlash=0.2) == HALF


def test_half_of_the_causes_is_half():
    judged = judge(EMPS, Answer("effect", named(coulomb_friction=20.0)))
    assert judged.grade == HALF
    assert judged.missed == ("viscous_friction@axis",)


def test_an_extra_name_is_wrong():
    judged = judge(EMPS, Answer("effect", named(coulomb_friction=20.0, viscous_friction=210.0, backlash=0.001)))
    assert judged.grade == WRONG
    assert judged.false == ("backlash",)


def test_what_may_be_named_is_not_false():
    assert grade(EMPS, coulomb_friction=20.0, viscous_friction=210.0, asymmetric_friction=3.0) == RIGHT


def test_the_wrong_class_is_wrong_and_nothing_is_silent():
    assert grade(EMPS, command_delay=0.01) == WRONG
    assert grade(EMPS, kind="unknown") == SILENT
    assert grade(EMPS, kind="no_gap") == SILENT
    assert judge(EMPS, None).grade == SILENT
    assert grade(EMPS, asymmetric_friction=3.0) == WRONG  # true, but none of what was asked for


def test_the_joint_counts():
    assert grade(ARM, torque_constant__elbow=1.33) == RIGHT
    assert grade(ARM, torque_constant__wrist_1=1.33) == WRONG
    assert grade(ARM, torque_constant=1.33) == WRONG  # without a joint it claims every joint
    assert judge(ARM, Answer("effect", (Named.of("torque_constant@elbow+wrist_1", 1.33),))).grade == WRONG
    arm = CASES["double-pendulum-friction"]
    assert judge(arm, Answer("effect", (Named.of("coulomb_friction@shoulder+elbow", 0.14),))).grade == RIGHT
    assert judge(arm, Answer("effect", (Named.of("coulomb_friction@all", 0.14),))).grade == RIGHT


def test_a_payload_needs_no_joint():
    load = CASES["ur10e-load"]
    assert grade(load, payload=2.7) == RIGHT
    assert judge(load, Answer("effect", (Named.of("payload@wrist_3", 2.7),))).grade == RIGHT


def test_where_nothing_is_withheld_no_gap_or_a_remainder_is_right():
    assert grade(NOTHING, kind="no_gap") == RIGHT
    assert grade(NOTHING, kind="unknown") == RIGHT
    assert grade(NOTHING, asymmetric_friction=3.0) == RIGHT  # a constant force of 3 N is there
    assert grade(NOTHING, backlash=0.01) == WRONG


def test_a_right_alternative_is_in_the_set_and_not_right():
    answer = Answer("ambiguous", named(backlash=0.01), (named(coulomb_friction=20.0, viscous_friction=203.5),))
    judged = judge(EMPS, answer)
    assert judged.grade == WRONG
    assert judged.in_set


def test_counts_add_up():
    judged = {name: judge(case, None) for name, case in CASES.items()}
    judged[EMPS.name] = judge(EMPS, Answer("effect", named(coulomb_friction=20.0, viscous_friction=400.0)))
    told = summary(list(CASES.values()), judged)
    assert told["all"]["cases"] == len(CASES)
    assert told["all"][HALF] == 1
    assert told["all"][SILENT] == len(CASES) - 1
    assert sum(row["cases"] for row in told["robot"].values()) == len(CASES)
    friction = told["class"]["friction"]
    assert friction["named"] == friction["value_right"] == 1
    assert told["class"]["damping"]["named"] == 1
    assert told["class"]["damping"]["value_right"] == 0


# A diagnosis --------------------------------------------------------------------------------------------------------


def effect(name, target, parameter, value):
    told = {"value": value, "low": value, "high": value, "unit": ""}
    return {"name": name, "target": target, "parameters": {parameter: told}}


def verdict(kind, effects, alternatives=(), remains=False):
    return {
        "verdict": {
            "kind": kind,
            "effects": effects,
            "probability": 0.9,
            "alternatives": list(alternatives),
            "remains": {"flag": remains, "where": None},
            "not_excited": [],
        },
        "shrink": {"before": 9.0, "after": 1.0, "closed": 0.9},
        "ranking": [],
    }


RIGHT_EFFECTS = [
    effect("coulomb_friction", "axis", "force", 20.0),
    effect("viscous_friction", ["axis"], "damping", 200.0),
]


def test_a_diagnosis_becomes_an_answer():
    told = of_diagnosis(verdict("effect", RIGHT_EFFECTS, remains=True))
    assert told["names"] == ["coulomb_friction@axis", "viscous_friction@axis"]
    assert told["values"]["viscous_friction@axis"] == 200.0
    assert told["remains"] is True
    assert judge(EMPS, submit.answer("made", EMPS.name, told)).grade == RIGHT
    unknown = of_diagnosis(verdict("unknown", RIGHT_EFFECTS))
    assert unknown["names"] == []  # the cause is said to be unknown


# A submission -------------------------------------------------------------------------------------------------------


def test_a_submission_is_scored(tmp_path, capsys):
    path = tmp_path / "mine.json"
    mine = {
        EMPS.name: {
            "kind": "effect",
            "names": ["coulomb_friction@axis", "viscous_friction@axis"],
            "values": {"coulomb_friction@axis": 20.1, "viscous_friction@axis": 205},
        },
        NOTHING.name: {"kind": "no_gap", "names": []},
    }
    path.write_text(json.dumps(mine))
    assert command.main(["submit", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["summary"]["all"]["right"] == 2
    assert told["cases"][EMPS.name]["grade"] == RIGHT
    assert command.main(["submit", str(path)]) == 0
    assert "class of the cause" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"nowhere": {"kind": "no_gap"}}, "no such case: python -m benchmarks.real cases"),
        ({EMPS.name: []}, "it is no object"),
        ({EMPS.name: {"kind": "sure"}}, "use one of no_gap, effect"),
        ({EMPS.name: {"kind": "effect"}}, "without names"),
        ({EMPS.name: {"kind": "no_gap", "names": ["backlash"]}}, "with names"),
        ({EMPS.name: {"kind": "effect", "names": ["gremlins@axis"]}}, "'gremlins' is unknown"),
        ({EMPS.name: {"kind": "effect", "names": "backlash"}}, "no list of words"),
        ({EMPS.name: {"kind": "effect", "names": ["backlash"], "values": {"backlash": "big"}}}, "finite number"),
        ({EMPS.name: {"kind": "effect", "names": ["backlash"], "values": {"play": 1}}}, "not in names"),
        ({EMPS.name: {"kind": "effect", "names": ["backlash"], "remains": "yes"}}, "true or false"),
        ({EMPS.name: {"kind": "effect", "names": ["backlash"], "alternatives": [3]}}, "no list of objects"),
        ({EMPS.name: {"kind": "effect", "name": ["backlash"]}}, "'name' is unknown"),
        ([], "no object"),
    ],
)
def test_a_bad_submission_is_told_in_one_line(tmp_path, capsys, told, said):
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(told))
    assert command.main(["submit", str(path)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert said in line
    assert "mine.json" in line


def test_a_submission_that_is_no_file_or_no_json(tmp_path, capsys):
    assert command.main(["submit", str(tmp_path / "none.json")]) == 2
    assert "no such file" in capsys.readouterr().err
    (tmp_path / "cut.json").write_text('{"emps')
    assert command.main(["submit", str(tmp_path / "cut.json")]) == 2
    assert "it is no JSON" in capsys.readouterr().err


# A run --------------------------------------------------------------------------------------------------------------

SQUEEZED = "ta11-half-a-wood"  # its numbers are in the package


def fake(calls, found):
    def run_command(words, work, folder, budget):
        calls.append(words)
        (work / "diagnosis").mkdir(exist_ok=True)
        (work / "diagnosis" / "diagnosis.json").write_text(json.dumps(found))
        return {"exit_status": 0, "seconds": 1.5, "lines": 3, "crashed": False, "last_line": "done"}

    return run_command


def test_a_run_keeps_its_answers_and_is_sealed(tmp_path):
    calls = []
    found = verdict("effect", [effect("servo_stiffness", "all", "factor", 2.0)])
    case = CASES[SQUEEZED]
    told = run.diagnose(case, tmp_path, tmp_path / "out", budget=30.0, run=fake(calls, found))
    assert told["answer"] == {
        "kind": "effect",
        "names": ["servo_stiffness"],
        "values": {"servo_stiffness": 2.0},
        "alternatives": [],
        "remains": False,
    }
    assert calls[0][:2] == ["diagnose", "recordings"]
    assert list((tmp_path / "out" / "cases" / SQUEEZED / "recordings").glob("*.parquet"))
    again = run.diagnose(case, tmp_path, tmp_path / "out", run=fake(calls, found))
    assert again == told
    assert len(calls) == 1
    assert judge(case, submit.answer("out", SQUEEZED, run.answers(tmp_path / "out", [case])[SQUEEZED])).grade == RIGHT


def test_a_run_that_is_told_the_names_has_no_others_in_its_library(tmp_path):
    calls, out = [], tmp_path / "out"
    found = verdict("effect", [effect("servo_stiffness", "all", "factor", 2.0)])
    case = CASES[SQUEEZED]
    assert run.diagnose(case, tmp_path, out, told=True, run=fake(calls, found))["told"]
    without = set(calls[0][calls[0].index("--without") + 1].split(","))
    names = {name for cause in case.causes for name in cause.effects} | set(case.may)
    assert names
    assert without == set(EFFECTS) - names
    with pytest.raises(ValueError, match="of another library: give a new folder"):
        run.diagnose(case, tmp_path, out, run=fake(calls, found))


def test_whatever_a_diagnosis_names_can_be_submitted():
    names = [name for name, one in EFFECTS.items() if one.nameable]
    told = submit.answer("made", EMPS.name, {"kind": "effect", "names": names})
    assert [one.effect for one in told.named] == names


def test_answers_of_other_declarations_are_refused(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / run.SEAL).write_text("0" * 64 + "  declarations\n")
    with pytest.raises(ValueError, match="other declarations"):
        run.begin(out)


def test_a_case_without_its_recordings_says_what_to_fetch(tmp_path, capsys):
    assert command.main(["convert", EMPS.name, str(tmp_path / "out"), "--data", str(tmp_path)]) == 2
    assert "DATA_EMPS.mat is not in" in capsys.readouterr().err
    assert command.main(["check", "--data", str(tmp_path)]) == 1
    assert "is not there" in capsys.readouterr().out


def test_the_lists_are_printed(capsys, monkeypatch):
    assert command.main(["cases"]) == 0
    assert f"{len(CASES)} cases of" in capsys.readouterr().out
    assert command.main(["fetch-list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert all(set(row) == {"source", "licence", "url", "place", "sha256"} for row in rows)
    monkeypatch.delenv(command.FOLDER, raising=False)
    assert command.main(["check"]) == 2
    assert "give --data" in capsys.readouterr().err
