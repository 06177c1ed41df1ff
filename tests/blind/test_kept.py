"""What is kept of a run scores, and calibrates, as the run itself does; several count together, no case twice."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks import verdicts_again
from benchmarks.blind import kept, paired, run, score
from benchmarks.blind.score import Judged
from benchmarks.blind.store import Store

ROOT = Path(__file__).resolve().parents[2]
FRICTION = {"name": "coulomb_friction", "target": "all", "parameters": {"force": 2.0}}
EVIDENCE = {"met": -100.0, "price": -3.0, "misfit": 1.0, "lasting": 0.9}


def label(kind: str, effects: list[dict[str, Any]]) -> dict[str, Any]:
    oracle = {"detectable": bool(effects), "closable": 0.9, "distance": 500.0, "ordinary": 100.0}
    return {"kind": kind, "effects": effects, "oracle": oracle, "setting": "gripper"}


def answer(effects: list[dict[str, Any]]) -> dict[str, Any]:
    said = {"kind": "effect" if effects else "no_gap", "probability": 0.9, "alternatives": [], "not_excited": []}
    nominal, other = {"effects": [], "evidence": EVIDENCE}, {"effects": [FRICTION], "evidence": EVIDENCE}
    named = [{**FRICTION, "parameters": {"force": {"value": 2.1, "low": 1.9, "high": 2.3, "deviation": 0.1}}}]
    return {
        "verdict": {**said, "effects": named if effects else []},
        "ranking": [{**other, "parameters": {"force": 2.1}}, nominal],
        "where": [{"channel": "position", "gap": 9.0}],
        "shrink": {"closed": 0.85, "per_channel": {}},
        "seconds": 12.0,
        "notes": [],
    }


def a_run(root: Path, seed: int, answered: int = 3) -> Store:
    """Of three cases: friction seen, friction missed, nothing."""
    store = Store(root)
    store.begin(run.facts(3, seed, (), ()))
    truths, said = ([FRICTION], [FRICTION], []), ([FRICTION], [], [])
    for k, effects in enumerate(truths):
        store.keep_label(k, label("one" if effects else "none", effects))
    store.seal(3)
    for k, effects in enumerate(said[:answered]):
        store.diagnosis(k).mkdir(parents=True)
        (store.diagnosis(k) / "diagnosis.json").write_text(json.dumps(answer(effects)))
    return store


def test_a_kept_run_scores_as_the_run_did(tmp_path: Path) -> None:
    store = a_run(tmp_path / "run", 5)
    store.followed_file(0).write_text('{"resolved": true}')
    assert kept.main(["write", str(store.root), str(tmp_path / "five.json")]) == 0
    of_file = kept.together([kept.load(tmp_path / "five.json")])
    of_run = score.score(
        [Judged(json.loads(store.label_file(k).read_text()), store.answer(k)) for k in range(3)], [True]
    )
    assert {name: of_file[name] for name in of_run} == of_run
    assert of_file["top1"]["value"] == 0.5
    assert of_file["next_motion"]["n"] == 1
    assert of_file["of"][0]["seed"] == 5
    assert of_file["of"][0]["seal"] == store.seal(3)


def test_runs_count_together_and_none_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = []
    for seed, answered in ((5, 3), (6, 1)):
        files.append(tmp_path / f"{seed}.json")
        kept.write(kept.keep(a_run(tmp_path / str(seed), seed, answered).root), files[-1])
    assert kept.main(["score", *map(str, files), "--out", str(tmp_path / "all.json")]) == 0
    both = json.loads((tmp_path / "all.json").read_text())
    assert both["top1"]["n"] == 3
    assert both["top1"]["value"] == pytest.approx(2 / 3)
    assert [one["cases"] for one in both["of"]] == [3, 1]
    assert kept.main(["score", str(files[0]), str(files[0])]) == 2
    assert "case 0 of seed 5 is in two of the files" in capsys.readouterr().err
    later = json.loads(files[0].read_text())  # the same run, its other cases answered by another version
    later["cases"] = [{**row, "case": row["case"] + 3} for row in later["cases"]]
    kept.write(later, tmp_path / "later.json")
    assert kept.main(["score", str(files[0]), str(tmp_path / "later.json"), "--out", str(tmp_path / "both.json")]) == 0
    assert json.loads((tmp_path / "both.json").read_text())["top1"]["n"] == 4


def test_other_methods_are_scored_beside_the_diagnosis_on_the_cases_that_they_answered(tmp_path: Path) -> None:
    store = a_run(tmp_path / "run", 5)
    for k in (1, 2):
        (store.case(k) / "baselines").mkdir()
        (store.case(k) / "baselines" / "cma.json").write_text(json.dumps(answer([FRICTION])))
    kept.write(kept.keep(store.root), tmp_path / "five.json")
    scores = kept.together([kept.load(tmp_path / "five.json")])
    theirs, ours = scores["baselines"]["cma"], scores["beside"]["cma"]
    assert (theirs["top1"]["value"], ours["top1"]["value"], scores["top1"]["value"]) == (1.0, 0.0, 0.5)
    assert (theirs["false_names"]["value"], ours["false_names"]["value"]) == (1.0, 0.0)


def test_a_kept_run_calibrates(tmp_path: Path) -> None:
    file = tmp_path / "five.json"
    kept.write(kept.keep(a_run(tmp_path / "run", 5).root), file)
    cases, facts = verdicts_again.read(file)
    assert len(cases) == facts["used"] == 3
    assert facts["seed"] == 5
    assert {option.classes for option in cases[0].options} == {frozenset(), frozenset({"friction"})}


def test_what_is_no_run_and_no_kept_file_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert kept.main(["write", str(tmp_path), str(tmp_path / "x.json")]) == 2
    assert "holds no run" in capsys.readouterr().err
    assert kept.main(["write", str(a_run(tmp_path / "run", 5, 0).root), str(tmp_path / "x.json")]) == 2
    assert "no case has its answer yet" in capsys.readouterr().err
    (tmp_path / "y.json").write_text('{"schema": "another/1"}')
    assert kept.main(["score", str(tmp_path / "y.json")]) == 2
    assert "no file of `kept write`" in capsys.readouterr().err


def test_two_versions_on_the_same_cases_are_told_apart_by_what_they_mended_and_broke(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = a_run(tmp_path / "run", 5)
    kept.write(kept.keep(store.root), tmp_path / "before.json")
    (store.diagnosis(1) / "diagnosis.json").write_text(json.dumps(answer([FRICTION])))
    kept.write(kept.keep(store.root), tmp_path / "after.json")
    out = tmp_path / "rows.json"
    assert paired.main([str(tmp_path / "before.json"), str(tmp_path / "after.json"), "--out", str(out)]) == 0
    rows = json.loads(out.read_text())
    assert rows["one effect"] == {"cases": 2, "before": 1, "after": 2, "mended": 1, "broken": 0, "p": 1.0}
    assert rows["no effect"]["mended"] == rows["no effect"]["broken"] == 0
    assert "mended" in capsys.readouterr().out


def test_of_ten_that_differ_nine_mended_are_no_chance() -> None:
    right, wrong = (Judged(label("one", [FRICTION]), answer(said)) for said in ([FRICTION], []))
    rows = paired.compare([wrong] * 9 + [right], [right] * 9 + [wrong])
    assert rows["one effect"]["p"] == pytest.approx(2 * (1 + 10) / 2**10)  # of ten coins at most one is a tail


def test_runs_of_other_labels_are_not_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed in (5, 6):
        kept.write(kept.keep(a_run(tmp_path / str(seed), seed).root) | {"seal": str(seed)}, tmp_path / f"{seed}.json")
    assert paired.main([str(tmp_path / "5.json"), str(tmp_path / "6.json")]) == 2
    assert "different runs" in capsys.readouterr().err


def test_readme_and_pages_say_what_first_answers_score() -> None:
    """The figures are of the files that the page's own command scores."""
    page = (ROOT / "docs" / "blind-check.md").read_text()
    section = page.split("## Where it stands")[1].split("\n## ")[0].splitlines()
    command = next(line for line in section if "kept score" in line)
    scores = kept.together([kept.load(ROOT / file) for file in command.split()[4:]])

    def of(name: str) -> str:
        one = scores[name]
        return f"{round(one['value'] * one['n'])} of {one['n']}"

    assert scores["false_names"]["value"] == 0
    named = f"{of('top1')} single effects and {of('pairs')} pairs"
    for file in ("README.md", "docs/limits.md"):
        text = (ROOT / file).read_text()
        assert named in text, file
        assert re.search(rf"nothing in {scores['false_names']['n']} (cases )?that have none", text), file
    table = {cells[1].split(":")[0].strip(): cells[-2] for cells in (r.split("|") for r in section) if cells[2:]}
    for row, name in (
        ("one effect that shows, named first", "top1"),
        ("two that show, both named and nothing else", "pairs"),
        ("no effect", "false_names"),
        ("outside the library", "unknown_flagged"),
        ("the library's own, called `unknown`", "false_flags"),
        ("90 % intervals that hold the truth", "interval_coverage"),
    ):
        assert table[row].strip().startswith(of(name)), row
