"""The whole check, small: from a seed to scores, through the real command line, without a time budget."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import verdicts_again
from benchmarks.blind.__main__ import main as blind
from benchmarks.blind.score import Judged, classes
from tiago_mj.gap.decision import verdict

#: Grasps of 1 s at 240 Hz, three a case, and no pairs: a diagnosis costs what it simulates.
SMALL = ["--settings", "gripper", "--kinds", "none,one", "--rates", "240", "--trials", "3", "--seconds", "1.0"]
#: What is recommended in ambiguous cases is tested apart (test_followed_motion.py).
APART = ["--no-next-motion"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight cases of the gripper, diagnosed two at once."""
    out = tmp_path_factory.mktemp("blind") / "run"
    words = ["--cases", "8", "--seed", "12", *SMALL, "--out", str(out)]
    assert blind([*words, *APART, "--jobs", "1", "--at-once", "2", "--workers", "2"]) == 0
    return out


def judged(root: Path) -> list[Judged]:
    """Every case with its answer."""
    labels: dict[str, Any] = json.loads((root / "labels.json").read_text())
    answers = [root / "cases" / number / "diagnosis" / "diagnosis.json" for number in labels]
    assert all(path.exists() for path in answers), "every case was diagnosed, none refused"
    return [Judged(label, json.loads(path.read_text())) for label, path in zip(labels.values(), answers, strict=True)]


@pytest.mark.slow
def test_a_small_run_keeps_its_seal_and_is_right_in_most_cases_for_reasons_that_it_stored(finished: Path) -> None:
    """One test, so that the run is made once, whatever the number of test processes."""
    keeps_its_seal_and_answers_every_case(finished)
    explains_most_cases_rightly_and_invents_little(finished)
    verdicts_follow_from_the_evidence_that_was_stored(finished)


def keeps_its_seal_and_answers_every_case(finished: Path) -> None:
    sealed = (finished / "seal.txt").read_text().split()[0]
    assert hashlib.sha256((finished / "labels.json").read_bytes()).hexdigest() == sealed
    written = (finished / "seal.txt").stat().st_mtime_ns
    for number in range(8):
        diagnosis = finished / "cases" / f"{number:03d}" / "diagnosis" / "diagnosis.json"
        assert written < diagnosis.stat().st_mtime_ns, "sealed before the first diagnosis"
        assert (diagnosis.parent / "report.html").exists()
    scores = json.loads((finished / "scores.json").read_text())
    assert scores["failed"]["value"] == 0.0
    assert scores["seconds"]["n"] == 8
    assert "report.html" in (finished / "index.html").read_text()


def explains_most_cases_rightly_and_invents_little(finished: Path) -> None:
    cases = judged(finished)
    assert sum(j.kind == "none" for j in cases) >= 3
    assert sum(j.kind == "one" and j.detectable for j in cases) >= 3
    # The best explanation, even where so few and short recordings leave a doubt about it that the verdict says.
    explained = [classes((j.answer or {})["verdict"]["effects"]) for j in cases]
    assert (
        sum(
            said in ((), j.truth) if not j.detectable else said == j.truth
            for said, j in zip(explained, cases, strict=True)
        )
        > 4
    )
    invented = [j for j in cases if j.kind == "none" and j.verdict in ("effect", "ambiguous")]
    assert len(invented) <= 1


def verdicts_follow_from_the_evidence_that_was_stored(finished: Path) -> None:
    cases, run = verdicts_again.read(finished)
    assert len(cases) == 8
    assert run["seed"] == 12
    shipped = verdict.calibration()
    for one in cases:
        said, again = Judged(one.label, one.answer), verdicts_again.again(one, shipped)
        assert again.verdict == said.verdict
        assert again.best == said.best
        assert again.set == said.set
