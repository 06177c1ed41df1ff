"""Frames without a display, and what is said where there can be none."""

import gc
import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401
from tiago_mj.envs import checks
from tiago_mj.view import headless


def render_in_a_process(mode, **environment):
    """Run a fresh interpreter, as OpenGL is chosen when mujoco is imported; its last line of error output."""
    code = f"import tiago_mj, gymnasium; e = gymnasium.make('tiago_mj/GripperTactile-v0', render_mode='{mode}'); "
    code += "e.reset(); print(e.render().std() if e.render_mode != 'human' else e.render())"
    clean = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.run(
        [sys.executable, "-c", code], env={**clean, **environment}, capture_output=True, text=True, check=False
    )


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("name", ["GripperTactile-v0", "TIAGoTactile-v0"])
def test_a_frame_shows_the_scene_and_changes_when_the_robot_moves(name):
    env = gymnasium.make(f"tiago_mj/{name}", render_mode="rgb_array", width=160, height=120)
    env.reset(seed=0)
    first = env.render()
    assert first.shape == (120, 160, 3)
    assert first.dtype == np.uint8
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 100
    for _ in range(60):
        env.step(-np.ones(env.action_space.shape))
    assert (env.render() != first).any(axis=-1).mean() > 0.002
    env.close()


@pytest.mark.usefixtures("opengl")
def test_an_environment_still_renders_when_another_was_closed():
    one, other = (gymnasium.make("tiago_mj/GripperTactile-v0", render_mode="rgb_array", width=64) for _ in range(2))
    for env in (one, other):
        env.reset(seed=0)
        first = env.render()
    other.close()
    np.testing.assert_array_equal(one.render(), first)
    one.close()


@pytest.mark.usefixtures("opengl")
def test_an_environment_still_renders_when_another_was_forgotten_without_being_closed():
    one, other = (gymnasium.make("tiago_mj/GripperTactile-v0", render_mode="rgb_array", width=64) for _ in range(2))
    for env in (one, other, one):  # the last one's context stays current
        env.reset(seed=0)
        first = env.render()
    del env, other
    gc.collect()
    np.testing.assert_array_equal(one.render(), first)
    one.close()


@pytest.mark.usefixtures("opengl")
def test_a_depth_image_is_nearer_at_the_object_than_at_the_floor():
    env = gymnasium.make("tiago_mj/GripperTactile-v0", render_mode="depth_array", width=160, height=120)
    env.reset(seed=0)
    depth = env.render()
    assert depth.shape == (120, 160)
    assert depth.dtype == np.float32
    assert depth[60, 80] < depth[2, 2]
    env.close()


@pytest.mark.usefixtures("opengl")
@pytest.mark.skipif(sys.platform != "linux", reason="EGL is chosen on Linux only")
def test_without_a_display_egl_is_chosen():
    done = render_in_a_process("rgb_array")
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.splitlines()[-1]) > 1


@pytest.mark.usefixtures("opengl")
def test_an_optimiser_is_made_after_a_frame_was_rendered():
    """With Mesa and the Triton that torch brings, one process: each has an LLVM of its own."""
    code = "import tiago_mj, gymnasium; e = gymnasium.make('tiago_mj/GripperTactile-v0', render_mode='rgb_array'); "
    code += "e.reset(); e.render(); import torch; torch.optim.Adam([torch.zeros(1, requires_grad=True)]).step()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-500:]


def test_tritons_library_is_loaded_where_it_is_installed_on_linux(tmp_path, monkeypatch):
    (tmp_path / "triton").mkdir()
    (tmp_path / "triton" / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "triton", raising=False)
    loaded = []
    monkeypatch.setattr(headless.ctypes, "CDLL", loaded.append)
    headless.load_triton_before_mesa("darwin")
    assert loaded == []
    headless.load_triton_before_mesa("linux")
    assert loaded == [str(tmp_path / "triton" / "_C" / "libtriton.so")]


def test_a_library_of_triton_that_cannot_be_loaded_is_left(tmp_path, monkeypatch):
    (tmp_path / "triton").mkdir()
    (tmp_path / "triton" / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "triton", raising=False)
    headless.load_triton_before_mesa("linux")
    assert "triton" not in sys.modules


@pytest.mark.skipif(sys.platform != "linux", reason="about Linux without a display")
@pytest.mark.parametrize(
    ("mode", "environment", "says"),
    [
        ("rgb_array", {"MUJOCO_GL": "glfw"}, "MUJOCO_GL=egl"),
        ("rgb_array", {"MUJOCO_GL": "vulkan"}, "MUJOCO_GL=vulkan is set, which MuJoCo does not know"),
        ("human", {}, "render_mode='rgb_array'"),
    ],
)
def test_where_nothing_can_be_rendered_the_error_says_what_to_set(mode, environment, says):
    done = render_in_a_process(mode, **environment)
    assert done.returncode == 1  # an exception, not an aborted process
    assert any(says in line and "DependencyNotInstalled" in line for line in done.stderr.splitlines())


def test_a_backend_that_is_not_installed_is_said_when_something_is_rendered(monkeypatch):
    monkeypatch.delitem(sys.modules, "mujoco")
    monkeypatch.setattr(headless, "complaints", [])
    monkeypatch.setattr(headless, "LIBRARIES", {"osmesa": (("libOfNobody.so",), "Debian: libosmesa6")})
    environment = {"MUJOCO_GL": "osmesa"}
    headless.choose_gl(environment, "linux")
    assert environment == {"MUJOCO_GL": "disabled"}  # with "osmesa" mujoco could not be imported
    said = checks.cause_of(RuntimeError("None has no attribute\nglGetError"))
    assert said == "MUJOCO_GL=osmesa is set, but its library is not installed (Debian: libosmesa6)"
