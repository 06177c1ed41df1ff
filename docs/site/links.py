"""Links of pages to files of the repository that are no pages: these come into the site, too."""

from __future__ import annotations

import posixpath
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

#: A link of Markdown, but for its text: its address and what follows a ``#``.
_LINK: Final = re.compile(r"(?<=\]\()(?P<path>(?![a-z]+:|#)[^)#\s]+)(?P<place>#[^)\s]*)?(?=\))")
#: Where files go that are no pages.
FOLDER: Final = "repository"
#: What a browser shows by itself; other files are shown as text.
SHOWN: Final = (".png", ".json", ".html")
#: Pages whose place in the site is another than in the repository.
MOVED: Final = {
    "README.md": "readme.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "models/PROVENANCE.md": "provenance.md",
    "benchmarks/blind/README.md": "blind-generator.md",
    "benchmarks/user_robots/README.md": "user-robots.md",
}


@dataclass
class Rewriter:
    """Turns addresses in the repository into addresses in the site.

    Attributes:
        root: of the repository.
        files: to be copied: place in the site by path in the repository.
    """

    root: Path
    files: dict[str, str] = field(default_factory=dict)

    def page(self, text: str, at: str, source: str) -> str:
        """A page with its links rewritten.

        Args:
            text: Markdown.
            at: its place in the site.
            source: its path in the repository.

        Raises:
            ValueError: a link leads to nothing in the repository.
        """

        def rewrite(found: re.Match[str]) -> str:
            path = posixpath.normpath(posixpath.join(posixpath.dirname(source), found["path"]))
            target = self._target(path, source, found["path"])
            return posixpath.relpath(target, posixpath.dirname(at) or ".") + (found["place"] or "")

        return _LINK.sub(rewrite, text)

    def _target(self, path: str, source: str, said: str) -> str:
        if path in MOVED:
            return MOVED[path]
        if path.startswith("docs/") and path.endswith((".md", ".png", ".webp")):
            return path.removeprefix("docs/")  # MkDocs says where there is no such page
        found = self.root / path
        if not found.exists():
            raise ValueError(f"{source} links to {said}: there is no {path} in the repository: mend the link")
        if found.is_dir():
            self.files[path] = f"{FOLDER}/{path}.txt"
        else:
            self.files[path] = f"{FOLDER}/{path}" + ("" if found.suffix in SHOWN else ".txt")
        return self.files[path]

    def copy(self, to: Path) -> None:
        """Put the files that pages link to into the site's folder; of a folder, the names of what it holds."""
        for path, place in self.files.items():
            source, target = self.root / path, to / place
            target.parent.mkdir(parents=True, exist_ok=True)
            if source.is_dir():
                held = (entry.name + ("/" if entry.is_dir() else "") for entry in sorted(source.iterdir()))
                listing = "\n".join(name for name in held if not name.startswith((".", "__")))
                target.write_text(f"{path} in the repository holds:\n\n{listing}\n", encoding="utf-8")
            else:
                target.write_bytes(source.read_bytes())
