"""The wheel: built, installed into another environment, and run there, far from the checkout."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROGRAM = """
import gymnasium, json, numpy as np, tiago_mj
env = gymnasium.make("tiago_mj/TIAGoTactile-v0")
env.reset(seed=0)
observation, reward, *_ = env.step(np.zeros(10))
print(json.dumps({"file": tiago_mj.__file__, "finite": bool(np.isfinite(observation).all())}))
"""


@pytest.mark.slow
def test_an_installed_wheel_works_without_the_checkout(tmp_path):
    pytest.importorskip("hatchling", reason="needs the extra 'dev'")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path / "dist", ROOT]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    venv.create(tmp_path / "venv", with_pip=False)
    scripts = tmp_path / "venv" / "bin"
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        scripts / "python",
        "install",
        "-q",
        "--no-deps",
        "--no-index",
        wheel,
    ]
    subprocess.run(pip, check=True, capture_output=True)
    # The libraries of this environment, after its own: an editable install of this package is not among them.
    (packages,) = (tmp_path / "venv" / "lib").glob("python*/site-packages")
    (packages / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}

    def run(*words):
        done = subprocess.run(words, cwd=elsewhere, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        return json.loads(done.stdout)

    assert run(scripts / "tiago-mj", "doctor", "--json")["works"] is True
    stepped = run(scripts / "python", "-c", PROGRAM)
    assert stepped["finite"]
    assert Path(stepped["file"]).is_relative_to(tmp_path)
