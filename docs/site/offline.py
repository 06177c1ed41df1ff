"""Whether a built site can be read without a network."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

#: Elements that make a browser load an address, and the attribute that holds it.
LOADING = {
    "script": ("src",),
    "img": ("src", "srcset"),
    "iframe": ("src",),
    "source": ("src", "srcset"),
    "video": ("src", "poster"),
    "audio": ("src",),
    "object": ("data",),
    "embed": ("src",),
    "link": ("href",),
    "use": ("href",),
}


class _Finder(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "link" and given.get("rel") == "canonical":
            return
        for name in LOADING.get(tag, ()):
            address = given.get(name) or ""
            if address.startswith(("http:", "https:", "//")):
                self.found.append(f"<{tag} {name}={address}>")


def loads_of_others(folder: Path) -> list[str]:
    """What pages and style sheets of a folder load from other hosts: a line each, with the file."""
    complaints = []
    for path in sorted(folder.rglob("*.html")):
        finder = _Finder()
        finder.feed(path.read_text(encoding="utf-8"))
        complaints += [f"{path.relative_to(folder)}: {one}" for one in finder.found]
    for path in sorted(folder.rglob("*.css")):
        text = path.read_text(encoding="utf-8")
        if "url(http" in text or "url(//" in text or "@import" in text:
            complaints.append(f"{path.relative_to(folder)}: url of another host")
    return complaints
