"""Labels stay sealed until every case is diagnosed, runs go on where they stopped, and scores count what they say."""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.blind import baselines, command, intervals, page, plan, run, score
from benchmarks.blind.command import blind, write_scores
from benchmarks.blind.dictionary import KINDS, available
from benchmarks.blind.score import Judged
from benchmarks.blind.store import Store
from tiago_mj import cli

SCORES = [
    "top1",
    "in_set",
    "set_size",
    "pairs",
    "false_names",
    "unknown_flagged",
    "false_flags",
    "ece",
    "parameter_error",
    "interval_coverage",
    "closed_share",
    "next_motion",
    "seconds",
    "physics_steps",
]


def effect(name: str, **parameters: float) -> dict[str, Any]:
    return {"name": name, "target": "all", "parameters": parameters}


def label(kind: str, *effects: dict[str, Any], detectable: bool = True, closable: float | None = 1.0) -> dict[str, Any]:
    oracle = {"detectable": detectable and bool(effects), "closable": closable}
    return {"kind": kind, "setting": "gripper", "interface": "velocity", "effects": list(effects), "oracle": oracle}


def answer(
    kind: str,
    *effects: dict[str, Any],
    probability: float = 0.9,
    alternatives: tuple[tuple[dict[str, Any], ...], ...] = (),
    closed: float | None = 0.9,
) -> dict[str, Any]:
    named = [
        {**e, "parameters": {p: {"value": v, "low": 0.9 * v, "high": 1.1 * v} for p, v in e["parameters"].items()}}
        for e in effects
    ]
    others = [{"effects": list(one), "probability": 0.1} for one in alternatives]
    verdict = {"kind": kind, "effects": named, "probability": probability, "alternatives": others, "not_excited": []}
    return {"verdict": verdict, "shrink": {"closed": closed}, "seconds": 10.0}


FRICTION, STRIBECK = effect("coulomb_friction", force=2.0), effect("stribeck_friction", static=2.0, velocity=0.01)
DELAY, GAIN = effect("command_delay", seconds=0.03), effect("force_gain", factor=1.3)


# Wilson by hand for 2 of 4: (0.5 + z²/8 ± z √(0.25/4 + z²/64)) / (1 + z²/4), z = 1.645.
def test_a_member_of_the_true_class_is_right_and_a_stranger_is_wrong() -> None:
    scores = score.score(
        [
            Judged(label("one", FRICTION), answer("effect", FRICTION)),
            Judged(label("one", FRICTION), answer("effect", STRIBECK)),
            Judged(label("one", FRICTION), answer("effect", DELAY, closed=0.0)),
            Judged(label("one", FRICTION), answer("ambiguous", DELAY, alternatives=((DELAY,), (FRICTION,)))),
            Judged(label("one", FRICTION, detectable=False), answer("no_gap")),
        ]
    )
    assert scores["top1"] == pytest.approx({"value": 0.5, "low": 0.1824, "high": 0.8176, "n": 4}, abs=1e-3)
    assert scores["in_set"]["value"] == 0.75
    assert scores["set_size"]["value"] == 1.25
    assert scores["undetectable"] == {**scores["undetectable"], "value": 1.0, "n": 1}
    assert scores["closed_share"]["value"] == pytest.approx((0.9 + 0.9 + 0.0 + 0.9) / 4)


def test_weak_effects_are_counted_apart_from_strong_ones() -> None:
    def seen(distance: float, said: dict[str, Any]) -> Judged:
        one = label("one", FRICTION)
        return Judged({**one, "oracle": {**one["oracle"], "distance": distance, "ordinary": 100.0}}, said)

    weak, strong = seen(200.0, answer("no_gap")), seen(5000.0, answer("effect", STRIBECK))
    rows = score.by_strength([weak, weak, strong, Judged(label("none"), answer("no_gap"))])
    assert {word: (row["value"], row["n"]) for word, row in rows.items()} == {
        "up to 3 times": (0.0, 2),
        "over 10 times": (1.0, 1),
    }


