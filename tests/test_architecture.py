"""The house keeps its rooms: the layers that ``pyproject.toml`` declares, and effects known by their declarations."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import house
from tiago_mj.effects import EFFECTS

ROOT = Path(__file__).parents[1]


@pytest.mark.skipif(not (ROOT / "pyproject.toml").is_file(), reason="the contracts are those of a checkout")
def test_imports_keep_to_the_layers():
    tool = Path(sys.executable).parent / "lint-imports"
    run = subprocess.run([tool, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout


def test_no_module_but_the_declarations_the_demo_and_the_exports_tables_holds_an_effects_name():
    assert house.names_in_code(house.effect_names()) == {}


def test_a_name_in_code_is_counted(tmp_path, monkeypatch):
    (tmp_path / "rule.py").write_text(
        '"""Of backlash."""\nif effect == "backlash" or effect in {"payload": 1}:\n    pass\n'
    )
    (tmp_path / "registration.py").write_text('ARGUMENTS = {"object_offset": 0.1}\n')
    monkeypatch.setattr(house, "PACKAGE", tmp_path)
    assert house.names_in_code(frozenset({"backlash", "payload", "object_offset"})) == {"rule.py": 2}


def test_the_house_counts_the_effects_that_are_declared():
    assert house.effect_names() == {name for name, one in EFFECTS.items() if one.__module__.startswith("tiago_mj.")}
