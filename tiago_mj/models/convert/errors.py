"""Errors that a user of the converter can mend: one line that says where, what and how."""

from __future__ import annotations


class ConversionError(ValueError):
    """The input cannot be converted. The message is one line: file, element, what is wrong, how to mend it."""

    def __init__(self, where: str, what: str, mend: str) -> None:
        super().__init__(" ".join(f"{where}: {what}; {mend}".split()))