def test_pairs_need_both_and_no_more() -> None:
    judged = [
        Judged(label("two", FRICTION, GAIN), answer("effect", GAIN, STRIBECK)),
        Judged(label("two", FRICTION, GAIN), answer("effect", GAIN)),
        Judged(label("two", FRICTION, GAIN), answer("effect", GAIN, DELAY)),
        Judged(label("two", FRICTION, GAIN), answer("unknown", GAIN, FRICTION)),
    ]
    assert score.score(judged)["pairs"]["value"] == 0.25


def test_names_on_nothing_and_flags_are_counted_where_they_belong() -> None:
    judged = [
        Judged(label("none", closable=None), answer("no_gap")),
        Judged(label("none", closable=None), answer("effect", DELAY)),
        Judged(label("none", closable=None), answer("unknown")),
        Judged(label("none", closable=None), None),
        Judged(label("outside", effect("mains_hum", amplitude=0.1, frequency=52)), answer("unknown")),
        Judged(label("outside", effect("cable_tug", stiffness=100, place=0.7)), answer("effect", DELAY)),
        Judged(label("left_out", FRICTION), answer("effect", STRIBECK)),
        Judged(label("left_out", FRICTION), answer("unknown")),
        Judged(label("left_out", FRICTION), answer("effect", DELAY)),
    ]
    scores = score.score(judged)
    assert (scores["false_names"]["value"], scores["false_names"]["n"]) == (0.25, 4)
    assert (scores["unknown_flagged"]["value"], scores["unknown_flagged"]["n"]) == (0.5, 2)
    assert (scores["false_flags"]["value"], scores["false_flags"]["n"]) == (0.25, 4)
    assert scores["left_out"]["value"] == pytest.approx(2 / 3)
    assert scores["failed"]["value"] == pytest.approx(1 / 9)
    assert [score.right(j) for j in judged] == [True, False, False, False, True, False, True, True, False]


def test_the_confusion_table_marks_as_right_what_counts_as_right() -> None:
    judged = [
        Judged(label("none", closable=None), answer("no_gap")),
        Judged(label("left_out", FRICTION), answer("effect", STRIBECK)),
        Judged(label("left_out", FRICTION), answer("unknown")),
        Judged(label("one", FRICTION), answer("effect", DELAY)),
        Judged(label("outside", effect("cable_tug", stiffness=100, place=0.7)), answer("effect", DELAY)),
    ]
    shown = page.page(judged, score.score(judged), "", "")
    assert (shown.count("class='n hit'"), shown.count("class='n miss'")) == (3, 2)
    assert [score.right(j) for j in judged] == [True, True, True, False, False]


def test_parameter_errors_are_over_the_distance_from_the_identity() -> None:
    true, said = effect("servo_stiffness", factor=0.8), effect("servo_stiffness", factor=0.84)
    scores = score.score([Judged(label("one", true), answer("effect", said))])
    assert scores["parameter_error"]["value"] == pytest.approx(0.2)
    assert scores["interval_coverage"]["value"] == 1.0, "0.84 within 10 % holds 0.8"
    effective = {**label("one", true), "effective": {"factor": 0.84}}
    assert score.score([Judged(effective, answer("effect", said))])["parameter_error"]["value"] == pytest.approx(0.0)


def test_the_commonest_guess_is_as_right_as_it_is_common(tmp_path: Path) -> None:
    judged = [Judged(label("one", FRICTION), answer("effect", FRICTION)) for _ in range(3)]
    judged += [
        Judged(label("one", DELAY), answer("effect", DELAY)),
        Judged(label("none", closable=None), answer("no_gap")),
    ]
    guessed = baselines.scores(judged, Store(tmp_path))["most_frequent"]
    assert guessed["top1"]["value"] == 0.75
    assert guessed["false_names"]["value"] == 1.0
    assert guessed["closed_share"]["value"] == 0.0
    assert guessed["ece"]["value"] == pytest.approx(0.0), "it says 3 of 5, and is right in 3 of 5"


