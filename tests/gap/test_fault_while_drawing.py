"""A fault while the robots are drawn costs neither the answer nor its own traceback."""

from pathlib import Path

import made_diagnoses
import pytest

from tiago_mj.gap import command, report
from tiago_mj.io.deadline import Deadline
from tiago_mj.view import beside


def test_the_answer_is_written_with_the_traceback_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(*given: object) -> None:
        raise RuntimeError("no such robot")

    monkeypatch.setattr(beside, "pictures", failing)
    found, seen, fault = command._pictures(None, (), made_diagnoses.diagnosis(), Deadline(), 0.0)  # type: ignore[arg-type]
    assert seen is None
    assert "the robots could not be drawn: no such robot" in capsys.readouterr().err
    paths = report.write(found, tmp_path, seen, fault)
    assert paths["diagnosis.json"].is_file()
    assert "RuntimeError: no such robot" in paths[report.FAULT].read_text()
