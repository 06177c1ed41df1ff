"""The whole check, small: from a seed to scores, through the real command line."""

import hashlib
import json
from pathlib import Path

import pytest

from tiago_mj import cli


@pytest.mark.slow
def test_a_case_goes_from_seed_to_scores(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["blind", "--cases", "1", "--seed", "2", "--settings", "plain", "--kinds", "one", "--time-budget", "2"]
    assert cli.main([*words, "--out", str(tmp_path), "--jobs", "2"]) == 0
    said = capsys.readouterr().out
    sealed = (tmp_path / "seal.txt").read_text().split()[0]
    assert said.index(sealed) < said.index("case 000"), "printed before the first diagnosis"
    assert hashlib.sha256((tmp_path / "labels.json").read_bytes()).hexdigest() == sealed
    assert (tmp_path / "cases/000/diagnosis/report.html").exists(), "the case was diagnosed, not refused"
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert scores["failed"]["value"] == 0.0
    assert scores["seconds"]["n"] == 1
    assert "report.html" in (tmp_path / "index.html").read_text()
