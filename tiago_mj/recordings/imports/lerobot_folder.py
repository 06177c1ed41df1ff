"""Files of a LeRobot dataset: its metadata, and its rows by episode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.loading import load_json, parse_json
from tiago_mj.io.quoting import is_one_of, quoted, unquoted
from tiago_mj.recordings.read.tables import MAX_COLUMNS, MAX_ROWS, check_size, read_parquet
from tiago_mj.recordings.recording import Array, RecordingError
from tiago_mj.recordings.usable import RATE, is_rate

STATE: Final = "observation.state"
ACTION: Final = "action"
#: Characters of a line of ``episodes.jsonl``, which has an episode's number, length and task.
LONGEST_LINE: Final = 1_000_000
_ROW: Final = ("episode_index", "frame_index", "timestamp")
#: Stamps that are the row's number over the rate, to this share of a period, are taken so: float32 rounds them.
NOMINAL: Final = 1e-2


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        index: its number in the dataset.
        time: (T,) [s], strictly increasing.
        state: what was observed, (T, n).
        action: what was then sent, (T, m).
        task: in words; None where nothing is said.
    """

    index: int
    time: Array
    state: Array
    action: Array
    task: str | None


@dataclass(frozen=True)
class Folder:
    """A dataset.

    Attributes:
        path: its folder.
        version: of the format, such as ``v3.0``.
        robot: its type as the dataset names it; ``lerobot`` where it does not.
        rate_hz: frames per second.
        state, action: names of the numbers of a row.
        total: episodes that there should be; None where nothing is said.
        lengths: rows of each episode, by its number; empty where nothing is said.
        tasks: of each episode, in words.
    """

    path: Path
    version: str
    robot: str
    rate_hz: float
    state: tuple[str, ...]
    action: tuple[str, ...]
    total: int | None
    lengths: Mapping[int, int]
    tasks: Mapping[int, str]

    @property
    def name(self) -> str:
        """The folder's."""
        return self.path.resolve().name

    def episodes(self, arrow: Any) -> Iterator[Episode]:
        """Every episode, in the order of the files.

        Args:
            arrow: pyarrow.

        Raises:
            RecordingError: a file or an episode is not whole, or a row has another number of entries.
        """
        seen = set()
        for index, rows in _by_episode(self._files(arrow)):
            if index in seen:
                raise RecordingError(f"{self.name}: episode {index} is there twice: copy the dataset anew")
            seen.add(index)
            yield self._episode(index, rows)
        missing = set(self.lengths) - seen
        wanted = len(self.lengths) or self.total or 0
        if not self.lengths and wanted > len(seen):
            missing = {next(k for k in range(wanted) if k not in seen)}
        if missing:
            raise RecordingError(
                f"{self.name}: episode {min(missing)} is missing ({len(seen)} of {wanted} are there): the dataset was "
                "not copied whole; fetch it again"
            )

    def _files(self, arrow: Any) -> Iterator[tuple[NDArray[np.int64], Array]]:
        """Episode numbers (n,) and frame number, stamp, state and action of every row, (n, 2 + width), by file."""
        files = sorted((self.path / "data").glob("*/*.parquet"))
        if not files:
            raise RecordingError(
                f"{self.path}: data/chunk-*/*.parquet is missing: give the folder of the whole dataset"
            )
        widths = {STATE: len(self.state), ACTION: len(self.action)}
        for path in files:
            file = f"data/{path.parent.name}/{path.name}"
            table = read_parquet(path, file, (*_ROW, *widths))
            check_size(file, table.num_rows, 2 + sum(widths.values()))
            lists = [_matrix(table.column(name), name, width, file, arrow) for name, width in widths.items()]
            single = [_vector(table.column(name), name, file, arrow)[:, None] for name in _ROW]
            yield single[0][:, 0].astype(np.int64), np.hstack([*single[1:], *lists])

    def _episode(self, index: int, rows: Array) -> Episode:
        length = self.lengths.get(index, len(rows))
        if length != len(rows):
            raise RecordingError(
                f"{self.name}: episode {index} has {len(rows)} rows, meta/episodes says {length}: the dataset was not "
                "copied whole; fetch it again"
            )
        frame, stamp = rows[:, 0], rows[:, 1]
        nominal = frame / self.rate_hz
        time = nominal if bool((np.abs(stamp - nominal) * self.rate_hz < NOMINAL).all()) else stamp
        if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
            row = int(np.argmax(~(np.diff(time, prepend=-np.inf) > 0)))
            raise RecordingError(
                f"{self.name}: episode {index}: timestamp does not increase at frame {row}: mend or leave out the "
                "episode"
            )
        middle = 2 + len(self.state)
        return Episode(index, time, rows[:, 2:middle], rows[:, middle:], self.tasks.get(index))


