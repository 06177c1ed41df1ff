"""Where a command is to write, tried when its command line is read: before any work that would then be lost.

``folder`` and ``file`` are types of ``argparse`` options, and :func:`tiago_mj.view.film.film_file` is one, too. What
cannot be written is said in one line, with exit status 2.
"""

from __future__ import annotations

import os
import stat
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Final

from tiago_mj.io import held
from tiago_mj.io.quoting import one_line, unquoted

#: Bytes that are written and removed again: a full drive takes names, but no content.
TRIED: Final = 4096


def folder(text: str) -> Path:
    """Argparse type: a folder that can be written into, existing or not; nothing is made.

    Raises:
        argparse.ArgumentTypeError: it is something else, or nothing can be written there.
    """
    path = Path(text)
    status = _status(path)
    if status is not None and not stat.S_ISDIR(status.st_mode):
        raise ArgumentTypeError(f"{unquoted(path)}: this is a file: name a folder")
    _try(path, path)
    return path


def file(text: str) -> Path:
    """Argparse type: a file that can be written, existing or not; nothing is made.

    Raises:
        argparse.ArgumentTypeError: it is something else, or nothing can be written there.
    """
    path = Path(text)
    status = _status(path)
    if (status is not None and stat.S_ISDIR(status.st_mode)) or text.endswith(os.sep):
        raise ArgumentTypeError(f"{unquoted(path)}: this is a folder: name a file")
    if status is not None and not stat.S_ISREG(status.st_mode):
        raise ArgumentTypeError(f"{unquoted(path)}: this is a device or a pipe: name a file")
    _try(path.parent, path)
    return path


def _status(path: Path) -> os.stat_result | None:
    """File status of a path; None where nothing exists."""
    try:
        return os.stat(path)
    except FileNotFoundError:
        return None
    except NotADirectoryError:
        above = next(one for one in path.parents if one.exists())
        raise ArgumentTypeError(f"{unquoted(path)}: {unquoted(above)} is a file: name another folder") from None
    except (OSError, ValueError) as fault:
        raise ArgumentTypeError(f"{unquoted(path)}: {_reason(fault)}: give another name") from None


def _try(place: Path, path: Path) -> None:
    """Write something into a folder, or into the one that it would be made in, and remove it again."""
    there = next(one for one in (place, *place.absolute().parents) if one.is_dir())
    try:
        with held.temporary_file(there, "try") as tried:
            tried.write_bytes(bytes(TRIED))
    except OSError as fault:
        raise ArgumentTypeError(
            f"{unquoted(path)}: nothing can be written into {unquoted(there)} ({_reason(fault)}): mend that, or name "
            "another place"
        ) from None


def _reason(fault: Exception) -> str:
    words = fault.strerror if isinstance(fault, OSError) and fault.strerror else str(fault)
    return one_line(words[:1].lower() + words[1:])
