"""Commands that are killed leave the old files or the new ones: the check of tests/long/faults.py, with few kills."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pyarrow", reason="needs the extra 'gap'")
SCRIPT = Path(__file__).parent / "long" / "faults.py"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="commands run in forks, and folders are exchanged by Linux")
def test_what_a_killed_command_leaves_is_old_or_new_and_going_on_gives_the_same_bits(tmp_path):
    out = tmp_path / "faults.json"
    words = [sys.executable, str(SCRIPT), "--kills", "3", "--commands", "record,import", "--out", str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    for found in json.loads(out.read_text())["results"].values():
        assert found["killed"]["kills"] == 3
        assert found["killed"]["wrong"] == []
        for name in ("full_drive", "read_only"):
            assert found[name].get("skipped") or found[name]["status"] == 2
        assert found["two_at_once"]["left"] == "new"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="commands run in forks, and folders are exchanged by Linux")
def test_a_diagnosis_killed_ten_times_goes_on_to_the_same_bits(tmp_path):
    out = tmp_path / "faults.json"
    words = [sys.executable, str(SCRIPT), "--kills", "10", "--commands", "diagnose", "--out", str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(out.read_text())["results"]["diagnose"]["killed"]
    assert found["kills"] == 10
    assert found["wrong"] == []
    assert found["same_bits"] == found["let_through"] > 0
