"""The files and lines of a diagnosis: what they say, that they are whole and equal."""

from __future__ import annotations

import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_diagnoses import CASES, COULOMB, LAG, LEFT, RIGHT, STIFFNESS, diagnosis, every_case, replace, squeezed

from tiago_mj.effects import EFFECTS, read_effects
from tiago_mj.gap import report
from tiago_mj.gap.report import advice, calibration, contradiction, html, residual, terminal, verdict, words
from tiago_mj.gap.report import json as report_json
from tiago_mj.gap.result import CARRIERS, SCHEMA, SHAPES, Named, ResidualShape, Value, json_schema
from tiago_mj.recordings.recording import Finding

DOCS = Path(__file__).parents[2] / "docs"

# diagnosis.json


@every_case
def test_a_diagnosis_has_exactly_the_keys_of_its_contract_and_only_finite_numbers(name, tmp_path):
    report_json.write(CASES[name], tmp_path / "diagnosis.json")

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    data = json.loads((tmp_path / "diagnosis.json").read_text(), parse_constant=refuse)
    assert list(data) == [
        *("schema", "headline", "verdict", "where", "stage", "residual_shape"),
        *("shrink", "ranking", "numbers", "numbers_joint", "open_numbers", "like", "lint", "next_motion", "splits"),
        *("robot", "notes", "complete", "stopped", "seed", "version", "seconds", "physics_steps", "trial_models"),
    ]
    assert data["schema"] == "tiago_mj.diagnosis/1"
    assert list(data["verdict"]) == ["kind", "effects", "probability", "alternatives", "remains", "not_excited", "part"]
    assert list(data["verdict"]["remains"]) == ["flag", "where"]
    gap = ["before", "after", "floor", "closed", "low", "high"]
    more = ["per_channel", "return", "per_phase", "per_channel_and_phase", "resampled", "accounted", "accounted_before"]
    assert list(data["shrink"]) == [*gap, *more, "weighed", "with_numbers"]
    keys = ["name", "target", "parameter", "value", "low", "high", "unit", "nominal"]
    assert all(list(one) == keys for one in data["numbers"])
    gap[gap.index("floor") :] = ["closed", "low", "high", "accounted"]
    for by in ("per_channel", "per_phase"):
        assert all(list(row) == gap for row in data["shrink"][by].values())
    assert all(list(row) == gap for rows in data["shrink"]["per_channel_and_phase"].values() for row in rows.values())
    if data["shrink"]["return"] is not None:
        assert list(data["shrink"]["return"])[:4] == ["policy", "nominal", "repaired", "measured"]
    for effect in data["verdict"]["effects"]:
        assert list(effect) == ["name", "target", "parameters"]
        keys = ["value", "low", "high", "unit", "deviation", "known_to"]
        assert all(list(p) == keys for p in effect["parameters"].values())
    for row in data["where"]:
        assert list(row) == ["channel", "phase", "band", "gap", "low", "high", "share"]
    for row in data["ranking"]:
        assert list(row) == ["effects", "validation_gain", "probability", "parameters", "evidence", "joint"]
        assert len(row["parameters"]) == len(row["effects"])
    for row in data["verdict"]["alternatives"]:
        assert list(row) == ["effects", "probability"]
        assert all(list(effect) == ["name", "target"] for effect in row["effects"])
    for row in data["lint"]:
        assert list(row) == ["code", "file", "channel", "message", "repaired"]
    assert list(data["splits"]) == ["train", "validation", "test"]


@every_case
def test_every_file_is_as_the_published_schema_says(name):
    published = json.loads((DOCS / "diagnosis.schema.json").read_text(encoding="utf-8"))
    assert published == json_schema(), "run python docs/make_diagnosis_schema.py"
    assert published["$id"] == SCHEMA
    validator = pytest.importorskip("jsonschema").Draft202012Validator(published)
    data = report_json.as_data(CASES[name])
    assert not list(validator.iter_errors(data))
    for wrong in ({"verdict": {}}, {"seed": "0"}, {"schema": "tiago_mj.diagnosis/2"}):
        assert list(validator.iter_errors({**data, **wrong}))