def test_calibration_error_is_zero_for_honest_probabilities_and_large_for_boasts() -> None:
    rng = np.random.default_rng(0)
    p = rng.uniform(0.2, 1.0, 20_000)
    honest = np.stack([p, rng.random(len(p)) < p], axis=1)
    boasts = np.stack([np.full(500, 0.99), rng.random(500) < 0.6], axis=1)
    assert intervals.calibration_error(honest) < 0.02
    assert intervals.calibration_error(boasts) == pytest.approx(0.39, abs=0.05)
    assert intervals.spiegelhalter(honest) > 0.01
    assert intervals.spiegelhalter(boasts) < 1e-6


def test_probabilities_are_worth_what_they_gain_on_the_best_constant() -> None:
    rng = np.random.default_rng(2)
    p = rng.uniform(0.2, 1.0, 20_000)
    honest = np.stack([p, rng.random(len(p)) < p], axis=1)
    constant = np.column_stack([np.full(len(p), honest[:, 1].mean()), honest[:, 1]])
    for loss in (intervals.brier, intervals.log_loss):
        assert intervals.gain_over_constant(honest, loss) > 0.03  # Brier: the variance of p, 0.8² / 12 = 0.053
        assert intervals.gain_over_constant(constant, loss) == pytest.approx(0.0)
    bins = intervals.reliability(honest)
    assert [count for _, _, count in bins] == [4000] * 5
    assert all(abs(said - share) < 0.03 for said, share, _ in bins)  # four standard errors of 4000


def test_a_softer_form_of_what_the_library_has_is_right_as_that_form_and_scored_apart() -> None:
    soft, hard = effect("soft_saturation", limit=1.0), effect("force_saturation", limit=1.0)
    judged = [
        Judged(label("outside", soft), answer("effect", hard)),
        Judged(label("outside", soft), answer("effect", DELAY)),
        Judged(label("outside", soft), answer("unknown")),
        Judged(label("outside", effect("mains_hum", amplitude=0.1, frequency=52)), answer("unknown")),
    ]
    scores = score.score(judged)
    assert (scores["soft_forms"]["value"], scores["soft_forms"]["n"]) == (pytest.approx(2 / 3), 3)
    assert (scores["unknown_flagged"]["value"], scores["unknown_flagged"]["n"]) == (1.0, 1)


def test_a_name_for_what_the_library_lacks_counts_against_its_probability() -> None:
    judged = [Judged(label("outside", effect("cable_tug", stiffness=100, place=0.7)), answer("effect", DELAY))]
    assert score.stated(judged[0]) == (0.9, 0.0)
    assert score.stated(Judged(judged[0].label, answer("unknown"))) is None


def test_wilson_intervals_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(1000):
        interval = intervals.share(list(rng.random(60) < 0.93))
        held += interval["low"] <= 0.93 <= interval["high"]
    assert 860 <= held <= 960  # 90 %, less what counts of 60 make of it


def fake_case(tmp_path: Path, number: int, kind: str = "one") -> None:
    Store(tmp_path).keep_label(number, label(kind, FRICTION) if kind == "one" else label("none", closable=None))
    Store(tmp_path).recordings(number).mkdir(parents=True)


def write_answer(out: Path, said: dict[str, Any]) -> None:
    out.mkdir(parents=True)
    (out / "diagnosis.json").write_text(json.dumps(said))


def test_no_case_is_diagnosed_before_the_seal_and_no_label_opened_before_the_last(tmp_path: Path) -> None:
    store = Store(tmp_path)
    planned = plan.plan(2, 1, settings=("gripper",), only=("one",))
    for number in range(2):
        fake_case(tmp_path, number)
    seen: list[list[str]] = []

    def call(command: list[str]) -> tuple[int, str]:
        assert (tmp_path / "seal.txt").exists(), "sealed first"
        assert not (tmp_path / "labels.json").exists(), "labels stay closed"
        seen.append(command)
        if len(seen) == 2:
            raise KeyboardInterrupt
        write_answer(Path(command[command.index("--out") + 1]), answer("effect", FRICTION))
        return 0, ""

    with pytest.raises(ValueError, match="no seal"):
        store.unseal(2)
    with pytest.raises(KeyboardInterrupt):
        run.diagnose(planned, store, run.Diagnoser(), say=lambda _: None, call=call)
    with pytest.raises(ValueError, match="case 001 is not diagnosed"):
        store.unseal(2)

    def fail(command: list[str]) -> tuple[int, str]:
        seen.append(command)
        return 2, "tiago-mj diagnose: trial-00: no"

    run.diagnose(planned, store, run.Diagnoser(), say=lambda _: None, call=fail)
    assert len(seen) == 3, "case 000 is not diagnosed again"
    assert "no" in store.failure(1).read_text()
    for words in seen:
        assert not any(".sealed" in word or "labels" in word for word in words)
    labels = store.unseal(2)
    assert labels["000"]["effects"][0]["name"] == "coulomb_friction"
    assert (tmp_path / "labels.json").exists()


