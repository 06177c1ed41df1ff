"""What a declaration's docstring says, part by part: for pages, reports and error messages."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import Final

from tiago_mj.effects.declare import Effect

#: How a labelled paragraph begins, and the field that it fills.
LABELS: Final = {
    "Formula: ": "formula",
    "In a recording: ": "looks",
    "Typical: ": "typical",
    "On the robot: ": "check",
    "Source: ": "source",
    "MuJoCo: ": "native",
}


@dataclass(frozen=True)
class Description:
    """An effect in words; what the docstring does not say is empty.

    Attributes:
        what: what it is; paragraphs are separated by an empty line.
        formula: what it does, by the names of its parameters.
        looks: how it looks in a recording.
        typical: magnitudes that occur, with units.
        check: where to look on the real robot, as half a sentence that begins with a verb.
        source: where those are from; ``chosen`` where nobody measured them.
        native: which field of MuJoCo does it, and if it is not used, why.
    """

    what: str = ""
    formula: str = ""
    looks: str = ""
    typical: str = ""
    check: str = ""
    source: str = ""
    native: str = ""


def describe(declared: type[Effect]) -> Description:
    """Read a declaration's docstring: paragraphs that begin with one of :data:`LABELS`, and the rest."""
    found: dict[str, str] = {}
    what = []
    for block in (inspect.cleandoc(declared.__doc__ or "")).split("\n\n"):
        paragraph = " ".join(block.split())
        label = next((label for label in LABELS if paragraph.startswith(label)), None)
        if label is None:
            what.append(paragraph)
        else:
            found[LABELS[label]] = paragraph.removeprefix(label)
    return Description(what="\n\n".join(what), **found)
