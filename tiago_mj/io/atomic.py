"""Files that are either whole or not there: written beside their place under another name, then renamed.

A set of files that belong together appears at once (:func:`replacing_set`). A process may be killed at any moment: what
is left is what was there before, or what was to be there. See :mod:`tiago_mj.io.held` for what it leaves beside that.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import stat
import sys
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Final

from tiago_mj.io import held

#: Files, folders and links of a folder that is exchanged for another; in a larger one files are renamed one by one.
MAX_EXCHANGED_FILES: Final = 20_000
#: Seconds in which a folder that another process is exchanging is there again.
_MOMENT: Final = 0.05
#: Where sets go that :func:`gathering` collects: the folder that they are said to be in, and the one they come into.
_GATHERED: ContextVar[tuple[Path, Path] | None] = ContextVar("gathered", default=None)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path with the same suffix; it takes the place of ``path`` unless the block raises.

    The folder is made where it is missing.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with held.temporary_file(path.parent, path.stem, path.suffix) as temporary:
        yield temporary
        temporary.chmod(0o666 & ~_umask())  # temporary files are made so that only their owner reads them
        try:
            temporary.replace(path)
        except FileNotFoundError:  # the whole folder is being exchanged
            time.sleep(_MOMENT)
            temporary.replace(path)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Write a UTF-8 text file whole."""
    write_bytes(path, content.encode())


