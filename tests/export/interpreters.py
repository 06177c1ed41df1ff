"""Python interpreters that have a target's real package, for slow tests: named by the environment, or made with pip.

``TIAGO_MJ_VENV_MUJOCO_3_11=/path/to/venv`` names a virtual environment; without it one is made among the temporary
files, once. ``mjlab`` has to be named: it needs gigabytes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

PACKAGES = {
    "mujoco_3_11": ("mujoco==3.11.*", "numpy"),
    "mujoco_3_17": ("mujoco==3.17.*", "mujoco-mjx==3.17.*", "jax"),
    "newton": ("newton==1.8.*", "usd-core", "newton-usd-schemas", "mujoco==3.17.*"),
    "mjlab": (),
}
SECONDS = 900


def interpreter(name: str) -> Path:
    """The interpreter of an environment; the test is skipped where there is none."""
    said = os.environ.get(f"TIAGO_MJ_VENV_{name.upper()}")
    folder = Path(said) if said else Path(tempfile.gettempdir()) / "tiago_mj_venvs" / name
    python = folder / "bin" / "python"
    if said or (folder / "complete").is_file():
        return python
    if not PACKAGES[name]:
        pytest.skip(f"set TIAGO_MJ_VENV_{name.upper()} to a virtual environment with {name}")
    try:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True, timeout=SECONDS, capture_output=True)
        install = [python, "-m", "pip", "install", "-q", *PACKAGES[name]]
        subprocess.run(install, check=True, timeout=SECONDS, capture_output=True)
    except (OSError, subprocess.SubprocessError) as fault:
        pytest.skip(f"{name} does not install here: {type(fault).__name__}")
    (folder / "complete").touch()
    return python


def run(python: Path, *words: object) -> str:
    """What a script prints in another interpreter, which sees nothing of this one's packages."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [python, *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        timeout=SECONDS,
        env={**environment, "JAX_PLATFORMS": "cpu"},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout
