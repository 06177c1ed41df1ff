"""Pictures of the environments, rendered: one of each id, after a few steps, and a film of an episode."""

from __future__ import annotations

from pathlib import Path

import tiago_mj  # noqa: F401  (chooses the headless renderer before mujoco is imported)

import gymnasium  # isort: skip
import imageio.v3 as iio
import mujoco
import numpy as np

from tiago_mj.control.force_pi import ForcePI
from tiago_mj.control.scripted import Scripted
from tiago_mj.rollout.episode import play
from tiago_mj.view.film import Film

WIDTH, HEIGHT = 640, 480
#: Control steps before the picture.
STEPS = {"Close": 90, "Tactile": 130, "PALGripper": 130}
#: Parts of the names of tasks whose goal is a place.
TO_PLACES = ("Reach", "Push", "PickAndPlace")
#: Frames of a film, and its size [pixel].
FRAMES = 32
SMALL = {"width": 480, "height": 360}


class Closing:
    """A policy for what has no load cells: the fingers close."""

    def __init__(self, env: gymnasium.Env) -> None:
        self._action = np.zeros(env.action_space.shape)
        self._action[-2:] = -1

    def reset(self) -> None:
        """Nothing is remembered."""

    def __call__(self, observation: object, info: object) -> np.ndarray:
        """The same action always."""
        return self._action


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
    fetch_like = any(task in name for task in TO_PLACES)
    steps = 3 if fetch_like else next((count for part, count in STEPS.items() if part in name), 60)
    for _ in range(steps):
        env.step(action)
    frame = env.render().reshape(HEIGHT, 2, WIDTH, 2, 3).mean(axis=(1, 3)).astype(np.uint8)  # antialiased by halving
    env.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    iio.imwrite(path, frame, optimize=True)


def film(name: str, path: Path) -> None:
    """Film an episode with the controller that comes with the task, and write it.

    Args:
        name: of the environment, without its namespace.
        path: of the animated WebP.
    """
    env = gymnasium.make(f"tiago_mj/{name}", render_mode="rgb_array", **SMALL)
    taken = Film(env)
    if any(task in name for task in TO_PLACES):
        policy = Scripted.for_env(env)
    elif "Tactile" in name and "Steady" not in name:
        policy = ForcePI.for_env(env)
    else:
        policy = Closing(env)
    play(env, policy, seed=3, watch=taken)
    every = max(1, -(-len(taken.snapshots) // FRAMES))
    taken.snapshots[:] = taken.snapshots[::every]
    frames = taken.draw()
    env.close()
    iio.imwrite(path, frames, extension=".webp", duration=round(1000 * every / taken.fps), loop=0, quality=60)
