"""Films of an environment: mp4 or gif, or a filmstrip as png; the file's suffix says which."""

from __future__ import annotations

import importlib
import tempfile
from argparse import ArgumentTypeError
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj.envs import checks
from tiago_mj.envs.flat import core_of
from tiago_mj.io import atomic, extra, outputs
from tiago_mj.io.quoting import one_line
from tiago_mj.view import drawing

Frame = NDArray[np.uint8]

SUFFIXES: Final = (".mp4", ".gif", ".png")
#: Frames per second that are aimed at, and pictures of a filmstrip.
FPS: Final = 20.0
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


def film_file(text: str) -> Path:
    """The file of a film, as the type of an ``argparse`` option.

    Raises:
        argparse.ArgumentTypeError: no film of that name can be written here.
    """
    path = outputs.file(text)
    try:
        check_suffix(path)
        check_encoder(path.suffix)
    except ValueError as fault:
        raise ArgumentTypeError(str(fault)) from fault
    return path


def check_encoder(suffix: str) -> None:
    """Write a film of two black frames and throw it away: what encodes films may be missing, or lack the format.

    Args:
        suffix: of :data:`SUFFIXES`.

    Raises:
        ValueError: it cannot be written; says why, and what to install.
    """
    with tempfile.TemporaryDirectory() as folder:
        try:
            write_frames(Path(folder) / f"film{suffix}", [np.zeros((64, 64, 3), dtype=np.uint8)] * 2, FPS)
        except Exception as fault:  # every encoder fails in its own way
            raise ValueError(
                f"{suffix} films cannot be written here ({one_line(fault)}): take another suffix, or run: "
                f"{extra.pip()} 'imageio[ffmpeg]'"
            ) from fault


class Film:
    """Takes snapshots of an environment as it is stepped, and draws them afterwards.

    Args:
        env: to be filmed; its ``width`` and ``height`` are those of the frames.
        caption: text for a frame, or None; called when a snapshot is taken.
        camera: where it is seen from; None: at the pads of a gripper, at the hand of a whole robot.

    Attributes:
        env: that is filmed.
        snapshots: that were taken.
        times: when each was taken, from the start of its episode [s].
        fps: at which they play.
        slow_motion: how many times slower than life that is.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        caption: Callable[[float], str] | None = None,
        camera: drawing.Camera | None = None,
    ) -> None:
        core: Any = core_of(env)
        self.env, self._core, self._dt, self._caption = env, core, float(core.dt), caption
        self._camera = camera or drawing.camera_of(core)
        self.slow_motion = SLOW_MOTION if 1 / self._dt >= SLOW_MOTION * FPS else 1
        self._every = max(1, round(1 / (self._dt * FPS * self.slow_motion)))
        self.fps = 1 / (self._dt * self._every * self.slow_motion)
        self.snapshots: list[drawing.Snapshot] = []
        self.times: list[float] = []
        self._frames: list[Frame] = []

    def __call__(self, step: int) -> None:
        """Take a snapshot if one is due after control step ``step`` (0 is the reset)."""
        if step % self._every == 0:
            self.times.append(step * self._dt)
            caption = "" if self._caption is None else self._caption(self.times[-1])
            self.snapshots.append(drawing.snapshot(self._core, caption))

    def draw(self, *, processes: int | None = 1, done: Callable[[int], None] = lambda frames: None) -> list[Frame]:
        """Frames of the snapshots, each (height, width, 3); drawn once.

        Args:
            processes: see :func:`tiago_mj.view.drawing.draw`.
            done: told how many frames are drawn.

        Raises:
            gymnasium.error.DependencyNotInstalled: no OpenGL could be started; one line that says what to install.
        """
        if len(self._frames) != len(self.snapshots):
            self.check()
            self._frames = self._drawn(self.snapshots, processes=processes, done=done)
        return self._frames

    def check(self) -> None:
        """Draw one frame, so that a machine that cannot says so before the work begins.

        Raises:
            gymnasium.error.DependencyNotInstalled: no OpenGL could be started; one line that says what to install.
        """
        checks.rendered(lambda: self._drawn([drawing.snapshot(self._core)]), "rgb_array", lambda: False)

    def _drawn(self, snapshots: Sequence[drawing.Snapshot], **how: Any) -> list[Frame]:
        core = self._core
        return drawing.draw(core.model, snapshots, size=(core.width, core.height), camera=self._camera, **how)

    def write(
        self, path: Path, *, processes: int | None = 1, done: Callable[[int], None] = lambda frames: None
    ) -> None:
        """Write what was filmed, whole; a png holds :data:`STRIP_FRAMES` frames of the first episode.

        Args:
            path: its suffix says the format.
            processes, done: as of :meth:`draw`.
        """
        check_suffix(path)
        if path.suffix.lower() == ".png":
            some = [self.snapshots[k] for k in strip_indices(self._first_episode())]
            write_frames(path, [np.concatenate(self._drawn(some, processes=processes, done=done), axis=1)], self.fps)
        else:
            write_frames(path, self.draw(processes=processes, done=done), self.fps)

    def _first_episode(self) -> int:
        restarts = [i for i, time in enumerate(self.times) if i and time == 0.0]
        return restarts[0] if restarts else len(self.times)


def write_frames(path: Path, frames: Sequence[Frame], fps: float) -> None:
    """Write frames, whole: a film, or one picture where the file is a png.

    Raises:
        OSError: the drive is full.
    """
    imageio: Any = importlib.import_module("imageio.v2")
    suffix = path.suffix.lower()
    with atomic.replacing(path) as temporary:
        if suffix == ".png":
            imageio.imwrite(temporary, frames[0])
        elif suffix == ".gif":
            imageio.mimwrite(temporary, frames, duration=1000 / fps, loop=0)
        else:
            options = {"quality": 6, "macro_block_size": 2, "ffmpeg_log_level": "quiet"}
            imageio.mimwrite(temporary, frames, fps=fps, **options)
            _check_whole(temporary, path, len(frames))


def _check_whole(temporary: Path, path: Path, frames: int) -> None:
    """Refuse a film with fewer frames than were written: ffmpeg does not report a full drive."""
    ffmpeg: Any = importlib.import_module("imageio_ffmpeg")
    try:
        written = ffmpeg.count_frames_and_secs(temporary)[0]
    except RuntimeError:  # not even a film
        written = 0
    if written != frames:
        raise OSError(f"{path.name}: {written} of {frames} frames could be written: is the drive full?")


def strip_indices(count: int, wanted: int = STRIP_FRAMES) -> list[int]:
    """Evenly spaced indices, first and last included."""
    return sorted({round(i) for i in np.linspace(0, count - 1, min(wanted, count))})
