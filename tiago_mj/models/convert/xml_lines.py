"""XML with line numbers, and without document types (an entity bomb is refused before it expands)."""

from __future__ import annotations

from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET
from xml.parsers import expat

from tiago_mj.io.loading import is_pipe
from tiago_mj.models.convert.errors import ConversionError

Lines = dict[ET.Element, int]
#: Of a file [bytes]; a humanoid's URDF has 0.2 MB.
BYTES: Final = 16_000_000
#: Elements of a file, and of each other.
ELEMENTS: Final = 100_000
DEPTH: Final = 64


def parse(path: Path) -> tuple[ET.Element, Lines]:
    """The root element of a file, and the line of every element.

    Raises:
        ConversionError: the file cannot be read, is not well-formed, or declares a document type.
    """
    if is_pipe(path):
        raise ConversionError(str(path), "is a pipe", "give the path of a URDF file")
    try:
        with path.open("rb") as file:
            text = file.read(BYTES + 1)
    except OSError as error:
        raise ConversionError(str(path), f"cannot be read ({error.strerror})", "give the path of a URDF file") from None
    if len(text) > BYTES:
        raise ConversionError(str(path), f"has more than {BYTES // 1_000_000} MB", "keep meshes in files of their own")
    builder = ET.TreeBuilder()
    lines: Lines = {}
    parser = expat.ParserCreate()
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEPTH or len(lines) >= ELEMENTS:
            what = f"has more than {ELEMENTS} elements, or {DEPTH} within each other"
            raise ConversionError(f"{path}:{parser.CurrentLineNumber}", what, "give a robot's URDF")
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse_doctype(*_: object) -> None:
        where = f"{path}:{parser.CurrentLineNumber}"
        raise ConversionError(where, "declares a document type (<!DOCTYPE>)", "remove it: URDF needs none")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        where = f"{path}:{error.lineno}"
        raise ConversionError(where, f"is not well-formed XML ({reason})", "mend the markup at this line") from None
    except (LookupError, ValueError) as error:
        if isinstance(error, ConversionError):
            raise
        raise ConversionError(str(path), f"has an unreadable encoding ({error})", "save it as UTF-8") from None
    return builder.close(), lines
