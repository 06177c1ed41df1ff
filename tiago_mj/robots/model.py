"""Where the model of a robot lies: in a folder laid out as MuJoCo Menagerie, or with its own package."""

from __future__ import annotations

import importlib
import importlib.util
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from tiago_mj.io.loading import is_file
from tiago_mj.io.quoting import one_line, quoted
from tiago_mj.robots.known import KnownRobot

#: Folder of a checkout of MuJoCo Menagerie; its own package heeds it, too.
VARIABLE: Final = "MENAGERIE_ROOT"
#: Menagerie's own package, which fetches a model at its first use.
PACKAGE: Final = "mujoco_menagerie"
GET: Final = (
    "pip install -c constraints.txt '.[robots]' in a clone, or give --menagerie FOLDER, a checkout of MuJoCo Menagerie"
)


def model_of(robot: KnownRobot, folder: Path | None = None, environment: Mapping[str, str] | None = None) -> Path:
    """The model file of a robot.

    Args:
        robot: which.
        folder: laid out as MuJoCo Menagerie; None: what :data:`VARIABLE` names, else Menagerie's package.
        environment: variables; None: the process's.

    Raises:
        ValueError: it is nowhere, or cannot be fetched; one line says how to get it.
    """
    said = (os.environ if environment is None else environment).get(VARIABLE)
    where = folder if folder is not None else Path(said) if said else None
    if where is not None:
        path = where / robot.folder / robot.file
        if not is_file(path):
            raise ValueError(
                f"{quoted(str(where))} has no {robot.folder}/{robot.file}: name the folder of MuJoCo Menagerie that "
                f"holds {robot.folder}"
            )
        return path
    try:
        package = importlib.import_module(PACKAGE)
    except ModuleNotFoundError:
        raise ValueError(f"the model of {robot.title} is not here: {GET}") from None
    try:
        return Path(package.get(robot.folder).path()) / robot.file
    except (OSError, package.MenagerieError) as fault:
        raise ValueError(f"the model of {robot.title} cannot be fetched ({one_line(fault)}): {GET}") from None


def place_of(robot: KnownRobot, folder: Path | None = None) -> str:
    """Where the model lies, in words; nothing is fetched."""
    if folder is not None or os.environ.get(VARIABLE):
        try:
            return str(model_of(robot, folder))
        except ValueError as fault:
            return str(fault)
    found = importlib.util.find_spec(PACKAGE) is not None
    return f"{robot.folder}/{robot.file} of {PACKAGE.replace('_', '-')}" + ("" if found else f", not here: {GET}")
