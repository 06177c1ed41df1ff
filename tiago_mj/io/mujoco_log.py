"""MuJoCo's warnings: counted by kind and told once, instead of a line each on the terminal and in ``MUJOCO_LOG.TXT``.

MuJoCo calls one handler for the whole process (``mju_user_warning``), from whichever thread simulates.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Final

import mujoco

#: Warnings of one kind differ by what follows: a degree of freedom, a time, a size.
DETAIL: Final = re.compile(r"( at DOF \d+|[.,:;]? Time = [-+\d.einfa]+|\d+)")
#: Kinds that :func:`told_once` has told in this process.
_TOLD: Final[set[str]] = set()


def told_once() -> None:
    """Have MuJoCo's warnings told as Python's, one of each kind in a process, and no log file written; unless somebody
    handles them already."""
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_tell_once)


def _tell_once(text: str) -> None:
    said = kind(text)
    if said not in _TOLD:
        _TOLD.add(said)
        with suppress(Warning):  # where warnings are errors: MuJoCo's C code cannot pass one on
            warnings.warn(f"MuJoCo: {said}", RuntimeWarning, stacklevel=2)


@contextmanager
def counted(kinds: Counter[str] | None = None) -> Iterator[Counter[str]]:
    """Count MuJoCo's warnings by kind while the block runs; nothing is printed and no log file is written.

    They are added to ``kinds`` where that is given. What was set before is set again afterwards. Blocks may lie in one
    another: the innermost counts.
    """
    kinds = Counter() if kinds is None else kinds
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: kinds.update([kind(text)]))
    try:
        yield kinds
    finally:
        mujoco.set_mju_user_warning(before)


def tell(kinds: Mapping[str, int]) -> None:
    """Emit warnings that were counted in another process in this one."""
    handler = mujoco.get_mju_user_warning()
    for text, count in kinds.items() if handler is not None else ():
        for _ in range(count):
            handler(text)


def kind(text: str) -> str:
    """Kind of a warning: its text without place and time."""
    return " ".join(DETAIL.sub("", text).split()).replace(",.", ".").rstrip(".,")


def sentences(kinds: Mapping[str, int]) -> tuple[str, ...]:
    """One sentence a kind, the most frequent first."""
    ordered = sorted(kinds.items(), key=lambda item: -item[1])
    return tuple(f"MuJoCo warned {count} time{'s' if count > 1 else ''}: {said}." for said, count in ordered)