def open_folder(source: str) -> Folder:
    """A dataset from its ``meta``.

    Raises:
        RecordingError: there is no dataset, or its ``meta`` is unusable.
    """
    path = Path(source)
    info_file = path / "meta" / "info.json"
    if not info_file.is_file():
        raise RecordingError(
            f"{path}: meta/info.json is missing: give the local folder of a LeRobot dataset (v3.0 or v2.x)"
        )
    info = load_json(
        info_file, "meta/info.json is not readable JSON", mend="fetch the dataset again", error=RecordingError
    )
    if not isinstance(info, dict) or not isinstance(info.get("features"), dict):
        raise RecordingError("meta/info.json: 'features' is missing: this is no LeRobot dataset")
    version = str(info.get("codebase_version", ""))
    if not version.startswith(("v2.", "v3.")):
        raise RecordingError(
            f"meta/info.json: codebase_version is {quoted(version)}: v3.0 and v2.x are read; convert it with lerobot's "
            "own script"
        )
    rate = info.get("fps")
    if not is_rate(rate):
        raise RecordingError(f"meta/info.json: fps is {quoted(rate)}: {RATE}")
    total = info.get("total_episodes")
    robot = info.get("robot_type")
    lengths, tasks = _listed(path)
    return Folder(
        path=path,
        version=version,
        robot=robot if isinstance(robot, str) and robot else "lerobot",
        rate_hz=float(rate),
        state=_names(info["features"], STATE),
        action=_names(info["features"], ACTION),
        total=total if isinstance(total, int) else None,
        lengths=lengths,
        tasks=tasks,
    )


def _names(features: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """Names of a feature's numbers; their indices where it names none."""
    feature = features.get(key)
    shape = feature.get("shape") if isinstance(feature, dict) else None
    if not isinstance(shape, list) or len(shape) != 1 or not is_one_of(shape[0], range(1, MAX_COLUMNS)):
        there = unquoted(", ".join(features)) or "nothing"
        raise RecordingError(f"meta/info.json: {key} is no list of numbers (there are {there}): nothing can be read")
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict):  # {"motors": [...]}, as version 2 has it
        names = next((value for value in names.values() if isinstance(value, list)), None)
    if names is None:
        return tuple(str(k) for k in range(shape[0]))
    if not isinstance(names, list) or len(names) != shape[0] or len({str(name) for name in names}) != shape[0]:
        raise RecordingError(
            f"meta/info.json: names of {key} are {quoted(names)}: {shape[0]} different names are needed"
        )
    return tuple(str(name) for name in names)


def _listed(path: Path) -> tuple[dict[int, int], dict[int, str]]:
    """Length and task of every episode that ``meta`` lists."""
    entries: list[dict[str, Any]] = []
    old = path / "meta" / "episodes.jsonl"
    try:
        for file in sorted((path / "meta" / "episodes").glob("*/*.parquet")):
            name = f"meta/episodes/{file.parent.name}/{file.name}"
            entries += read_parquet(file, name, ("episode_index", "length"), ("tasks",)).to_pylist()
        if not entries and old.is_file():
            with old.open(encoding="utf-8") as stream:
                lines = islice(iter(partial(stream.readline, LONGEST_LINE), ""), MAX_ROWS)
                entries = [parse_json(line, "a line is no JSON") for line in lines if line.strip()]
        lengths = {int(entry["episode_index"]): int(entry["length"]) for entry in entries}
        said = {int(entry["episode_index"]): entry.get("tasks") for entry in entries}
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as fault:
        if isinstance(fault, RecordingError):
            raise
        raise RecordingError(
            f"{path.name}: meta/episodes is not the format's ({' '.join(str(fault).split())}): fetch the dataset again"
        ) from fault
    tasks = {k: "; ".join(map(str, task)) if isinstance(task, list) else str(task) for k, task in said.items() if task}
    return lengths, tasks


def _by_episode(files: Iterator[tuple[NDArray[np.int64], Array]]) -> Iterator[tuple[int, Array]]:
    """Rows of each episode in order; an episode may continue in the next file."""
    current: int | None = None
    pieces: list[Array] = []
    for numbers, rows in files:
        edges = np.flatnonzero(np.diff(numbers)) + 1
        for part, number in zip(np.split(rows, edges), numbers[[0, *edges]] if len(numbers) else (), strict=False):
            if current is not None and number != current:
                yield current, np.concatenate(pieces)
                pieces = []
            current = int(number)
            pieces.append(part)
    if current is not None:
        yield current, np.concatenate(pieces)


def _vector(column: Any, name: str, file: str, arrow: Any) -> Array:
    kind = column.type
    if not (arrow.types.is_integer(kind) or arrow.types.is_floating(kind)):
        raise RecordingError(f"{file}: column {name} holds no numbers ({kind}): this is not the format's")
    return np.asarray(column.cast(arrow.float64(), safe=False).to_numpy(), dtype=np.float64)


def _matrix(column: Any, name: str, width: int, file: str, arrow: Any) -> Array:
    """A column of lists, (n, width)."""
    kind = column.type
    if width == 1 and not hasattr(kind, "value_type"):
        return _vector(column, name, file, arrow)[:, None]
    if not hasattr(kind, "value_type") or column.null_count:
        raise RecordingError(f"{file}: column {name} is no list of {width} numbers: this is not the format's")
    flat = _vector(
        arrow.chunked_array([chunk.flatten() for chunk in column.chunks], kind.value_type), name, file, arrow
    )
    if len(flat) != len(column) * width:
        raise RecordingError(
            f"{file}: column {name} does not have {width} numbers in every row, as meta/info.json says: mend either"
        )
    return flat.reshape(-1, width)
