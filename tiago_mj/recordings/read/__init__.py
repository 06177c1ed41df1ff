"""Reading recordings: files and folders of CSV, Parquet, ROS bags and MCAP become trials."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from tiago_mj.io.loading import is_file
from tiago_mj.io.quoting import quoted, unquoted
from tiago_mj.recordings.read.bags import read_bag
from tiago_mj.recordings.read.columns import check_mapped, trial_from_table
from tiago_mj.recordings.read.mapping import FACTS, column_map, load_map
from tiago_mj.recordings.read.tables import TEXT, Table, read_table
from tiago_mj.recordings.recording import KINDS, Finding, ReadResult, RecordingError, Trial, channel, channels
from tiago_mj.recordings.robot import MODELS, Robot, robot_of
from tiago_mj.recordings.sidecar import load_sidecar

TABLES: Final = (".parquet", *TEXT)
BAGS: Final = (".bag", ".mcap", ".db3")


def read_recordings(
    paths: Sequence[Path],
    *,
    map_file: Path | None = None,
    defaults: Mapping[str, Any] | None = None,
    replayed: bool = True,
    robot: str | None = None,
    known: Mapping[str, Any] | None = None,
) -> ReadResult:
    """Trials from recording files and folders, and findings on what was repaired or assumed.

    Args:
        paths: files (``.parquet``, ``.csv``, ``.tsv``, ``.bag``, ``.mcap``, ``.db3``) or folders of them; a folder with
            a ``metadata.yaml`` is a ROS 2 bag.
        map_file: YAML, see :mod:`tiago_mj.recordings.read.mapping` and :mod:`tiago_mj.recordings.read.bags`.
        defaults: sidecar fields from the command line (``robot``, ``interface``, ``sensing`` ...), for what sidecars
            lack.
        replayed: whether a recording without commands and efforts is refused, as nothing can be replayed.
        robot: environment id or model file that is simulated whatever the sidecars say; None: what they say. A model
            file tells which actuator the command of a joint is for, and what commands are where nothing else says it.
        known: columns that logs of this robot may have, as a map file has them; what the map file says counts more.

    Returns:
        Trials in the order of the paths, and what was found and repaired. Two recordings with the same samples are
        one, as a copy would carry what is to be predicted into what is fitted.

    Raises:
        RecordingError: a file cannot be used; one line says which, which column, and how to mend it.
    """
    content = {} if map_file is None else load_map(Path(map_file))
    columns = column_map(content, "" if map_file is None else Path(map_file).name)
    usual = column_map({"columns": known or {}}, "")
    trials: list[Trial] = []
    findings: list[Finding] = []
    files: list[Path] = []
    lacking = _defaults(content, defaults)
    tables = [(path, _load(path, content)) for path in find_recordings(paths)]
    if map_file is not None and (mapped := _mapped(tables, content)):
        check_mapped(columns, mapped, Path(map_file).name)
    robots: dict[str, Robot | None] = {}
    while tables:  # what a trial does not keep of its table is not kept until the last one is read
        path, table = tables.pop(0)
        file = robot or _robot(path, table, lacking)
        if file not in robots:
            robots[file] = robot_of(file)
        here = {column: target for column, target in usual.items() if column in table.columns}
        parts, found = trial_from_table(table, {**here, **columns}, lacking, replayed, robots[file])
        trials += [_model_found(trial, path) for trial in parts]
        files += [path] * len(parts)
        findings += found
    trials = _unique_names(trials, files)
    kept, copies = _without_copies(trials)
    findings += copies
    recorded = sorted({trial.sidecar.robot for trial in kept})
    if len(recorded) > 1:
        several = ", ".join(map(unquoted, recorded))
        raise RecordingError(f"the recordings are of several robots ({several}): give those of one at a time")
    return ReadResult(tuple(kept), tuple(findings))


def find_recordings(paths: Sequence[Path]) -> Iterator[Path]:
    """Recording files below the given paths; those of a folder sorted by name.

    Raises:
        RecordingError: a path is not there, is of no known format, or a folder holds no recording.
    """
    if not paths:
        raise RecordingError("no recording was given: name files or folders")
    for path in map(Path, paths):
        if not path.exists():
            raise RecordingError(f"{path}: no such file or folder")
        if not path.is_dir() or is_ros2_bag(path):
            if path.is_file() and path.suffix.lower() not in TABLES + BAGS:
                raise RecordingError(f"{path.name}: of no known format: give {', '.join(TABLES + BAGS)} or a folder")
            yield path
            continue
        inside = sorted(
            entry
            for entry in path.iterdir()
            if not entry.name.startswith(".") and (entry.suffix.lower() in TABLES + BAGS or is_ros2_bag(entry))
        )
        stems = Counter(entry.stem for entry in inside)
        if not inside:
            raise RecordingError(f"{path}: the folder holds no recording ({', '.join(TABLES + BAGS)})")
        if stems and max(stems.values()) > 1:
            raise RecordingError(
                f"{path}: {quoted(stems.most_common(1)[0][0])} is there in two formats, which share a sidecar: delete "
                "one"
            )
        yield from inside


def is_ros2_bag(path: Path) -> bool:
    """Whether a folder is a ROS 2 bag."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


