"""A journal of finished work: results appended to a file by their keys, so that work that was killed goes on from them.

A line is a checksum and JSON; the first one says whose work it is. A line that a kill or a full drive cut off is
dropped, with what follows it. Arrays are bytes in base64: nothing is unpickled, and every bit comes back.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from tiago_mj.io.quoting import unquoted

try:
    import fcntl
except ModuleNotFoundError:  # Windows: two processes at once are the user's own lookout there
    fcntl = None  # type: ignore[assignment]

SCHEMA: Final = "tiago_mj.journal/2"
#: Bytes of a digest.
DIGEST: Final = 16


@dataclass
class Journal:
    """Finished results by key, and the file that they are appended to.

    Attributes:
        path: of the file, which is made for the first result; None: nothing is kept.
        header: whose work it is.
        found: results of an earlier run, as JSON.
    """

    path: Path | None = None
    header: Mapping[str, str] = field(default_factory=dict)
    found: dict[str, Any] = field(default_factory=dict)
    _handle: int | None = None

    def add(self, key: str, result: Any) -> None:
        """Append a result, as JSON. Where the file cannot be written, or is another process's, the work goes on without
        it."""
        if self.path is None:
            return
        try:
            if self._handle is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._handle = _own(self.path)
                os.ftruncate(self._handle, 0)
                self._append(dict(self.header))
            self._append([key, result])
        except OSError:
            if self._handle is not None:  # room for what is written at the end
                with suppress(OSError):
                    os.ftruncate(self._handle, 0)
            self.close()
            self.path = None

    def close(self) -> None:
        """Let another process have the file."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def _append(self, what: Any) -> None:
        assert self._handle is not None
        line = json.dumps(what, separators=(",", ":")).encode()
        rest = memoryview(_checksum(line) + b" " + line + b"\n")
        while rest:
            rest = rest[os.write(self._handle, rest) :]


@contextmanager
def kept(path: Path | None, header: Callable[[], Mapping[str, str]], *, resume: bool = False) -> Iterator[Journal]:
    """A journal while the block runs.

    Args:
        path: of its file; None: nothing is kept.
        header: what the work depends on, by what a user calls it; asked where there is a file.
        resume: begin with what is there; else it is replaced.

    Raises:
        ValueError: what is there is of other work, or of a process that is at it; one line.
    """
    journal = Journal() if path is None else Journal(path, {"schema": SCHEMA, **header()})
    try:
        if resume and path is not None and path.is_file():
            _take_up(journal, path)
        yield journal
    finally:
        journal.close()


def _take_up(journal: Journal, path: Path) -> None:
    try:
        journal._handle = _own(path)
    except BlockingIOError:
        raise ValueError(
            f"another process writes {unquoted(path)}: wait for it, end it, or give another --out"
        ) from None
    with path.open("rb") as file:
        whole, length = [], 0
        for line in file:
            checksum, _, content = line.rstrip(b"\n").partition(b" ")
            if not line.endswith(b"\n") or checksum != _checksum(content):
                break
            whole.append(json.loads(content))
            length += len(line)
    if not whole:  # it was killed before the first line was there
        journal.close()
        return
    for name, mine in journal.header.items():
        if whole[0].get(name) != mine:
            told = f" ({whole[0].get(name)}, not {mine})" if name in ("schema", "version") else ""
            raise ValueError(
                f"--resume: {unquoted(path)} is of another {name}{told}: give what it was begun with, or leave "
                "--resume out to begin anew"
            )
    os.ftruncate(journal._handle, length)
    os.lseek(journal._handle, 0, os.SEEK_END)
    journal.found = dict(whole[1:])


def _own(path: Path) -> int:
    """The file, opened and locked.

    Raises:
        BlockingIOError: another process has it.
    """
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise
    except OSError:  # where nothing can be locked, nothing is
        pass
    return handle


def _checksum(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=DIGEST).hexdigest().encode()


def digest(value: Any) -> str:
    """Digest of numbers, texts, arrays, and of tuples, lists, sets, mappings and dataclasses of these; the same in
    every process.

    Raises:
        TypeError: of something else.
    """
    out = hashlib.blake2b(digest_size=DIGEST)
    for part in _parts(value):
        out.update(part)
    return out.hexdigest()


def _parts(value: Any) -> Iterable[bytes | memoryview]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype.str}{value.shape}".encode()
        yield np.ascontiguousarray(value).data.cast("B") if value.size else b""
    elif is_dataclass(value):
        yield type(value).__name__.encode()
        for one in fields(value):
            yield from _parts(getattr(value, one.name))
    elif isinstance(value, Mapping):
        yield b"{"
        for pair in value.items():
            yield from _parts(pair)
        yield b"}"
    elif isinstance(value, tuple | list | frozenset):
        yield b"("
        for item in sorted(value) if isinstance(value, frozenset) else value:
            yield from _parts(item)
        yield b")"
    elif isinstance(value, bytes):
        yield value
    elif value is None or isinstance(value, str | bool | int | float | np.generic):
        yield f"{type(value).__name__} {value!r};".encode()
    else:
        raise TypeError(f"no digest of {type(value).__name__}")


def packed(value: Any) -> Any:
    """A value as JSON: None, numbers, texts, arrays, and tuples, lists, mappings by texts and dataclasses of these."""
    if isinstance(value, np.ndarray | np.generic):
        of = np.asarray(value)
        order: Literal["C", "F"] = "F" if of.flags.fnc else "C"
        return {"array": [of.dtype.str, of.shape, order, base64.b64encode(of.tobytes(order)).decode()]} | (
            {} if isinstance(value, np.ndarray) else {"scalar": True}
        )
    if is_dataclass(value):
        return {type(value).__name__: [packed(getattr(value, one.name)) for one in fields(value)]}
    if isinstance(value, tuple):
        return {"tuple": [packed(item) for item in value]}
    if isinstance(value, list):
        return [packed(item) for item in value]
    if isinstance(value, Mapping):
        return {"map": {name: packed(item) for name, item in value.items()}}
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise TypeError(f"{type(value).__name__} is not kept in a journal")


def unpacked(value: Any, classes: Mapping[str, type]) -> Any:
    """What :func:`packed` made JSON of; ``classes`` are the dataclasses that there may be, by their names."""
    if isinstance(value, list):
        return [unpacked(item, classes) for item in value]
    if not isinstance(value, dict):
        return value
    name, content = next(iter(value.items()))
    if name == "array":
        kind, shape, order, data = content
        array = np.frombuffer(base64.b64decode(data), np.dtype(kind)).reshape(shape, order=order).copy(order)
        return array[()] if "scalar" in value else array
    if name == "tuple":
        return tuple(unpacked(item, classes) for item in content)
    if name == "map":
        return {key: unpacked(item, classes) for key, item in content.items()}
    return classes[name](*(unpacked(item, classes) for item in content))
