"""What a command line says of the robot of recordings: which it is, and what its model does not say."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import ReadResult
from tiago_mj.robots.known import named
from tiago_mj.robots.model import model_of


@dataclass(frozen=True)
class Said:
    """What a command line says of the robot of recordings.

    Attributes:
        env, model: environment id and model file, of which one at most is given; of a named robot its model.
        facts: fields of a sidecar that lacks them.
        columns: that logs of the robot may have.
    """

    env: str | None
    model: Path | None
    facts: dict[str, Any]
    columns: dict[str, Any] | None

    def read(self, paths: Sequence[Path], map_file: Path | None) -> ReadResult:
        """Recordings of this robot.

        Raises:
            RecordingError: as of :func:`tiago_mj.recordings.read.read_recordings`.
        """
        robot = str(self.model) if self.model else self.env
        facts = {**self.facts, **({"robot": robot} if robot else {})}
        return read_recordings(paths, map_file=map_file, defaults=facts, robot=robot, known=self.columns)


def said(arguments: argparse.Namespace) -> Said:
    """What the options say.

    Raises:
        ValueError: there is no such robot, or its model is not here; one line.
    """
    owned = named(arguments.robot) if arguments.robot else None
    model = arguments.model if owned is None else model_of(owned, arguments.menagerie)
    facts: dict[str, Any] = dict(owned.facts) if owned is not None else {}
    facts |= {"gains": arguments.gains} if arguments.gains else {}
    facts |= {"base": "fixed"} if arguments.fix_base else {}
    names = [name.strip() for name in (arguments.like or "").split(",") if name.strip()]
    facts |= {"like": names} if names else {}
    facts |= {"tie": True} if arguments.tie else {}
    return Said(arguments.env, model, facts, None if owned is None else owned.map)


def words(arguments: argparse.Namespace, *, absolute: bool = False) -> list[str]:
    """The options, as they can be given again; ``absolute``: from another folder."""
    found = []
    for name in ("env", "robot" if arguments.robot else "model", "menagerie", "map", "gains", "like"):
        value = getattr(arguments, name)
        if value:
            found += [f"--{name}", str(value.resolve() if absolute and isinstance(value, Path) else value)]
    return found + [f"--{name}" for name in ("fix-base", "tie") if getattr(arguments, name.replace("-", "_"))]
