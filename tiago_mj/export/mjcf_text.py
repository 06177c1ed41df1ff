"""An MJCF and the files that it includes as text whose elements can be edited: all else stays, byte by byte."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

#: An attribute within a start tag.
_ATTRIBUTE: Final = re.compile(rb"(\s+)([\w:.-]+)(\s*=\s*)(\"[^\"]*\"|'[^']*')")
#: Elements that only hold others: what they hold stands as if it stood where they do.
_THROUGH: Final = ("include", "mujocoinclude")
#: Attributes that name a file of numbers or a picture.
_FILES: Final = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
_DIRECTORIES: Final = ("meshdir", "texturedir", "assetdir")


@dataclass(eq=False)
class Element:
    """An element of a file.

    Attributes:
        document: that it stands in.
        name: of the element, such as ``joint``.
        attributes: as they are written.
        start, end: of its start tag [bytes].
        close: where its end tag begins [bytes], if it has one.
        parent: the element that holds it, includes seen through; None: it is the root.
    """

    document: Document
    name: str
    attributes: dict[str, str]
    start: int
    end: int
    close: int
    parent: Element | None

    def ancestors(self) -> Iterator[Element]:
        """From the parent to the root."""
        above = self.parent
        while above is not None:
            yield above
            above = above.parent

    @property
    def after(self) -> int:
        """Where the element ends [bytes]."""
        if self.document.data[self.end - 2 : self.end] == b"/>":
            return self.end
        return self.document.data.index(b">", self.close) + 1


@dataclass(eq=False)
class Document:
    """A file, and what is to be changed in it.

    Attributes:
        path: of the file.
        data: its bytes.
        elements: in the order of their start tags.
        tags: new names and attributes of start tags, by element; an attribute of None is taken away.
        insertions: text by place [bytes].
    """

    path: Path
    data: bytes
    elements: list[Element] = field(default_factory=list)
    tags: dict[Element, tuple[str, dict[str, str | None]]] = field(default_factory=dict)
    insertions: list[tuple[int, str]] = field(default_factory=list)

    def edited(self) -> bytes:
        """The file's bytes with all changes."""
        edits = [(at, at, text.encode()) for at, text in self.insertions]
        edits += [(e.start, e.end, _tag(self.data[e.start : e.end], *new)) for e, new in self.tags.items()]
        out = self.data
        for start, end, new in sorted(edits, key=lambda edit: edit[0], reverse=True):
            out = out[:start] + new + out[end:]
        return out


class Mjcf:
    """A main file and those that it includes.

    Args:
        path: of the main file.

    Raises:
        ValueError: a file is no XML, or cannot be read; one line.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.resolve()
        self.documents: list[Document] = []
        self.elements: list[Element] = []
        self._read(self.path, None)

    def _read(self, path: Path, parent: Element | None) -> None:
        document = Document(path, path.read_bytes())
        self.documents.append(document)
        _parse(document, parent)
        for element in document.elements:
            self.elements.append(element)
            if element.name == "include" and "file" in element.attributes:
                # MuJoCo looks for it from the main file's folder, wherever the include stands.
                included = (self.path.parent / element.attributes["file"]).resolve()
                if included.is_file() and included not in [one.path for one in self.documents]:
                    self._read(included, element.parent)

    def joint(self, name: str) -> Element | None:
        """A body's joint of that name; None: it is not written out."""
        return next((e for e in self._named("joint", name) if _within(e, "worldbody")), None)

    def body(self, name: str) -> Element | None:
        """A body of that name; None: it is not written out."""
        return next(self._named("body", name), None)

    def actuator(self, name: str) -> Element | None:
        """An actuator of that name, of any kind; None: it is not written out."""
        named = (e for e in self.elements if e.attributes.get("name") == name)
        return next((e for e in named if e.parent is not None and e.parent.name == "actuator"), None)

    def first(self, name: str) -> Element | None:
        """The first element of that name right below the root; None: there is none."""
        below = (e for e in self.elements if e.name == name and e.parent is not None and e.parent.parent is None)
        return next(below, None)

    def children(self, parent: Element) -> list[Element]:
        """Elements right below another."""
        return [element for element in self.elements if element.parent is parent]

    def setting(self, section: str, attribute: str) -> str | None:
        """An attribute of a section that may stand several times, the last of which counts; None: it is not said."""
        said = [e.attributes[attribute] for e in self.elements if e.name == section and attribute in e.attributes]
        return said[-1] if said else None

    @property
    def in_degrees(self) -> bool:
        """Whether angles are written in degrees."""
        return (self.setting("compiler", "angle") or "degree") == "degree"

    def files(self) -> list[Path]:
        """Files that the model needs beside its XML, as far as they are named by a path within a folder."""
        said = {name: self.setting("compiler", name) or "" for name in _DIRECTORIES}
        folders = [self.path.parent / one for one in dict.fromkeys(["", *said.values()])]
        wanted = [
            name
            for element in self.elements
            if element.name != "include"
            for key, name in element.attributes.items()
            if key in _FILES and not Path(name).is_absolute()
        ]
        found = [(folder / name).resolve() for name in dict.fromkeys(wanted) for folder in folders]
        return [path for path in dict.fromkeys(found) if path.is_file()]

    def set(self, element: Element, attributes: Mapping[str, str | None], name: str | None = None) -> None:
        """Change an element's attributes (None takes one away), and its name where one is given."""
        before_name, before = element.document.tags.get(element, (element.name, {}))
        element.document.tags[element] = (name or before_name, {**before, **attributes})

    def insert_first(self, parent: Element, text: str) -> None:
        """Write a line as an element's first child."""
        indent = _indent(parent) + self._step(parent)
        parent.document.insertions.append((parent.end, f"\n{indent}{text}"))

    def insert_after(self, element: Element, text: str) -> None:
        """Write a line after an element."""
        element.document.insertions.append((element.after, f"\n{_indent(element)}{text}"))

    def append(self, text: str) -> None:
        """Write lines at the end of the main file, within the root."""
        root = self.documents[0].elements[0]
        self.documents[0].insertions.append((root.close, f"{text}\n"))

    def _step(self, parent: Element) -> str:
        """What a child is indented by more than its parent."""
        own = _indent(parent)
        for child in self.children(parent):
            if child.document is parent.document and (there := _indent(child)).startswith(own) and there != own:
                return there[len(own) :]
        return "  "

    def _named(self, kind: str, name: str) -> Iterator[Element]:
        return (e for e in self.elements if e.name == kind and e.attributes.get("name") == name)


