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


#: Rooms that still hold names of effects in code, and how many: what is left of the path for efforts.
STILL_NAMED = {"gap/torque/": 15}


def test_no_module_but_the_declarations_and_the_demo_holds_an_effects_name():
    found = house.names_in_code(house.effect_names())
    left = {room: sum(n for module, n in found.items() if module.startswith(room)) for room in STILL_NAMED}
    assert {module for module in found if not module.startswith(tuple(STILL_NAMED))} == set()
    assert all(left[room] <= most for room, most in STILL_NAMED.items()), left


def test_a_name_in_code_is_counted(tmp_path, monkeypatch):
    (tmp_path / "rule.py").write_text(
        '"""Of backlash."""\nif effect == "backlash" or effect in {"payload": 1}:\n    pass\n'
    )
    (tmp_path / "registration.py").write_text('ARGUMENTS = {"object_offset": 0.1}\n')
    monkeypatch.setattr(house, "PACKAGE", tmp_path)
    assert house.names_in_code(frozenset({"backlash", "payload", "object_offset"})) == {"rule.py": 2}


def test_the_house_counts_the_effects_that_are_declared():
    assert house.effect_names() == {name for name, one in EFFECTS.items() if one.__module__.startswith("tiago_mj.")}
