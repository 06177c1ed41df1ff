"""Errors that a user of the converter can mend: one line that says where, what and how."""

from __future__ import annotations

from typing import Final

from tiago_mj.io.quoting import one_line

#: Characters of each part of a message.
_LONGEST: Final = 500


class ConversionError(ValueError):
    """The input cannot be converted. The message is one line: file, element, what is wrong, how to mend it."""

    def __init__(self, where: str, what: str, mend: str) -> None:
        parts = (part if len(part) <= _LONGEST else f"{part[:_LONGEST]}..." for part in (where, what, mend))
        super().__init__(one_line("{}: {}; {}".format(*parts)))
