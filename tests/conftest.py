"""Shared by every test: rendering without a display, and what is left out where nothing can be rendered."""

import os
import sys

import pytest

if sys.platform == "linux" and "DISPLAY" not in os.environ:
    os.environ.setdefault("MUJOCO_GL", "egl")
if "PYTEST_XDIST_WORKER" in os.environ:  # workers share the processors: more threads of each only get in the way
    os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Tests go to the workers in long runs of one file, whose fixtures are then made once; who is done takes over."""
    if config.getoption("dist") != "load":  # asked for otherwise
        return None
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


@pytest.fixture(scope="session")
def opengl():
    """Skips what needs pictures where the machine can make none; MuJoCo itself is asked, not this package."""
    import mujoco

    try:
        context = mujoco.GLContext(64, 64)
    except Exception as fault:
        pytest.skip(f"no OpenGL here: {fault}")
    context.free()
