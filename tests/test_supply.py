"""The lock file, which installs with hashes, and the constraints are of the same packages."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: What torch's own build for Linux brings along, and an interpreter that the tests do not run on: locked, not pinned.
OF_TORCH = re.compile(r"nvidia-|cuda-|triton$")


def name_of(text):
    return re.sub(r"[-_.]+", "-", text).lower()


@pytest.fixture(scope="module")
def pinned():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    return {name_of(name): version for name, _, version in (line.partition("==") for line in lines) if version}


@pytest.fixture(scope="module")
def locked():
    """Version, marker and hashes by name."""
    text = (ROOT / "requirements.lock").read_text().replace("\\\n", " ")
    rows = [re.fullmatch(r"([\w.\-]+)(?:\[[^]]*\])?==(\S+)\s*(;.*?)?((?:\s+--hash=sha256:[0-9a-f]{64})+)\s*", line)
            for line in text.splitlines() if line.strip() and not line.startswith("#")]  # fmt: skip
    assert all(rows), "a line that is no package with hashes"
    return {name_of(row[1]): (row[2], row[3] or "", row[4].split()) for row in rows}


def test_every_constraint_is_locked_in_its_version(pinned, locked):
    assert {name: locked[name][0] if name in locked else None for name in pinned} == pinned


def test_every_locked_package_is_pinned(pinned, locked):
    further = {name for name, (_, marker, _) in locked.items() if name not in pinned and "pypy" not in marker}
    assert {name for name in further if not OF_TORCH.match(name)} <= {"pip", "setuptools"}


def test_the_lock_names_no_host_and_no_path():
    text = (ROOT / "requirements.lock").read_text()
    assert not re.search(r"://|file:| @ |--\S*index|--find|\s/", text)


@pytest.mark.skipif(shutil.which("bash") is None, reason="the check is a shell script")
def test_the_audit_says_what_it_needs_and_does_not_pass_for_a_finding(tmp_path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\nexit 1\n")  # as where the modules are missing
    python.chmod(0o755)
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    words = [str(ROOT / ".ci" / "audit"), str(tmp_path / "sbom.json")]
    done = subprocess.run(words, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False)
    assert done.returncode == 2  # 1: something is known against a package
    assert "needs the extra supply" in done.stderr
    assert done.stderr.count("\n") == 1
