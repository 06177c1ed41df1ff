"""The files of a local Minari dataset, as plain arrays: HDF5 or Arrow/Parquet storage.

They are read with h5py and pyarrow, not with minari: that may build the environment which the files name, and with it
import whatever they want imported.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from tiago_mj.io.extra import load, pyarrow
from tiago_mj.io.loading import load_json, parse_json
from tiago_mj.io.quoting import quoted
from tiago_mj.io.schema import Open, SchemaError, checked
from tiago_mj.recordings.read.tables import MAX_BYTES, MAX_CELLS, MAX_COLUMNS, check_size
from tiago_mj.recordings.recording import Array, RecordingError

PARTS: Final = ("observations", "actions", "infos")
_FILE: Final = "main_data.hdf5"
#: Numbers of one entry and step beyond which it is a picture, not a state.
WIDEST: Final = 1000
#: Groups within each other; Minari's own are as deep as the observation's dictionaries.
DEEPEST: Final = 16
#: Numbers that a byte of a file unpacks to, at most.
PACKED: Final = 2000


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        index: its number.
        columns: ``observations.3``, ``observations.achieved_goal.0``, ``actions.0``, ``infos.force_raw.1``: (T + 1,)
            each; NaN where nothing was done any more.
        seed: of its reset; None where it is not known.
    """

    index: int
    columns: Mapping[str, Array]
    seed: int | None


@dataclass(frozen=True)
class Dataset:
    """A dataset.

    Attributes:
        path: folder of its data.
        name: as it calls itself.
        form: ``hdf5``, ``arrow`` or ``parquet``.
        total: episodes that there should be; None where nothing is said.
        environment: id and arguments of the environment; None where nothing is said.
    """

    path: Path
    name: str
    form: str
    total: int | None
    environment: tuple[str, Mapping[str, Any]] | None

    def episodes(self) -> Iterator[Episode]:
        """Every episode, in order.

        Raises:
            RecordingError: a file is not whole, or of another format.
        """
        count = 0
        for index, arrays, seed in _hdf5(self) if self.form == "hdf5" else _arrow(self):
            count += 1
            yield Episode(index, _columns(f"{self.name}: episode {index}", arrays), seed)
        if self.total is not None and count < self.total:
            raise RecordingError(
                f"{self.name}: {count} of {self.total} episodes are there: the dataset was not copied whole; copy it "
                "again"
            )


class _Metadata(Open):
    """Keys of a dataset's ``metadata.json`` that are read."""

    env_spec: str | dict[str, Any] | None = None
    data_format: str = "hdf5"
    total_episodes: int | None = None
    dataset_id: str | None = None


def open_dataset(source: str) -> Dataset:
    """A dataset from its ``metadata.json``.

    Args:
        source: its folder, or the ``data`` folder in it.

    Raises:
        RecordingError: there is no dataset, or its metadata is unusable.
    """
    given = Path(source)
    path = next((p for p in (given, given / "data") if (p / "metadata.json").is_file()), None)
    if path is None:
        raise RecordingError(f"{given}: data/metadata.json is missing: give the folder of a local Minari dataset")
    again = "copy the dataset again"
    content = load_json(path / "metadata.json", "metadata.json is not readable", mend=again, error=RecordingError)
    try:
        said = checked(_Metadata, content)
        spec = said.env_spec
        if isinstance(spec, str):
            spec = parse_json(spec, "metadata.json: env_spec is not readable", mend=again, error=RecordingError)
    except SchemaError as fault:
        raise RecordingError(f"metadata.json is not readable ({fault}): {again}") from fault
    form = said.data_format
    if form not in ("hdf5", "arrow", "parquet"):
        raise RecordingError(f"metadata.json: data_format is {quoted(form)}: hdf5, arrow and parquet are read")
    environment = None
    if isinstance(spec, dict) and isinstance(spec.get("id"), str):
        kwargs = spec.get("kwargs")
        environment = spec["id"], kwargs if isinstance(kwargs, dict) else {}
    return Dataset(path, said.dataset_id or given.resolve().name, form, said.total_episodes, environment)


def _hdf5(dataset: Dataset) -> Iterator[tuple[int, dict[str, Any], int | None]]:
    h5py: Any = load("h5py", "reading Minari datasets", "minari")
    path = dataset.path / _FILE
    if not path.is_file():
        raise RecordingError(f"{dataset.path}: {_FILE} is missing: copy the dataset again")
    try:
        with h5py.File(path, "r") as file:
            numbers = sorted(int(name.removeprefix("episode_")) for name in file if name.startswith("episode_"))
            for index in numbers:
                group = file[f"episode_{index}"]
                arrays: dict[str, Any] = {}
                for part in PARTS:
                    if part in group:
                        _walk(part, group[part], arrays)
                seed = group.attrs.get("seed")
                yield index, arrays, None if seed is None else int(seed)
    except RecordingError:
        raise
    # ValueError: names of groups that are no UTF-8
    except (OSError, KeyError, RuntimeError, TypeError, ValueError, MemoryError) as fault:
        raise RecordingError(
            f"{_FILE}: not a whole HDF5 file ({' '.join(str(fault).split())[:120]}): it was cut off or is of another "
            "format; copy it again"
        ) from fault


