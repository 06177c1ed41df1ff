"""What is kept of the benchmark is one thing: answers, their score, the baselines, and the page."""

import json
from pathlib import Path

import pytest

from benchmarks.machine import RESULTS
from benchmarks.real import __main__ as command
from benchmarks.real import baselines, kept, submit
from benchmarks.real.cases import CASES
from benchmarks.real.declare import REGRESSION, seal
from benchmarks.real.score import GRADES, RIGHT, summary

ROOT = Path(__file__).resolve().parents[2]
ANSWERS = RESULTS / f"{kept.ANSWERS}.json"


@pytest.fixture(scope="module")
def figures():
    return json.loads((RESULTS / f"{kept.TODAY}.json").read_text())["results"]


def test_the_kept_answers_score_to_the_kept_figures(figures):
    judged = submit.score(submit.read(ANSWERS))
    assert figures["declarations"] == seal(list(CASES.values()))
    assert figures["cases"] == json.loads(json.dumps({name: vars(one) for name, one in judged.items()}))
    assert figures["summary"] == json.loads(json.dumps(summary(list(CASES.values()), judged)))


def test_kept_answers_have_rankings_and_seconds_and_are_few_bytes():
    assert ANSWERS.stat().st_size < 300_000
    for name, told in kept.today().items():
        assert told["seconds"] > 0, name
        assert told["ranking"], name
    assert submit.text(kept.today()) == ANSWERS.read_text()


def test_a_baseline_answers_no_case_whose_truth_is_a_regressions():
    told = kept.baselines()
    assert set(told) <= set(baselines.METHODS)
    for answers in told.values():
        for name, answer in answers.items():
            submit.answer("kept", name, answer)
    for name in told["regression"]:
        assert all(cause.known_by != REGRESSION for cause in CASES[name].causes)


def test_the_page_has_the_table_of_what_is_kept(capsys):
    assert command.main(["table"]) == 0
    rows = capsys.readouterr().out.strip().splitlines()
    page = (ROOT / "docs" / "real-data.md").read_text()
    assert "\n".join(rows) in page


def test_the_readme_and_the_page_say_the_kept_figures(figures):
    counts = figures["summary"]["all"]
    said = ", ".join(f"{counts[grade]} {grade}" for grade in GRADES)
    for name in ("README.md", "docs/real-data.md"):
        assert said in (ROOT / name).read_text().replace("half right", "half"), name


def test_the_page_says_what_a_diagnosis_finds_that_is_told_the_names(figures):
    told, page = kept.told(), (ROOT / "docs" / "real-data.md").read_text()
    assert submit.text(told) == (RESULTS / f"{kept.TOLD}.json").read_text()
    judged = kept.judged(told, [CASES[name] for name in told])
    missed = [name for name, one in figures["cases"].items() if one["grade"] != RIGHT]
    right = sorted(name for name, one in judged.items() if one.grade == RIGHT)
    assert set(told) <= set(missed)
    assert f"Of the {len(missed)} cases that are not right {len(told)} were " in page
    assert f"and {len(right)} are right then: {', '.join(f'`{name}`' for name in right)}. " in page
    most = figures["summary"]["all"][RIGHT] + len(right)
    assert f"would have {most} of {len(CASES)}; the other {len(told) - len(right)}:" in page
    section = page[page.index("### What no search would find") : page.index("### Enter it")]
    assert all(f"`{name}`" in section for name in missed if not name.startswith("kuka"))