def test_what_a_file_of_an_earlier_version_lacks_is_unknown(tmp_path):
    given = report_json.as_data(CASES["unknown_with_a_shape"])
    later_too = ("stopped", "physics_steps", "trial_models", "numbers")
    for later in ("headline", "residual_shape", "robot", "notes", *later_too):
        del given[later]
    later_yet = ("accounted", "accounted_before", "weighed", "with_numbers")
    for later in ("per_phase", "per_channel_and_phase", "resampled", *later_yet):
        del given["shrink"][later]
    for row in given["ranking"]:
        del row["evidence"]
    (tmp_path / "diagnosis.json").write_text(json.dumps(given))
    read = report_json.load(tmp_path / "diagnosis.json")
    assert (read.residual_shape, read.stopped, read.trial_models, read.shrink.accounted) == (None,) * 4
    assert (read.numbers, read.shrink.with_numbers) == ((), None)
    before, after = (
        [{key: list(values) for key, values in row.parameters.items()} for row in one.ranking]
        for one in (CASES["unknown_with_a_shape"], read)
    )
    assert before == after
    assert any(before)


def test_a_target_is_a_name_a_list_of_names_or_all():
    data = report_json.as_data(diagnosis(best=(COULOMB, LAG)))
    assert [effect["target"] for effect in data["verdict"]["effects"]] == [RIGHT, "all"]
    data = report_json.as_data(diagnosis(best=(STIFFNESS,)))
    assert data["verdict"]["effects"][0]["target"] == [RIGHT, LEFT]


@every_case
def test_a_diagnosis_read_back_writes_the_same_file(name, tmp_path):
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    report_json.write(CASES[name], first)
    read = report_json.load(first)
    report_json.write(read, second)
    assert first.read_bytes() == second.read_bytes()
    assert verdict.headline(read) == verdict.headline(CASES[name])


def test_a_diagnosis_of_before_there_were_shapes_is_read(tmp_path):
    given = report_json.as_data(CASES["unknown_with_a_shape"])
    del given["residual_shape"]
    (tmp_path / "diagnosis.json").write_text(json.dumps(given))
    assert report_json.load(tmp_path / "diagnosis.json").residual_shape is None


def test_equal_diagnoses_are_equal_files_down_to_rounding_and_the_order_of_channels():
    one = diagnosis()
    turned = replace(one.shrink, per_channel=dict(reversed(one.shrink.per_channel.items())), before=58.31 + 1e-9)
    assert report_json.text(one) == report_json.text(replace(one, shrink=turned))
    assert report_json.text(one) != report_json.text(replace(one, shrink=replace(one.shrink, before=58.32)))
    assert '"value": 2.63457,' in report_json.text(one)


def test_unknown_numbers_are_null_and_numpy_numbers_are_numbers():
    cleaned = report_json.clean(
        {"a": math.nan, "b": [np.float64(1 / 3), -math.inf], "c": np.int64(2), "d": np.bool_(True)}
    )
    assert cleaned == {"a": None, "b": [0.333333, None], "c": 2, "d": True}
    assert json.dumps(report_json.clean(-0.0)) == "0.0"


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "no diagnosis at"),
        ("{", "cannot be read as JSON"),
        ('{"schema": "other/2"}', "has schema 'other/2'"),
        ('{"schema": "tiago_mj.diagnosis/1"}', "is incomplete"),
        ("[1]", "has schema None"),
    ],
)
def test_a_file_that_is_no_diagnosis_ends_in_one_line(content, says, tmp_path):
    path = tmp_path / "diagnosis.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match=says) as caught:
        report_json.load(path)
    assert "\n" not in str(caught.value)


# calibration.yaml


@every_case
def test_the_environments_load_what_a_calibration_holds(name, tmp_path):
    given = CASES[name]
    written = report.write(given, tmp_path)
    path, source = written["calibration.yaml"], written["diagnosis.json"]
    data = yaml.safe_load(path.read_text())
    assert list(data) == ["schema", "robot", "effects", *(["numbers"] if given.numbers else []), "source"]
    assert data["schema"] == "tiago_mj.calibration/1"
    assert data["robot"] == given.robot
    assert data["source"] == {"file": "diagnosis.json", "sha256": report_json.fingerprint(source)}
    entries = read_effects(path)
    assert [entry.name for entry in entries] == [effect.name for effect in given.repair]
    assert read_effects(path, numbers=False) == entries[: len(given.best.effects)]
    for entry, effect in zip(entries, given.repair, strict=True):
        whom = (effect.target,) if isinstance(effect.target, str) else effect.target
        assert entry.target == (None if effect.target == "all" else whom)
        for key, value in effect.parameters.items():
            assert entry.parameters[key] == pytest.approx(value.value, rel=1e-5)  # six significant digits
    for effect in (*data["effects"], *data.get("numbers", [])):
        assert all({"value", "low", "high"} <= set(p) for p in effect["parameters"].values())


