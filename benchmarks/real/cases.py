"""All cases and sources."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from benchmarks.real.declare import Case, File, Source
from benchmarks.real.robots import (
    double_pendulum,
    emps,
    go2,
    kuka_kr300,
    panda,
    simple_pendulum,
    so101,
    sts3250,
    ta11,
    tiago_arm,
    tx40,
    ur10e,
    xl330,
)

_ROBOTS: Final = (
    emps,
    double_pendulum,
    simple_pendulum,
    ur10e,
    kuka_kr300,
    go2,
    xl330,
    sts3250,
    so101,
    tiago_arm,
    tx40,
    panda,
    ta11,
)
CASES: Final[Mapping[str, Case]] = {case.name: case for robot in _ROBOTS for case in robot.CASES}
SOURCES: Final[Mapping[str, Source]] = {robot.SOURCE.name: robot.SOURCE for robot in _ROBOTS}
#: By source: what its truths were regressed with; numbers by name.
REGRESSIONS: Final[Mapping[str, Callable[[Path], dict[str, float]]]] = {
    robot.SOURCE.name: robot.regress for robot in _ROBOTS
}
#: Files that stand for others with the same numbers.
INSTEAD: Final = {go2.FILES[0]: go2.TABLE}


def absent(case: Case, data: Path) -> tuple[File, ...]:
    """Files of a case that the user's folder lacks."""
    return tuple(file for file in files(case) if place(data, file) is None)


def files(case: Case) -> tuple[File, ...]:
    """What a case reads."""
    return tuple(file for file in SOURCES[case.source].files if file.place in case.files)


def place(data: Path, file: File) -> Path | None:
    """Where a file lies in the user's folder; None: nowhere."""
    for name in (file.place, INSTEAD.get(file.place)):
        if name is not None and (data / name).is_file():
            return data / name
    return None


def wrong(data: Path, file: File) -> str:
    """What is wrong with a file of the user's folder; "" if it is the published one."""
    path = place(data, file)
    if path is None:
        return "is not there"
    if path == data / file.place and hashlib.sha256(path.read_bytes()).hexdigest() != file.sha256:
        return "is not the published file (its SHA-256 differs): fetch it again"
    return ""