@pytest.mark.parametrize("said", [f"case/.diagnosis: {cli.FULL}: make room on it", "a.html: read-only file system"])
def test_a_drive_that_takes_nothing_is_no_answer_of_the_diagnosis(said: str, tmp_path: Path) -> None:
    fake_case(tmp_path, 0)
    store, planned = Store(tmp_path), plan.plan(1, 1, settings=("gripper",), only=("one",))
    with pytest.raises(OSError, match="case 000 cannot be written"):
        run.diagnose(
            planned, store, run.Diagnoser(), say=lambda _: None, call=lambda _: (2, f"tiago-mj diagnose: {said}")
        )
    assert not store.answered(0), "it is asked again"


def test_diagnoses_side_by_side_answer_every_case_once(tmp_path: Path) -> None:
    for number in range(5):
        fake_case(tmp_path, number)
    seen: list[str] = []

    def call(words: list[str]) -> tuple[int, str]:
        seen.append(words[words.index("--out") + 1])
        write_answer(Path(seen[-1]), answer("effect", FRICTION))
        return 0, ""

    store, planned = Store(tmp_path), plan.plan(5, 1, settings=("gripper",), only=("one",))
    run.diagnose(planned, store, run.Diagnoser(), say=lambda _: None, call=call, at_once=3)
    assert len(set(seen)) == len(seen) == 5
    assert len(store.unseal(5)) == 5


def test_a_label_that_was_changed_after_the_seal_is_found(tmp_path: Path) -> None:
    fake_case(tmp_path, 0)
    store = Store(tmp_path)
    digest = store.seal(1)
    assert digest in (tmp_path / "seal.txt").read_text()
    assert store.seal(1) == digest
    store.keep_label(0, label("one", GAIN))
    with pytest.raises(ValueError, match=r"seal\.txt sealed other labels"):
        store.seal(1)


