"""Pictures of the environments, rendered: one of each id, after a few steps."""

from __future__ import annotations

from pathlib import Path

import tiago_mj  # noqa: F401  (chooses the headless renderer before mujoco is imported)

import gymnasium  # isort: skip
import imageio.v3 as iio
import mujoco
import numpy as np

WIDTH, HEIGHT = 640, 480
#: Control steps before the picture.
STEPS = {"Close": 90, "Tactile": 130, "PALGripper": 130}


def possible() -> str:
    """Why nothing can be rendered here; empty where it can."""
    try:
        mujoco.GLContext(64, 64).free()
    except Exception as fault:  # whatever a driver raises
        return " ".join(str(fault).split()) or type(fault).__name__
    return ""


def draw(name: str, path: Path) -> None:
    """Render an environment with fingers that have closed, and write it.

    Args:
        name: of the environment, without its namespace.
        path: of the PNG.
    """
    env = gymnasium.make(f"tiago_mj/{name}", render_mode="rgb_array", width=2 * WIDTH, height=2 * HEIGHT)
    env.reset(seed=3)
    action = np.zeros(env.action_space.shape)
    action[-2:] = -1
    fetch_like = any(task in name for task in ("Reach", "Push", "PickAndPlace"))
    steps = 3 if fetch_like else next((count for part, count in STEPS.items() if part in name), 60)
    for _ in range(steps):
        env.step(action)
    frame = env.render().reshape(HEIGHT, 2, WIDTH, 2, 3).mean(axis=(1, 3)).astype(np.uint8)  # antialiased by halving
    env.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    iio.imwrite(path, frame, optimize=True)