@contextmanager
def replacing_set(folder: Path, *, parts: Collection[str] = ()) -> Iterator[Path]:
    """Give an empty folder; what was written into it takes its place in ``folder`` at once, unless the block raises.

    Other files of ``folder`` stay. On Linux everything appears by a single rename. Elsewhere, and where that cannot be
    (a process works in ``folder``, it is a mount point, or it holds more than :data:`MAX_EXCHANGED_FILES` files),
    whole files are renamed one after the other; then a process that is killed between two renames leaves some of both
    sets.

    Args:
        folder: made where it is missing.
        parts: files in ``folder`` that such a set may have: of those, what the new set does not have is removed.
    """
    folder = place(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    inside = folder.is_dir() and (os.path.ismount(folder) or not os.access(folder.parent, os.W_OK))
    with held.temporary_folder(folder if inside else folder.parent, folder.name or "out") as temporary:
        yield temporary
        _put(temporary, folder, parts)


@contextmanager
def gathering(folder: Path, into: Path) -> Iterator[None]:
    """Let every set that is meant for ``folder``, or a folder in it, come into ``into`` while the block runs."""
    token = _GATHERED.set((folder.resolve(), into.resolve()))
    try:
        yield
    finally:
        _GATHERED.reset(token)


def place(folder: Path) -> Path:
    """Where what is meant for a folder comes into: the folder, or what :func:`gathering` has instead."""
    folder, gathered = folder.resolve(), _GATHERED.get()
    if gathered is not None and folder.is_relative_to(gathered[0]):
        return gathered[1] / folder.relative_to(gathered[0])
    return folder


def _umask() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return umask


def _put(new: Path, folder: Path, parts: Collection[str]) -> None:
    """Move the contents of ``new`` into ``folder``."""
    if not folder.exists():
        new.chmod((new.stat().st_mode & stat.S_ISGID) | (0o777 & ~_umask()))  # S_ISGID: files get the folder's group
        try:
            new.rename(folder)
            return
        except OSError:
            if not folder.is_dir():
                raise  # else another process has just made it
    gone = [part for part in parts if not os.path.lexists(new / part)]
    with held.locked(folder):  # one process after the other
        if _exchanged(new, folder, gone):
            return
        try:
            _merge(new, folder)
        except OSError as fault:
            if fault.errno != errno.EXDEV:
                raise
            with held.temporary_folder(folder, folder.name or "out") as near:  # the parent is on another drive
                shutil.copytree(new, near, dirs_exist_ok=True)
                _merge(near, folder)
        for part in gone:
            _remove(folder / part)


def _merge(new: Path, folder: Path) -> None:
    """Move the contents of one folder into another, file by file."""
    for path in sorted(new.iterdir()):
        if path.is_dir() and (folder / path.name).is_dir():
            _merge(path, folder / path.name)
        else:
            path.replace(folder / path.name)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


#: Linux: exchange two names in one step (``renameat2``, linux/fs.h), relative to the working folder (linux/fcntl.h).
_EXCHANGE, _HERE = 2, -100
#: None: not Linux, or an older C library.
_RENAME: Final[Any] = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if sys.platform == "linux" else None


def _exchanged(new: Path, old: Path, gone: Collection[str]) -> bool:
    """Exchange a folder for another one, which takes over files that it lacks; whether that was possible."""
    if _RENAME is None or _somebody_works_in(old):
        return False
    taken = _Taken(new, old, frozenset(gone))
    try:
        taken.take()
        done: int = _RENAME(_HERE, os.fsencode(new), _HERE, os.fsencode(old), _EXCHANGE)
    except OSError:  # something that cannot be linked, or an owner that cannot be kept
        done = -1
    if done != 0:
        taken.give_back()
        return False
    taken.follow()
    return True


def _somebody_works_in(folder: Path) -> bool:
    """Whether a process works in a folder, as far as this one may know."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # another user's, or over
            if Path(os.readlink(process / "cwd")).is_relative_to(folder):
                return True
    return False


class _Taken:
    """Files that a new folder takes over from the old one, as links.

    Args:
        new, old: the folders.
        gone: paths in the old one that are not taken over.
    """

    def __init__(self, new: Path, old: Path, gone: frozenset[str]) -> None:
        self._new, self._old, self._gone = new, old, gone
        self._made: list[Path] = []
        self._seen: dict[Path, int] = {}

    def take(self) -> None:
        """Link every file.

        Raises:
            OSError: something cannot be linked, or there is too much, or a folder's owner or group cannot be kept.
        """
        shutil.copymode(self._old, self._new)
        self._take_owner(Path())
        self._take(Path())

    def _take_owner(self, below: Path) -> None:
        """Give a new folder the owner and the group of the old one: who could write there goes on to."""
        was, now = (self._old / below).stat(), (self._new / below).stat()
        if (was.st_uid, was.st_gid) != (now.st_uid, now.st_gid):
            os.chown(self._new / below, was.st_uid, was.st_gid)

    def _take(self, below: Path) -> None:
        device = self._old.stat().st_dev
        for entry in os.scandir(self._old / below):
            path, status = below / entry.name, entry.stat(follow_symlinks=False)
            target = self._new / path
            self._seen[path] = status.st_ino
            if len(self._seen) > MAX_EXCHANGED_FILES or status.st_dev != device:
                raise OSError(errno.EXDEV, "too many files, or of another drive")
            if str(path) in self._gone:
                continue
            if stat.S_ISDIR(status.st_mode):
                if not os.path.lexists(target):
                    target.mkdir()
                    self._made.append(target)
                if target.is_symlink() or not target.is_dir():
                    raise OSError(errno.EISDIR, "a folder is where a file is to be")
                shutil.copystat(entry.path, target)
                self._take_owner(path)
                self._take(path)
            elif os.path.lexists(target):
                if target.is_dir() and not target.is_symlink():
                    raise OSError(errno.ENOTDIR, "a file is where a folder is to be")
            elif stat.S_ISREG(status.st_mode) or stat.S_ISLNK(status.st_mode):
                os.link(entry.path, target, follow_symlinks=False)
                self._made.append(target)
            else:
                raise OSError(errno.EINVAL, "neither file nor folder")

    def give_back(self) -> None:
        """Remove the links again."""
        for path in reversed(self._made):
            if path.is_dir() and not path.is_symlink():
                path.rmdir()
            else:
                path.unlink()

    def follow(self) -> None:
        """After the exchange: move over what another process has written into the old folder meanwhile."""
        for root, _, files in os.walk(self._new):  # now the old one
            below = Path(root).relative_to(self._new)
            for name in files:
                late = Path(root) / name
                if self._seen.get(below / name) != late.lstat().st_ino:
                    (self._old / below).mkdir(parents=True, exist_ok=True)
                    late.replace(self._old / below / name)
