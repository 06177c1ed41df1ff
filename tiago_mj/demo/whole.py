"""TIAGo as a whole: the same grasp by torso, arm and fingers, as a strip of pictures."""

from __future__ import annotations

from typing import Any, Final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj.control.force_pi import ForcePI
from tiago_mj.envs.flat import core_of
from tiago_mj.rollout import Trace, play
from tiago_mj.view import drawing
from tiago_mj.view.film import strip_indices

Frame = NDArray[np.uint8]

ENV: Final = "tiago_mj/TIAGoTactile-v0"
FRAME: Final = (320, 200)
PICTURES: Final = 4
CAMERA: Final = drawing.Camera((0.45, 0.0, 0.70), 1.7, 130, -18)


def whole(*, seed: int, pictures: bool = True) -> tuple[Trace, list[Frame]]:
    """Trace of the grasp, and its pictures if wanted: first the whole robot, then its hand."""
    env = gymnasium.make(ENV)
    core: Any = core_of(env)
    taken: list[drawing.Snapshot] = []
    try:
        trace = play(env, ForcePI.for_env(env), seed=seed, watch=lambda step: taken.append(drawing.snapshot(core)))
        if not pictures:
            return trace, []
        chosen = [taken[k] for k in strip_indices(len(taken), PICTURES - 1)]
        frames: list[Frame] = []
        for some, camera in ((chosen[:1], CAMERA), (chosen, drawing.AT_THE_HAND)):
            frames += drawing.draw(core.model, some, size=FRAME, camera=camera)
    finally:
        env.close()
    return trace, frames
