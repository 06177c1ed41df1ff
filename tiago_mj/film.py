"""Films of an environment: mp4 or gif, or a filmstrip as png; the file's suffix says which."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj import atomic
from tiago_mj.progress import Progress

Frame = NDArray[np.uint8]

SUFFIXES: Final = (".mp4", ".gif", ".png")
#: Frames per second that are aimed at, and pictures of a filmstrip.
FPS: Final = 30.0
STRIP_FRAMES: Final = 6
#: A grasp takes a third of a second: where steps are short enough for it, films run this many times slower than life.
SLOW_MOTION: Final = 4


def check_suffix(path: Path) -> None:
    """Refuse a file name that says no known format.

    Raises:
        ValueError: names the formats.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"film {path.name!r} has no known suffix: use one of {', '.join(SUFFIXES)}")


class Film:
    """Takes frames of an environment as it is stepped.

    Args:
        env: made with ``render_mode="rgb_array"``.
        caption: text for a frame, or None; called when a frame is taken.

    Attributes:
        env: that is filmed.
        frames: each (height, width, 3).
        times: when each was taken, from the start of its episode [s].
        fps: at which they play.
        slow_motion: how many times slower than life that is.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], caption: Callable[[float], str] | None = None) -> None:
        core: Any = env.unwrapped
        self.env, self._dt, self._caption = env, float(core.dt), caption
        self.slow_motion = SLOW_MOTION if 1 / self._dt >= SLOW_MOTION * FPS else 1
        self._every = max(1, round(1 / (self._dt * FPS * self.slow_motion)))
        self.fps = 1 / (self._dt * self._every * self.slow_motion)
        self.frames: list[Frame] = []
        self.times: list[float] = []

    def __call__(self, step: int) -> None:
        """Take a frame if one is due after control step ``step`` (0 is the reset)."""
        if step % self._every == 0:
            frame = np.asarray(self.env.render(), dtype=np.uint8)
            self.times.append(step * self._dt)
            self.frames.append(frame if self._caption is None else captioned(frame, self._caption(self.times[-1])))

    def due(self, steps: int) -> int:
        """Frames of an episode of so many control steps."""
        return steps // self._every + 1

    def write(self, path: Path) -> None:
        """Write what was filmed, whole; a png holds :data:`STRIP_FRAMES` frames of the first episode."""
        check_suffix(path)
        imageio: Any = importlib.import_module("imageio.v2")
        suffix = path.suffix.lower()
        with atomic.replacing(path) as temporary:
            if suffix == ".png":
                imageio.imwrite(temporary, side_by_side(self.frames[: self._first_episode()]))
            elif suffix == ".gif":
                imageio.mimwrite(temporary, self.frames, duration=1000 / self.fps, loop=0)
            else:
                imageio.mimwrite(temporary, self.frames, fps=self.fps, quality=6)

    def _first_episode(self) -> int:
        restarts = [i for i, time in enumerate(self.times) if i and time == 0.0]
        return restarts[0] if restarts else len(self.times)


class Shoot:
    """Films episodes, and tells how far it is.

    Args:
        film: takes the frames.
        progress: is told.
        episodes: how many will be filmed, of the environment's time limit.
    """

    def __init__(self, film: Film, progress: Progress, episodes: int) -> None:
        spec = film.env.spec
        limit = None if spec is None else spec.max_episode_steps
        self._film, self._progress, self._episodes, self._played = film, progress, episodes, 0
        progress.stage("drawing frames", None if limit is None else episodes * film.due(limit))

    def __call__(self, step: int) -> None:
        """As :class:`Film`."""
        self._film(step)
        self._played += step == 0
        self._progress.at(len(self._film.frames), f"episode {self._played} of {self._episodes}")


def strip_indices(count: int, wanted: int = STRIP_FRAMES) -> list[int]:
    """Evenly spaced indices, first and last included."""
    return sorted({round(i) for i in np.linspace(0, count - 1, min(wanted, count))})


def side_by_side(frames: list[Frame]) -> Frame:
    """A filmstrip: evenly spaced frames in a row, (height, n · width, 3)."""
    return np.concatenate([frames[i] for i in strip_indices(len(frames))], axis=1)


def captioned(frame: Frame, text: str) -> Frame:
    """The frame with a line of text in its upper left corner."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(frame)
    size = max(12, frame.shape[0] // 26)
    margin = size // 2
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(size)
    draw.rectangle((0, 0, frame.shape[1], size + 2 * margin), fill=(20, 24, 30))
    draw.text((margin, margin - 1), text, fill=(240, 242, 245), font=font)
    return np.asarray(image)
