"""The command that times training runs, and saves what it timed."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra 'train'")

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.slow  # of a benchmark; what it times, test_updates.py compares
def test_updates_are_timed_and_saved(tmp_path):
    (tmp_path / "results").mkdir()
    for name in ("training_speed.py", "machine.py"):
        shutil.copy(BENCHMARKS / name, tmp_path)
    command = [sys.executable, "training_speed.py", "--rounds", "1", "--only", "update", "--updates", "10"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads((tmp_path / "results" / "training_speed.json").read_text())
    rows = found["results"]["rows"]
    assert [(row["updates"], row["adam"], row["batch"]) for row in rows[::7]] == [
        ("sb3", "plain", 100), ("ours", "fused", 256)
    ]  # fmt: skip
    assert all(row["ms"] > 0 for row in rows)
    assert done.stdout.count(" ms ") == len(rows) == 8
