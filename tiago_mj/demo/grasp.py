"""The demonstration's grasp: the PI force controller on the gripper, with a film."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import gymnasium
import numpy as np

from tiago_mj.control.force_pi import ForcePI
from tiago_mj.rollout import Episode, Trace, play, summarise
from tiago_mj.view.film import Film

ENV: Final = "tiago_mj/GripperTactile-v0"
#: Width and height of a frame [pixel].
FRAME: Final = (480, 304)


@dataclass(frozen=True)
class Grasp:
    """Result of the grasp.

    Attributes:
        trace: every step.
        episode: in a line.
        newtons_per_unit: newtons in a sensor unit.
        film: frames; None where nothing could be rendered.
        no_film: why not, and what to do; empty where there is a film.
    """

    trace: Trace
    episode: Episode
    newtons_per_unit: float
    film: Film | None
    no_film: str


def grasp(*, seed: int) -> Grasp:
    """Grasp and hold with the paper's goal force; film it where rendering works, go on without where it does not."""
    width, height = FRAME
    env = gymnasium.make(ENV, render_mode="rgb_array", width=width, height=height)
    core: Any = env.unwrapped
    try:
        film, no_film = _try_film(env)
        trace = play(env, ForcePI.for_env(env), seed=seed, watch=film)
        newtons = 1 / core.load_cell.units(1.0)
    finally:
        env.close()
    return Grasp(trace, summarise(trace, seed), newtons, film, no_film)


def _try_film(env: gymnasium.Env[Any, Any]) -> tuple[Film | None, str]:
    """A film if a frame can be rendered, else the reason."""
    core: Any = env.unwrapped

    def caption(time: float) -> str:
        right, left = np.round(core.state.force_raw, 2) + 0.0  # no "-0.00"
        return f"t {time:.2f} s    right {right:5.2f}    left {left:5.2f}    goal {core.goal[0]:.2f}"

    film = Film(env, caption)
    try:
        film.check()
    except gymnasium.error.DependencyNotInstalled as fault:
        return None, str(fault)
    return film, ""