def test_a_run_goes_on_with_more_cases_and_keeps_the_seal_of_the_first(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for number in range(2):
        fake_case(tmp_path, number)
    store.begin({"cases": 2, "seed": 3})
    first = store.seal(2)
    fake_case(tmp_path, 2)
    store.begin({"cases": 3, "seed": 3})
    assert store.seal(3) != first
    assert first in (tmp_path / "seal-of-2.txt").read_text()
    with pytest.raises(ValueError, match="no fewer cases"):
        store.begin({"cases": 2, "seed": 3})
    store.keep_label(0, label("one", GAIN))
    (tmp_path / "seal.txt").unlink()
    with pytest.raises(ValueError, match="seal-of-2"):
        store.seal(3)


def test_the_seal_is_the_hash_of_labels_json(tmp_path: Path) -> None:
    import hashlib

    fake_case(tmp_path, 0, "none")
    store = Store(tmp_path)
    digest = store.seal(1)
    write_answer(store.diagnosis(0), answer("no_gap"))
    store.unseal(1)
    assert hashlib.sha256((tmp_path / "labels.json").read_bytes()).hexdigest() == digest


def test_scores_and_page_are_written_in_the_contracts_form(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for number, kind in enumerate(("one", "none")):
        fake_case(tmp_path, number, kind)
    write_answer(store.diagnosis(0), answer("effect", FRICTION))
    store.failure(1).write_text("exit status 1")
    digest = store.seal(2)
    labels = store.unseal(2)
    write_scores(store, plan.plan(2, 1), labels, digest, "python -m benchmarks.blind", say=lambda _: None)
    written = json.loads((tmp_path / "scores.json").read_text(), parse_constant=lambda word: pytest.fail(word))
    for name in SCORES:
        assert {"value", "low", "high", "n"} <= set(written[name]), name
    assert written["top1"]["value"] == 1.0
    assert set(SCORES) <= set(written["baselines"]["most_frequent"])
    page = (tmp_path / "index.html").read_text()
    assert "cases/000/diagnosis/report.html" in page
    assert digest in page
    assert "<svg" in page
    assert "http" not in page, "the page is complete in itself"
    assert "no evaluation" not in page


def test_a_seed_that_served_to_calibrate_is_no_evaluation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = tmp_path / "verdict.json"
    shipped.write_text(json.dumps({"calibration": {"seeds": [1001]}}))
    assert command.calibration_seeds(shipped) == [1001]
    assert command.calibration_seeds(tmp_path / "none.json") == []
    monkeypatch.setattr(command, "calibration_seeds", lambda: [1001])
    store = Store(tmp_path)
    fake_case(tmp_path, 0, "none")
    write_answer(store.diagnosis(0), answer("no_gap"))
    for seed, warned in ((1001, True), (7, False)):
        digest, labels = store.seal(1), store.unseal(1)
        scores = write_scores(store, plan.plan(1, 1), labels, digest, "", say=lambda _: None, seed=seed)
        assert ("caution" in scores) is warned
        assert ("no evaluation" in (tmp_path / "index.html").read_text()) is warned


def test_a_run_holds_the_mix_and_the_first_cases_of_a_longer_one() -> None:
    whole = plan.plan(420, 1)
    counts = {kind: sum(case.kind == kind for case in whole) for kind in plan.SHARES}
    assert counts["none"] >= 117
    assert counts["one"] >= 150
    assert min(counts["two"], counts["outside"]) >= 58
    assert whole[:30] == plan.plan(30, 1)
    assert whole[:30] != plan.plan(30, 2)
    singles = {case.effects[0].name for case in whole if case.kind == "one"}
    assert singles == {name for name, kind in KINDS.items() if kind.known}, "every effect comes"
    for case in whole:
        for choice in case.effects:
            assert case.setting in KINDS[choice.name].ranges
    assert {case.interface for case in whole if case.setting == "gripper"} == {"velocity", "position"}
    assert len({case.seed for case in whole}) == len(whole)
    assert len(available("gripper", known=False)) >= 6


def test_the_command_goes_on_in_its_folder_and_refuses_anothers(tmp_path: Path) -> None:
    options = {
        "cases": 1,
        "seed": 3,
        "out": tmp_path,
        "kinds": "none",
        "settings": "plain",
        "workers": 1,
        "efforts": False,
    }
    options |= {
        "rates": None,
        "seconds": None,
        "at_once": 1,
        "trials": None,
        "effects": None,
        "off_centre": None,
        "jobs": 1,
        "time_budget": None,
        "diagnose_with": None,
        "generate_only": True,
    }
    said: list[str] = []
    assert blind(argparse.Namespace(**options), said.append) == 0
    assert any("SHA-256" in line for line in said)
    assert {path.suffix for path in (tmp_path / "cases/000/recordings").iterdir()} == {".json", ".parquet", ".xml"}
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert blind(argparse.Namespace(**options), said.append) == 0
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(ValueError, match="another run"):
        blind(argparse.Namespace(**{**options, "seed": 4}), said.append)


def test_half_of_the_cases_run_at_the_environments_rate_and_can_be_chosen() -> None:
    whole = plan.plan(420, 1)
    fast = [case for case in whole if case.rate == 240]
    assert 0.4 <= len(fast) / len(whole) <= 0.6
    assert all(1.5 <= case.seconds <= 2.5 and case.setting != "arm" for case in fast)
    assert {case.setting for case in fast} == {"gripper", "plain"}
    assert {case.seconds for case in whole if case.rate == 25} == {6.0}
    chosen = plan.plan(40, 1, settings=("gripper",), rates=(240.0,), trials=4)
    assert {(case.rate, case.trials) for case in chosen} == {(240.0, 4)}