def test_a_calibration_depends_on_what_was_found_and_not_on_how_long_it_took(tmp_path):
    def file(given):
        return report.write(replace(given, overlays=()), tmp_path)["calibration.yaml"].read_bytes()

    assert file(diagnosis()) == file(diagnosis(seconds=99.9))
    assert file(diagnosis()) != file(diagnosis(seed=1))


def test_small_and_large_values_stay_numbers_in_a_calibration(tmp_path):
    tiny = Named("encoder_quantization", (RIGHT,), {"step": Value(1.53e-5, 1e-6, math.inf, "m")})
    path = report.write(diagnosis(best=(tiny,), overlays=()), tmp_path)["calibration.yaml"]
    assert yaml.safe_load(path.read_text())["effects"][0]["parameters"]["step"] == {
        "value": 1.53e-5,
        "low": 1e-6,
        "high": None,
        "unit": "m",
    }
    assert read_effects(path)[0].parameters["step"] == 1.53e-5


# Sentences


def test_the_headline_says_what_is_different_by_how_much_and_how_far_the_gap_shrinks():
    assert verdict.headline(diagnosis()) == (
        "The gripper's right finger has 2.6 N (2.4–2.9) of Coulomb friction that the simulator lacks; adding it closes "
        "93 % (88–96 %) of the gap on recordings that were kept aside; 5.02 times the noise is left there, "
        "so this is part of the cause."
    )


def test_a_sentence_begins_with_a_capital_letter_but_a_joint_keeps_its_name():
    assert words.begin("one of them") == "One of them"
    assert verdict.headline(CASES["inverse_effort"]).startswith(
        "arm_1_joint, arm_2_joint, arm_3_joint and arm_4_joint have"
    )


def test_what_is_less_than_nominal_is_said_without_a_minus_sign():
    less = Named("viscous_friction", (LEFT,), {"damping": Value(-12.0, -15.0, -9.0, "N·s/m")})
    assert (
        words.clause(less) == "the gripper's left finger has 12 N·s/m (9–15) less viscous friction than the simulator"
    )


def test_each_kind_of_verdict_has_its_sentence():
    assert "so no effect is named" in verdict.headline(CASES["no_gap"])
    ambiguous = verdict.headline(CASES["ambiguous"])
    assert "cannot tell which" in ambiguous
    assert "Coulomb friction" in ambiguous
    assert "1.1 mm (0.9–1.4) of play" in ambiguous
    assert verdict.headline(CASES["unknown"]).startswith(
        "There is a gap that no known effect explains; most of it lies in"
    )
    known = verdict.headline(CASES["unknown_with_known"])
    assert "Coulomb friction" in known
    assert "no known effect" in known
    assert "but that is at the bound of what is possible" in verdict.headline(CASES["at_a_bound"])
    assert "A gap above the noise is left" in verdict.remainder(CASES["effect_and_more"])
    assert "no recording was kept aside" in verdict.headline(CASES["no_test_trial"])


def test_what_is_left_looks_like_something_and_sits_somewhere():
    assert residual.sentences(CASES["unknown_with_a_shape"]) == (
        "What is left of the force reading of the left finger swings at one frequency, 52.9 Hz: that explains 93 % of "
        "it, contact 12 %. The motion hardly has it: the force reading is off, or a force that hardly "
        "moves the joint. That points to the stage “force sensor”."
    )
    several = residual.sentences(CASES["unknown_that_may_be_several"])
    assert "rises with speed: that explains 72 % of it, which these recordings can hardly distinguish from" in several
    assert several.endswith("may come from the stages timing, command or actuator.")
    chance = residual.sentences(CASES["effect_and_an_irregular_rest"])
    assert "has none of the shapes that are looked for" in chance
    assert chance.endswith("stays open.")
    none = ResidualShape("position.elbow", (), "unclear", "irregular", 0.001, runner_up="speed")
    assert "one frequency): none of them explains any of it. " in residual.sentences(
        replace(CASES["unknown"], residual_shape=none)
    )
    assert residual.sentences(CASES["unknown"]) == ""
    teeth = ResidualShape("position.elbow", ("transmission",), "motion", "periodic", 0.8, at=0.105, unit="rad")
    assert "repeats with the joint's position, every 0.105 rad: " in residual.sentences(
        replace(CASES["unknown"], residual_shape=teeth)
    )


