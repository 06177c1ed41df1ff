"""The tutorials' code runs from top to bottom, as their readers run it."""

import subprocess
import sys
from pathlib import Path

import pytest

from docs.site import runner

ROOT = Path(__file__).parents[2]
TUTORIALS = sorted(path for path in (ROOT / "docs" / "tutorials").glob("*.md") if path.stem != "index")
FAST = ("first-grasp", "your-own-task")


def run(path):
    done = subprocess.run(
        [sys.executable, "-m", "docs.site.runner", path], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-1500:] + done.stderr[-1500:]


@pytest.mark.parametrize("name", FAST)
def test_a_short_tutorial_runs(name):
    run(ROOT / "docs" / "tutorials" / f"{name}.md")


@pytest.mark.slow
@pytest.mark.parametrize("path", [path for path in TUTORIALS if path.stem not in FAST], ids=lambda path: path.stem)
def test_a_long_tutorial_runs(path):
    run(path)


@pytest.mark.slow
def test_the_notebook_runs():
    done = subprocess.run(
        [sys.executable, ROOT / "docs" / "notebooks" / "grasp_and_diagnose.py"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert "coulomb_friction" in done.stdout


def test_a_page_is_run_in_its_order_and_what_is_not_run_is_left_out():
    page = "<!-- check\nassert a\n-->\n\n```python\na = 1\n```\n\n<!-- not run: slow -->\n```sh\nfalse\n```\n\n"
    page += '```yaml title="a.yaml"\nb: 1\n```\n\n```text\nout\n```\n\n```sh\ntrue\n```\n'
    found = [(step.kind, step.text.strip(), step.name) for step in runner.steps(page)]
    assert found == [
        ("python", "assert a", ""),
        ("python", "a = 1", ""),
        ("file", "b: 1", "a.yaml"),
        ("sh", "true", ""),
    ]


def test_a_page_that_fails_says_so_with_its_line(tmp_path):
    page = tmp_path / "bad.md"
    page.write_text("# Bad\n\n```python\nx = 1\nraise RuntimeError('so')\n```\n")
    done = subprocess.run(
        [sys.executable, "-m", "docs.site.runner", page], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert 'bad.md", line 5' in done.stderr