def _defaults(content: Mapping[str, Any], given: Mapping[str, Any] | None) -> dict[str, Any]:
    """Entries for sidecars that lack them: from the command line, else from the map file."""
    facts = {key: content[key] for key in FACTS if key in content}
    return {**facts, **{key: value for key, value in (given or {}).items() if value is not None}}


def _mapped(tables: Sequence[tuple[Path, Table]], content: Mapping[str, Any]) -> list[Table]:
    """Tables to which the columns of a map file apply: to those of bags only where it has no topics."""
    bags = {path for path, _ in tables if path.is_dir() or path.suffix.lower() in BAGS}
    return [table for path, table in tables if path not in bags or "topics" not in content]


def _robot(path: Path, table: Table, defaults: Mapping[str, Any]) -> str:
    """Robot that a recording states; a file is relative to the recording's folder; "" where none is stated."""
    said = next((facts["robot"] for facts in (table.sidecar, defaults, table.facts) if facts.get("robot")), "")
    if not isinstance(said, str):
        return ""
    beside = path.parent / said
    return str(beside) if said.endswith(MODELS) and is_file(beside) else said


def _load(path: Path, content: Mapping[str, Any]) -> Table:
    try:
        str(path).encode()
    except UnicodeEncodeError as fault:  # of another system, or unpacked as another encoding
        raise RecordingError(f"{unquoted(path)}: this name is no UTF-8 text: rename the file or its folder") from fault
    beside = path.with_name(path.name + ".json") if path.is_dir() else path.with_suffix(".json")
    sidecar = load_sidecar(beside) if beside.is_file() else {}
    if path.is_dir() or path.suffix.lower() in BAGS:
        return read_bag(path, content, sidecar, beside.name)
    return read_table(path, sidecar, beside.name)


def _model_found(trial: Trial, path: Path) -> Trial:
    """An MJCF that the sidecar names lies where the sidecar says, seen from the recording's folder."""
    model = path.parent / trial.sidecar.robot
    if not trial.sidecar.robot.endswith(MODELS) or not is_file(model):
        return trial
    return replace(trial, sidecar=replace(trial.sidecar, robot=str(model.resolve())))


def _unique_names(trials: list[Trial], files: Sequence[Path]) -> list[Trial]:
    """Trials named alike in several folders are told apart by their folder."""
    counts = Counter(trial.name for trial in trials)
    named = []
    for trial, path in zip(trials, files, strict=True):
        folder = path.resolve().parent.name
        apart = replace(trial, name=f"{folder}-{trial.name}", source=f"{folder}/{trial.source}")
        named.append(trial if counts[trial.name] == 1 else apart)
    again = [name for name, count in Counter(trial.name for trial in named).items() if count > 1]
    if again:
        raise RecordingError(
            f'two recordings are the trial {quoted(again[0])}: give each its own "trial" in the sidecar'
        )
    return named


def _without_copies(trials: Sequence[Trial]) -> tuple[list[Trial], list[Finding]]:
    kept: dict[int, Trial] = {}
    findings = []
    for trial in trials:
        key = hash(tuple(channel(trial, name).tobytes() for name in channels(trial, kinds=tuple(KINDS))))
        twin = kept.get(key)
        if twin is not None and _same(trial, twin):
            findings.append(
                Finding(
                    "contradiction",
                    trial.source,
                    "",
                    f"its samples are those of {twin.source}, to the last digit: used once",
                    repaired=True,
                )
            )
        else:
            kept[key] = trial
    return list(kept.values()), findings


def _same(one: Trial, other: Trial) -> bool:
    listed = list(channels(one, kinds=tuple(KINDS)))
    return (
        np.array_equal(one.time, other.time)
        and listed == list(channels(other, kinds=tuple(KINDS)))
        and all(np.array_equal(channel(one, name), channel(other, name), equal_nan=True) for name in listed)
    )


__all__ = ["find_recordings", "read_recordings"]
