"""The GPU's benchmark: one line where there is nothing to measure it with, and worlds that do what the CPU does."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def copy(tmp_path):
    """The script with an empty folder of results, so that no measured figure is overwritten."""
    (tmp_path / "benchmarks").mkdir()
    for name in ("warp.py", "machine.py"):
        shutil.copy(BENCHMARKS / name, tmp_path / "benchmarks" / name)
    return tmp_path


def run(root, *words, **environment):
    command = [sys.executable, "benchmarks/warp.py", *words]
    done = subprocess.run(
        command, cwd=root, capture_output=True, text=True, check=False, env={**os.environ, **environment}
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert not (root / "benchmarks/results").exists(), "without a GPU there is no figure to save"
    return done


def test_without_the_package_it_says_so_and_is_content(copy):
    (copy / "absent").mkdir()
    absent = "raise ModuleNotFoundError('No module named mujoco_warp', name='mujoco_warp')\n"
    (copy / "absent/mujoco_warp.py").write_text(absent)
    done = run(copy, PYTHONPATH=str(copy / "absent"))
    said = "MuJoCo Warp is not measured: mujoco_warp is not installed: pip install mujoco-warp\n"
    assert (done.stdout, done.stderr) == (said, "")


@pytest.mark.skipif(find_spec("mujoco_warp") is None, reason="needs the extra 'warp'")
def test_without_a_gpu_it_says_so_and_is_content(copy):
    done = run(copy, CUDA_VISIBLE_DEVICES="")
    said = "MuJoCo Warp is not measured: no GPU that CUDA can use is at hand\n"
    assert (done.stdout, done.stderr) == (said, "")


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mujoco_warp") is None, reason="needs the extra 'warp'")
def test_worlds_follow_the_cpu(copy):
    said = run(copy, "--device", "cpu", "--worlds", "4", CUDA_VISIBLE_DEVICES="").stdout
    rms = float(re.search(r"MuJoCo Warp: force rms ([\d.]+)%", said).group(1))
    assert 0 < rms < 5  # % of the peak; single precision alone gives 0.4
    assert "0 diverged" in said