def _walk(name: str, node: Any, arrays: dict[str, Any], depth: int = 1) -> None:
    """Numeric arrays below a node of the file; images and text are skipped.

    Raises:
        RecordingError: they are more than is read, or groups hold each other.
    """
    if hasattr(node, "keys"):
        if depth > DEEPEST or len(node) > MAX_COLUMNS:
            raise RecordingError(
                f"{_FILE}: {quoted(name)}: groups are nested more than {DEEPEST} deep, or hold too much"
            )
        for key in node:
            if type(node.get(key, getlink=True)).__name__ != "HardLink":
                raise RecordingError(f"{_FILE}: {quoted(f'{name}.{key}')} leads to another place: write what is there")
            _walk(f"{name}.{key.removeprefix('_index_')}", node[key], arrays, depth + 1)
    elif _is_state(node):
        if node.external or node.is_virtual:
            raise RecordingError(
                f"{_FILE}: the numbers of {quoted(name)} are in another file: write them into this one"
            )
        check_size(name, node.shape[0], math.prod(node.shape[1:]))
        size = sum(array.size for array in arrays.values()) + node.size
        if len(arrays) >= MAX_COLUMNS or size > MAX_CELLS or node.size > node.id.get_storage_size() * PACKED:
            raise RecordingError(
                f"{_FILE}: with {quoted(name)} an episode has more than {MAX_CELLS} numbers, or damage"
            )
        arrays[name] = node[()]


def _is_state(node: Any) -> bool:
    """Whether a node is a numeric array with few numbers a step."""
    if not hasattr(node, "ndim") or node.dtype.kind not in "biuf":
        return False
    return bool(1 <= node.ndim <= 3 and math.prod(node.shape[1:]) <= WIDEST)


def _arrow(dataset: Dataset) -> Iterator[tuple[int, dict[str, Any], int | None]]:
    arrow = pyarrow()
    tables: Any = load("pyarrow.dataset", "reading Minari datasets")
    folders = sorted((p for p in dataset.path.iterdir() if p.is_dir() and p.name.isdigit()), key=lambda p: int(p.name))
    if not folders:
        raise RecordingError(f"{dataset.path}: folders of episodes (0, 1, ...) are missing: copy the dataset again")
    for folder in folders:
        try:
            beside = folder / "metadata.json"
            said = load_json(beside, f"{folder.name}/metadata.json is no JSON") if beside.is_file() else {}
            files = [str(p) for p in sorted(folder.iterdir()) if p.suffix == f".{dataset.form}"]
            there = tables.dataset(files, format=dataset.form)
            pieces, size = [], 0
            for piece in there.to_batches(columns=[part for part in PARTS if part in there.schema.names]):
                size += piece.nbytes
                if size > MAX_BYTES:
                    raise ValueError(f"it takes more than {MAX_BYTES // 1_000_000} MB")
                pieces.append(piece)
            table = arrow.Table.from_batches(pieces, pieces[0].schema if pieces else None)
            arrays: dict[str, Any] = {}
            for part in PARTS:
                if part in table.column_names:
                    _open(part, table.column(part).combine_chunks(), arrays, arrow)
        except (arrow.ArrowException, OSError, ValueError, MemoryError) as fault:
            raise RecordingError(
                f"{dataset.name}: episode {folder.name}: not a whole {dataset.form} file "
                f"({' '.join(str(fault).split())[:120]}): copy the dataset again"
            ) from fault
        seed = said.get("seed") if isinstance(said, dict) else None
        if "actions" in table.column_names:  # as many rows as observations: the last is padding
            arrays = {name: a[:-1] if name.startswith("actions") else a for name, a in arrays.items()}
        yield int(folder.name), arrays, seed if isinstance(seed, int) else None


def _open(name: str, column: Any, arrays: dict[str, Any], arrow: Any) -> None:
    """Numeric arrays of an arrow column: structures of equally long lists of numbers."""
    kind, types = column.type, arrow.types
    if types.is_struct(kind):
        for k, part in enumerate(kind):
            _open(f"{name}.{part.name}", column.field(k), arrays, arrow)
    elif types.is_fixed_size_list(kind) and kind.list_size <= WIDEST:
        values = column.flatten()
        if types.is_floating(kind.value_type) or types.is_integer(kind.value_type):
            arrays[name] = values.to_numpy(zero_copy_only=False).reshape(-1, kind.list_size)
    elif types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind):
        arrays[name] = column.to_numpy(zero_copy_only=False)


def _columns(where: str, arrays: Mapping[str, Any]) -> dict[str, Array]:
    """One column a number, all as long as there are observations."""
    rows = max((len(values) for name, values in arrays.items() if name.startswith("observations")), default=0)
    if rows < 2:
        raise RecordingError(f"{where} holds no observations that are numbers: leave it out")
    found: dict[str, Array] = {}
    for name, values in arrays.items():
        flat = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
        if len(flat) not in (rows - 1, rows):
            raise RecordingError(
                f"{where}: {name} has {len(flat)} steps beside {rows} observations: the dataset is not whole; copy it "
                "again"
            )
        flat = np.concatenate([flat, np.full((rows - len(flat), flat.shape[1]), np.nan)])
        alone = np.ndim(values) == 1
        found.update({name if alone else f"{name}.{k}": flat[:, k].copy() for k in range(flat.shape[1])})
    check_size(where, rows, len(found))
    return found