def test_every_shape_has_its_words_and_what_tells_more_of_it():
    assert set(residual.DOES) == set(residual.ON) == set(SHAPES) - {"irregular"}
    assert set(residual.NEXT) == set(SHAPES)
    assert set(residual.CARRIED) == set(CARRIERS)
    assert set(advice.BY_SHAPE) <= set(SHAPES)
    assert set(advice.BY_SHAPE.values()) <= set(advice.MOTIONS)


def test_the_return_of_a_policy_is_said_with_how_far_each_simulator_is_off():
    assert verdict.on_task(diagnosis()) == (
        "Return of policy pi in the 2 test recordings: −229.8 measured; the nominal simulator predicts −204.7, off by "
        "25.1; the repaired one predicts −231.4, off by 1.60."
    )
    assert "the nominal simulator predicts −3.200; the repaired one predicts −8.100. It was not measured" in (
        verdict.on_task(CASES["never_measured"])
    )
    assert verdict.on_task(CASES["no_gap"]) == ""


ARM = replace(diagnosis().shrink, before=478.0, after=374.0, closed=0.218, low=0.15, high=0.27, accounted=0.98)


def test_a_name_that_leaves_hundreds_of_floors_is_told_as_part_of_the_cause():
    """The industrial arm's twin: the friction is right, and closes a fifth of what wrong gains make."""
    found = contradiction.checked(replace(diagnosis(), shrink=ARM))
    assert found.verdict.part
    assert report_json.as_data(found)["verdict"]["part"] is True
    assert "closes 22 % (15–27 %) of the gap on recordings that were kept aside; 374 times the noise is" in (
        verdict.headline(found)
    )
    assert verdict.sure(found).startswith("Probability 93 % that this is part of the cause: ")
    assert "is part of the cause, up to its class" in html.render(found)
    assert "Which, as part of the cause, with its probability" in [line for _, line in terminal.lines(found, {})]
    both = contradiction.checked(replace(CASES["ambiguous"], shrink=replace(ARM, after=322.0, closed=0.327, high=0.4)))
    assert both.verdict.part
    assert verdict.headline(both).endswith("322 times the noise is left there, so this is part of the cause.")


@pytest.mark.parametrize(
    "changes",
    [
        {"after": 3.9, "closed": 1 - 2.9 / 477, "high": 0.995},  # noise, or nearly
        {"after": 8.0, "closed": 1 - 7 / 477, "high": 0.999},  # more than noise, and hardly any of the gap
        {"closed": None, "low": None, "high": None},  # it shows in the readings
    ],
)
def test_what_leaves_noise_or_next_to_nothing_of_the_gap_is_no_part(changes):
    found = contradiction.checked(replace(diagnosis(), shrink=replace(ARM, **changes)))
    assert not found.verdict.part
    assert "part of the cause" not in verdict.headline(found)
    assert "part of the cause" not in verdict.sure(found)


def test_no_gap_says_what_the_simulators_own_numbers_account_for():
    same = replace(CASES["no_gap"].shrink, before=371.0, after=371.0, accounted=1.02)
    assert verdict.headline(replace(CASES["no_gap"], shrink=same)).endswith(
        "so no effect is named; yet 371 times the noise is left on recordings that were kept aside, 1.02 with its "
        "numbers adjusted within their uncertainty."
    )
    assert verdict.headline(CASES["no_gap"]).endswith("so no effect is named.")


def test_a_repair_that_does_not_help_is_not_praised():
    worse = diagnosis()
    worse = replace(worse, shrink=replace(worse.shrink, closed=-0.2, low=-0.4, high=0.0))
    assert "does not close the gap" in verdict.headline(worse)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_has_a_clause_that_names_its_parameters(name):
    declared = EFFECTS[name]
    values = {key: Value(0.5, 0.4, 0.6, p.unit[0]) for key, p in declared.parameters.items()}
    target = {"joint": (RIGHT,), "command": (RIGHT,), "sensor": ("right",)}.get(declared.targets, "all")
    said = words.clause(Named(name, target, values))
    assert "there is" not in said, "the fallback is for a user's own effects"
    assert "{" not in said
    assert len(re.findall(r"\([^()]*–[^()]*\)", said)) == len(values), "each parameter with its interval"
    assert 3 < len(words.meaning(name).split()) < 40
    if declared.clause_less:
        values = {key: replace(v, value=-0.5, low=-0.6, high=-0.4) for key, v in values.items()}
        assert "−" not in words.clause(Named(name, target, values))


