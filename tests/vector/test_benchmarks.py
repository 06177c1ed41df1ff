"""The commands that make the figures of docs/speed.md run, and their tables hold what was measured."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("pyperf")

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def copy(tmp_path):
    """The scripts with an empty folder of results, so that no measured figure is overwritten."""
    shutil.copytree(
        BENCHMARKS, tmp_path / "benchmarks", ignore=shutil.ignore_patterns("results", "blind", "__pycache__")
    )
    return tmp_path


def run(root, script, *words):
    command = [sys.executable, f"benchmarks/{script}", *words]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_rates_are_measured_saved_and_written_into_the_pages(copy):
    run(copy, "steps_per_second.py", "--rounds", "1", "--num-envs", "2", "--threads", "1", "TIAGoReach-v0")
    run(copy, "scaling.py", "--rounds", "1", "--num-envs", "2", "--threads", "1", "2", "--", "TIAGoReach-v0")
    found = json.loads((copy / "benchmarks/results/steps_per_second.json").read_text())
    assert found["machine"]["mujoco"]
    row = found["results"]["TIAGoReach-v0"]
    for load in ("random", "grasp"):
        figures = row["loads"][load]
        rates = [value for key, value in figures.items() if key.endswith("per_second")]
        assert len(rates) == 3
        assert min(rates) > 10  # of 25 Hz: slower than real time would be a fault, on any machine
        assert figures["vector_share_of_limit"] > 0
        assert 0 < figures["reset_ms"] < 1000
    assert 10 < row["scalar_mb"] < 1000
    assert (copy / "benchmarks/results/steps_per_second.pyperf.json").exists()
    (copy / "docs").mkdir()
    before, after = "before\n<!-- speed: steps_per_second -->\nold\n<!-- speed: end -->\n", "after\n"
    (copy / "docs/speed.md").write_text(f"{before}<!-- speed: scaling -->\n<!-- speed: end -->\n{after}")
    run(copy, "speed_tables.py")
    page = (copy / "docs/speed.md").read_text()
    assert page.startswith("before\n")
    assert page.endswith("\nafter\n")
    assert "old" not in page
    assert f"{row['loads']['grasp']['scalar_steps_per_second']:,.0f}" in page
    assert "| simulations | 1 thread | 2 threads |" in page


def test_every_table_of_the_pages_has_a_benchmark():
    text = (BENCHMARKS.parent / "docs/speed.md").read_text(encoding="utf-8")
    for name in ("steps_per_second", "scaling", "peers"):
        assert f"<!-- speed: {name} -->" in text
        assert (BENCHMARKS / f"{name}.py").exists()
