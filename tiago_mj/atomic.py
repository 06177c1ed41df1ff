"""Files that are either whole or not there: written beside their place under another name, then renamed.

A set of files that belong together appears at once (:func:`replacing_set`).
"""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path with the same suffix; it takes the place of ``path`` unless the block raises.

    The folder is made where it is missing.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)  # mkstemp makes files that only their owner reads
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Write a UTF-8 text file whole."""
    write_bytes(path, content.encode())


#: Linux: exchange two names in one step (``renameat2``, linux/fs.h), relative to the working folder (linux/fcntl.h).
_EXCHANGE, _HERE = 2, -100


@contextmanager
def replacing_set(folder: Path) -> Iterator[Path]:
    """Give an empty folder; what was written into it takes its place in ``folder`` at once, unless the block raises.

    Other files of ``folder`` stay. A new folder, and on Linux one that holds files alone, appears by a single rename;
    elsewhere whole files are renamed one after the other.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name or 'out'}."))
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o777 & ~umask)
        made = sorted(path.name for path in temporary.iterdir())
        if not folder.exists():
            temporary.rename(folder)
        elif not _exchanged(temporary, folder):
            for name in made:
                (temporary / name).replace(folder / name)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _exchanged(new: Path, old: Path) -> bool:
    """Put a folder in another's place, with those files of it that it does not have itself; whether that was possible.

    Not where anybody works in the old one: its folder would vanish under the shell.
    """
    if sys.platform != "linux" or old.is_symlink() or old.resolve() == Path.cwd():
        return False
    there = list(old.iterdir())
    if not all(path.is_file() and not path.is_symlink() for path in there):
        return False
    try:
        for path in there:
            if not (new / path.name).exists():
                os.link(path, new / path.name)
        libc = ctypes.CDLL(None, use_errno=True)
        done: int = libc.renameat2(_HERE, os.fsencode(new), _HERE, os.fsencode(old), _EXCHANGE)
    except (OSError, AttributeError):  # another file system, or an older C library
        done = -1
    if done != 0:
        for path in there:
            linked = new / path.name
            if linked.exists() and linked.samefile(path):
                linked.unlink()
        return False
    return True