def test_a_drivers_period_is_told_where_it_has_one():
    width = Value(0.0003, None, None, "m")
    each = words.clause(Named("command_deadband", (RIGHT,), {"width": width, "period": Value(0.0, None, None, "s")}))
    looks = words.clause(Named("command_deadband", (RIGHT,), {"width": width, "period": Value(0.005, None, None, "s")}))
    assert each.endswith("below 0.3 mm")
    assert looks.endswith("below 0.3 mm, looked at every 5 ms")


def test_an_effect_of_a_users_own_is_said_by_its_name():
    own = Named("cable_tug", ("arm_1_joint",), {"pull": Value(1.5, None, None, "N")})
    assert words.clause(own) == "there is cable tug on arm_1_joint (pull 1.5 N)"


def test_numbers_show_as_many_digits_as_their_interval_supports():
    assert words.amount(Value(0.03124, 0.02871, 0.03412, "s")) == "31 ms (29–34)"
    assert words.amount(Value(1534.2, 1401.0, 1702.0, "N/m")) == "1534 N/m (1401–1702)"
    assert words.amount(Value(-0.3, -0.52, 0.11, "N")) == "−0.3 N (−0.5 to 0.1)"
    assert words.amount(Value(0.72, None, None, "-")) == "0.72"
    assert words.amount(Value(0.99999, None, None, "-"), share=True) == "over 99.9 %"
    assert words.amount(Value(0.25, 0.2, 0.3, "-"), share=True) == "25 % (20–30)"
    assert words.number(None) == "–"
    assert words.number(123456.0) == "123000"
    assert words.percent(0.004) == "0.4 %"


def test_files_are_written_whole_or_not_at_all(tmp_path, monkeypatch):
    report.write(diagnosis(), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert set(before) == {"diagnosis.json", "calibration.yaml", "report.html"}

    def breaks(*_):
        raise OSError("disk full")

    monkeypatch.setattr("pathlib.Path.replace", breaks)
    with pytest.raises(OSError, match="disk full"):
        report.write(diagnosis(seed=1), tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


# Terminal


def test_kinds_of_findings_are_counted_in_words_of_their_number():
    def said(*findings):
        shown = (line for _, line in terminal.lines(diagnosis(findings=findings), {}))
        return next(line for line in shown if line.startswith("Check of the recordings"))

    clock = Finding("time_unit", "a.csv", "time", "stated to be in ms; multiplied by 0.001", True)
    steps = Finding("quantum", "a.csv", "force.right", "readings come in steps of 0.01 sensor units")
    assert said(clock, steps) == "Check of the recordings: 2 kinds of findings, 1 of them repaired"
    assert said(clock) == "Check of the recordings: 1 kind of finding, repaired"
    assert said(steps) == "Check of the recordings: 1 kind of finding, left as it is"


@every_case
def test_the_terminal_says_the_same_in_short(name):
    console = pytest.importorskip("rich.console").Console(file=io.StringIO(), width=100)
    terminal.show(CASES[name], console=console)
    said = console.file.getvalue()
    assert squeezed(verdict.headline(CASES[name])) in squeezed(said)
    assert len(said.splitlines()) < 40
    assert squeezed(verdict.on_task(CASES[name]) if "How far" in said else "") in squeezed(said)
    assert ("by phase: " in said) == ("How far" in said and bool(CASES[name].best.effects))
    assert squeezed(residual.sentences(CASES[name])) in squeezed(said)
    assert ("How far" in said) == (CASES[name].shrink.before is not None and CASES[name].kind != "no_gap")


def test_names_in_brackets_are_printed_as_they_are(tmp_path):
    console = pytest.importorskip("rich.console").Console(file=io.StringIO(), width=100)
    terminal.show(diagnosis(notes=("trial [red]odd[/red] was left out",)), {"report.html": tmp_path}, console=console)
    assert "[red]odd[/red]" in console.file.getvalue()
    assert f"Written: {tmp_path}" in console.file.getvalue()


def test_the_source_of_a_calibration_has_to_exist(tmp_path):
    with pytest.raises(FileNotFoundError):
        calibration.text(diagnosis(), tmp_path / "diagnosis.json")
