"""Findings for people: one line for each kind, with the columns and recordings that it concerns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tiago_mj.recordings.recording import CODES, Finding

#: What differs between findings of one kind: columns, names in quotes, numbers.
_PARTICULAR: Final = re.compile(
    r"(?:position|velocity|effort|force|command)\.[\w./-]*\w|'[^']*'|[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
)
#: Columns and recordings that are listed by name.
LISTED: Final = 3


@dataclass(frozen=True)
class Found:
    """Findings of one kind.

    Attributes:
        code: of all of them.
        message: theirs where they say the same, else the first one's.
        alike: whether all say the same.
        repaired, discredits, refuses: of all of them.
        channels, files: that they concern, each once.
    """

    code: str
    message: str
    alike: bool
    repaired: bool
    discredits: bool
    refuses: bool
    channels: tuple[str, ...]
    files: tuple[str, ...]

    @property
    def columns(self) -> str:
        """The columns, or how many they are; "" where the recordings as a whole are concerned."""
        return _listed([name for name in self.channels if name], "columns")

    @property
    def recordings(self) -> str:
        """The recordings, or how many they are."""
        return _listed(self.files, "recordings")

    @property
    def what(self) -> str:
        """The message, as an example where the others differ."""
        return self.message if self.alike else f"such as: {self.message}"

    def __str__(self) -> str:
        """The line that a user reads."""
        where = ", ".join(filter(None, (self.recordings, self.columns)))
        return f"{self.code}: {where}: {self.what}"


def summary(findings: Sequence[Finding]) -> list[Found]:
    """Findings of one kind as one: those that refuse first, then channels left out of use, the repaired last."""
    kinds: dict[tuple[str, str, bool, bool, bool], list[Finding]] = {}
    for f in findings:
        key = (f.code, _PARTICULAR.sub("#", f.message), f.repaired, f.discredits, f.refuses)
        kinds.setdefault(key, []).append(f)
    rows = [
        Found(
            code=some[0].code,
            message=some[0].message,
            alike=len({f.message for f in some}) == 1,
            repaired=some[0].repaired,
            discredits=some[0].discredits,
            refuses=some[0].refuses,
            channels=tuple(dict.fromkeys(f.channel for f in some)),
            files=tuple(dict.fromkeys(f.file for f in some)),
        )
        for some in kinds.values()
    ]
    return sorted(rows, key=lambda row: (not row.refuses, row.repaired, not row.discredits, CODES.index(row.code)))


def _listed(names: Sequence[str], kind: str) -> str:
    if len(names) <= LISTED:
        return ", ".join(names)
    return f"{names[0]} and {len(names) - 1} more {kind}"
