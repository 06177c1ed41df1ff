"""Temporary files and folders beside their place, and folders in which one process works at a time.

A temporary thing is locked by the process that writes it. The lock ends with the process, however that ends; so what a
killed process left is told from what another one is writing, and the next process that writes there removes it.
Where files cannot be locked (Windows, some network drives), what a killed process left stays.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

try:
    import fcntl
except ModuleNotFoundError:  # Windows
    fcntl = None  # type: ignore[assignment]

#: Part of the name of everything temporary. Nothing else is ever removed.
MARK: Final = ".tiago_mj-"
#: Characters of the final name that a temporary one repeats: it must not become too long for the file system.
REPEATED: Final = 40
#: Seconds to wait for a process that is about to end.
PATIENCE: Final = 15.0
#: Seconds to wait for the lock of a machine that is lost: a file server keeps it for a lease, 90 s with Linux' NFS.
LEASE: Final = 180.0
LOCK: Final = "lock"


@contextmanager
def temporary_file(folder: Path, stem: str, suffix: str = "") -> Iterator[Path]:
    """An empty file in a folder that is there; it is removed at the end, unless it has been renamed."""
    sweep(folder)
    while True:
        handle, name = tempfile.mkstemp(dir=folder, prefix=_prefix(stem), suffix=suffix[-REPEATED:])
        if _hold(handle, Path(name)):
            break
        os.close(handle)
    if fcntl is None:  # Windows renames no file that is open
        os.close(handle)
    try:
        yield Path(name)
    finally:
        Path(name).unlink(missing_ok=True)
        if fcntl is not None:
            os.close(handle)


@contextmanager
def temporary_folder(parent: Path, stem: str) -> Iterator[Path]:
    """An empty folder in another; what has its name at the end is removed."""
    sweep(parent)
    handle: int | None = None
    while True:
        path = Path(tempfile.mkdtemp(dir=parent, prefix=_prefix(stem)))
        if fcntl is None:
            break
        try:
            handle = os.open(path, os.O_RDONLY)
        except FileNotFoundError:  # another process swept it before it was locked
            continue
        if _hold(handle, path):
            break
        os.close(handle)
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        if handle is not None:
            os.close(handle)


def sweep(folder: Path) -> None:
    """Remove what processes that were killed have left in a folder."""
    if fcntl is None:
        return
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith(".") and MARK in entry.name and not entry.is_symlink():
                with suppress(OSError):
                    _remove_if_left(Path(entry.path))


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait until no other process has locked a folder, then lock it while the block runs."""
    if fcntl is None:
        yield
        return
    while True:
        handle = os.open(path, os.O_RDONLY)
        with suppress(OSError):  # where nothing can be locked, nothing is
            fcntl.flock(handle, fcntl.LOCK_EX)
        if _same(handle, path):
            break
        os.close(handle)  # it was exchanged for another while this process waited
    try:
        yield
    finally:
        os.close(handle)


@contextmanager
def alone(folder: Path, doing: str, patience: float | None = None) -> Iterator[None]:
    """Let one process at a time work in a folder, which is made where it is missing.

    Args:
        folder: of the work; its file ``lock`` is locked.
        doing: what the process does, for the complaint: ``"training"``.
        patience: seconds to wait for another process; None: :data:`PATIENCE`.

    Raises:
        ValueError: another process works there, and goes on doing so.
    """
    if fcntl is None:  # two at once are the user's own lookout there
        folder.mkdir(parents=True, exist_ok=True)
        yield
        return
    until = time.monotonic() + (PATIENCE if patience is None else patience)
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            if time.monotonic() > until:
                raise ValueError(
                    f"another process is {doing} in {folder}: wait for it, end it, or give another --out"
                ) from None
            time.sleep(0.2)
            continue
        if _same(handle, folder / LOCK):
            break
        os.close(handle)  # who had it has removed the folder
    try:
        yield
    finally:
        os.close(handle)


def _prefix(stem: str) -> str:
    return f".{stem[:REPEATED]}{MARK}"


def _hold(handle: int, path: Path) -> bool:
    """Lock a file that was just made; whether it still exists."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:  # another process is about to sweep it
        return False
    except OSError:
        return True
    return _same(handle, path)


def _same(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False


def _remove_if_left(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()
    finally:
        os.close(handle)
