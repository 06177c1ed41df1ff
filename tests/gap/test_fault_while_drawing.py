"""A fault while the robots are drawn costs neither the answer nor its own traceback."""

from pathlib import Path

import made_diagnoses
import pytest

from tiago_mj.gap import command, report
from tiago_mj.gap.faults import FaultError
from tiago_mj.io.deadline import Deadline
from tiago_mj.view import beside


def test_the_answer_is_written_with_the_traceback_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*given: object) -> None:
        raise RuntimeError("no such robot")

    monkeypatch.setattr(beside, "pictures", failing)
    with pytest.raises(FaultError, match="RuntimeError: no such robot") as met:
        command._pictures(None, (), found := made_diagnoses.diagnosis(), Deadline(), 0.0)  # type: ignore[arg-type]
    assert met.value.answer is found
    paths = report.write(met.value.answer, tmp_path, fault=met.value.fault)
    assert paths["diagnosis.json"].is_file()
    assert "RuntimeError: no such robot" in paths[report.FAULT].read_text()