def _parse(document: Document, parent: Element | None) -> None:
    parser = expat.ParserCreate()
    stack: list[Element] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        begin = parser.CurrentByteIndex
        above = stack[-1] if stack else None
        if above is not None and (above.name in _THROUGH or (parent is not None and len(stack) == 1)):
            above = parent  # an included file's root stands for what it holds
        element = Element(document, name, attributes, begin, _end(document.data, begin), begin, above)
        document.elements.append(element)
        stack.append(element)

    def end(_: str) -> None:
        stack.pop().close = parser.CurrentByteIndex

    def entity(*_: object) -> None:
        raise ValueError(f"model {document.path.name} declares an XML entity: write out what it stands for")

    parser.StartElementHandler, parser.EndElementHandler, parser.EntityDeclHandler = start, end, entity
    try:
        parser.Parse(document.data, True)
    except expat.ExpatError as fault:
        raise ValueError(f"model {document.path.name} is no XML: {fault}") from fault


def _end(data: bytes, start: int) -> int:
    """Where a start tag ends [bytes]."""
    quote = b""
    for at in range(start, len(data)):
        one = data[at : at + 1]
        if quote:
            quote = b"" if one == quote else quote
        elif one in (b'"', b"'"):
            quote = one
        elif one == b">":
            return at + 1
    return len(data)


def _within(element: Element, name: str) -> bool:
    return any(above.name == name for above in element.ancestors())


def _indent(element: Element) -> str:
    """Blanks before an element, if nothing else stands on its line before it."""
    data = element.document.data
    line = data[data.rfind(b"\n", 0, element.start) + 1 : element.start]
    return line[: len(line) - len(line.lstrip())].decode()


def _tag(source: bytes, name: str, attributes: Mapping[str, str | None]) -> bytes:
    """A start tag with other attributes: those that are there in their places, new ones at its end."""
    left = dict(attributes)

    def changed(match: re.Match[bytes]) -> bytes:
        key = match[2].decode()
        if key not in left:
            return match[0]
        value = left.pop(key)
        return b"" if value is None else match[1] + match[2] + match[3] + quoteattr(value).encode()

    old = re.match(rb"<[^\s/>]+", source)
    assert old is not None
    body = _ATTRIBUTE.sub(changed, source[old.end() :])
    tail = re.search(rb"\s*/?>$", body)
    assert tail is not None
    added = "".join(f" {key}={quoteattr(value)}" for key, value in left.items() if value is not None)
    return b"<" + name.encode() + body[: tail.start()] + added.encode() + body[tail.start() :]
