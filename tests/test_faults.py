"""Commands that are killed leave the old files or the new ones: the check of tests/long/faults.py, with few kills."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pyarrow", reason="needs the extra 'gap'")
SCRIPT = Path(__file__).parent / "long" / "faults.py"


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="commands run in forks, and folders are exchanged by Linux"),
]


def killed(folder: Path, commands: str, kills: int) -> dict[str, Any]:
    """What the check says of each command."""
    out = folder / "faults.json"
    words = [sys.executable, str(SCRIPT), "--kills", str(kills), "--commands", commands, "--out", str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    results: dict[str, Any] = json.loads(out.read_text())["results"]
    return results


def test_what_a_killed_command_leaves_is_old_or_new_and_going_on_gives_the_same_bits(tmp_path):
    for found in killed(tmp_path, "record,import", 3).values():
        assert found["killed"]["kills"] == 3
        assert found["killed"]["wrong"] == []
        for name in ("full_drive", "read_only"):
            assert found[name].get("skipped") or found[name]["status"] == 2
        assert found["two_at_once"]["left"] == "new"


def test_a_diagnosis_killed_ten_times_goes_on_to_the_same_bits(tmp_path):
    found = killed(tmp_path, "diagnose", 10)["diagnose"]["killed"]
    assert found["kills"] == 10
    assert found["wrong"] == []
    assert found["same_bits"] == found["let_through"] > 0
