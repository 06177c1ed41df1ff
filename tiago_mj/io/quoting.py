"""Untrusted values in messages: short, in one line, and without invisible characters."""

from __future__ import annotations

import math
import re
import reprlib
import sys
from collections.abc import Hashable, Iterable, Sequence
from difflib import get_close_matches
from numbers import Real
from pathlib import Path
from typing import Any, Final, TypeGuard

import numpy as np

#: Characters of a value that is quoted in a message.
QUOTED: Final = 60
#: Of a whole number that is written out.
MOST_DIGITS: Final = 40
#: Characters that are not shown: controls but for tab and line ends, line separators, marks and overrides of direction,
#: what has no width, tags, and halves of surrogate pairs.
HIDDEN: Final = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2061-\u206f\ufeff\ufff9-\ufffb"
    "\ud800-\udfff\U000e0000-\U000e007f]"
)


def quoted(value: Any, most: int = QUOTED) -> str:
    """A value for a message, in at most so many characters, invisible ones escaped."""
    text = _SHORT.repr(value)
    return text if len(text) <= most else f"{text[: most - 3]}..."


def unquoted(text: object) -> str:
    """The same of a text, without quotation marks; with them if it is empty."""
    return quoted(str(text))[1:-1] or "''"


def one_line(text: object) -> str:
    """A message without line ends and without characters that cannot be seen."""
    return visible(" ".join(str(text).split()))


def visible(text: str) -> str:
    """A text whose hidden characters are escaped."""
    return HIDDEN.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a finite number within the range of a float; booleans are not."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    return abs(value) <= sys.float_info.max if isinstance(value, int) else math.isfinite(value)


def is_one_of(value: Any, known: Iterable[Any]) -> bool:
    """Whether a value is among others; unhashable values are not."""
    return isinstance(value, Hashable) and value in known


def did_you_mean(name: Any, known: Sequence[str], listed: str = "") -> str:
    """End of a message on an unknown name: the most similar known name, else all.

    Args:
        name: that is unknown.
        known: names that there are.
        listed: where to find them, where they are too many for a line.
    """
    near = []
    if isinstance(name, str) and len(name) <= QUOTED:
        begun = [one for one in known if name and one.startswith(name)]
        near = get_close_matches(name, known, 1, 0.7) or get_close_matches(name.lower(), known, 1, 0.7) or begun
    if near:
        return f"did you mean {near[0]!r}?{f' ({listed})' if listed else ''}"
    return listed or f"use {', '.join(known)}"


class _Short(reprlib.Repr):
    """Representation whose cost does not grow with the size of the value."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 3, QUOTED - 4, QUOTED - 4

    def repr_int(self, x: int, level: int) -> str:
        digits = int(x.bit_length() * math.log10(2)) + 1
        return repr(x) if digits <= MOST_DIGITS else f"a whole number of some {digits} digits"

    def repr_instance(self, x: Any, level: int) -> str:
        if isinstance(x, (str, Path)):
            return self.repr_str(str(x), level)
        if isinstance(x, np.ndarray) and x.size > 8:
            return f"an array of shape {x.shape}"
        if isinstance(x, (float, complex, bytes, bool, np.ndarray, np.generic, type(None), type)):
            return " ".join(super().repr_instance(x, level).split())
        return f"<{type(x).__name__}>"


_SHORT: Final = _Short()
