"""A fault costs neither the answer nor its own traceback, and no other place takes it for something foreseen."""

import ast
import re
from pathlib import Path

import made_diagnoses
import pytest

from tiago_mj.gap import command, report
from tiago_mj.gap.faults import FAULT, FaultError
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
    assert "RuntimeError: no such robot" in paths[FAULT].read_text()


def test_the_numbers_are_written_where_the_page_cannot_be_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*given: object) -> None:
        raise ValueError("no such table")

    report.write(made_diagnoses.diagnosis(), tmp_path)
    monkeypatch.setattr(report.html, "render", failing)
    paths = report.write(made_diagnoses.diagnosis(), tmp_path)
    assert set(paths) == {"diagnosis.json", "calibration.yaml", FAULT} == {path.name for path in tmp_path.iterdir()}
    assert "ValueError: no such table" in paths[FAULT].read_text()


#: Where whatever was raised may be caught: the one place that keeps the answer, and one folder among many.
BROAD = {"faults.py", "diagnose_all.py"}


def test_what_nobody_foresaw_is_caught_in_one_place() -> None:
    room = Path(command.__file__).parent
    catching = set()
    for path in room.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ExceptHandler):
                caught = "BaseException" if node.type is None else ast.unparse(node.type)
                if re.search(r"\b(Base)?Exception\b", caught):
                    catching.add(path.relative_to(room).as_posix())
    assert catching == BROAD
