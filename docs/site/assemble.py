"""Write the site's source: every page, picture and plot, and the configuration that names them."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import yaml

from docs.site import effects, environments, pictures, plots
from docs.site.links import MOVED, Rewriter
from docs.site.mathml import with_formulas
from tiago_mj import ENVIRONMENTS

ROOT: Final = Path(__file__).resolve().parents[2]
DOCS: Final = ROOT / "docs"
HERE: Final = Path(__file__).resolve().parent
#: Comments of Markdown, which tests and programs read.
_COMMENT: Final = re.compile(r"^<!--.*?-->\n?", re.MULTILINE | re.DOTALL)


def pages() -> dict[str, Path]:
    """Pages that somebody wrote: their place in the site, and their file."""
    written = {path.relative_to(DOCS).as_posix(): path for path in sorted(DOCS.rglob("*.md"))}
    return written | {place: ROOT / path for path, place in MOVED.items() if (ROOT / path).exists()}


def rendered(place: str, path: Path, links: Rewriter) -> str:
    """A written page as the site has it."""
    source = path.relative_to(ROOT).as_posix()
    if source == "docs/effects.md":  # each effect has a page there
        return links.page(effects.catalogue(), place, source)
    text = _COMMENT.sub("", path.read_text(encoding="utf-8"))
    return with_formulas(links.page(text, place, source))


def assemble(out: Path, say: Callable[[str], None] = lambda line: None) -> Path:
    """Write the site's source.

    Args:
        out: folder, which is emptied.
        say: is told what is done.

    Returns:
        The configuration's file.
    """
    shutil.rmtree(out, ignore_errors=True)
    folder = out / "pages"
    refresh(out)
    shutil.copytree(DOCS / "images", folder / "images")
    shutil.copy(HERE / "style.css", folder / "style.css")
    why = pictures.possible()
    say(f"no pictures of the environments: {why}" if why else f"rendering {len(ENVIRONMENTS)} environments")
    if not why:
        for name in ENVIRONMENTS:
            pictures.draw(name, folder / "environments" / f"{name}.png")
            pictures.film(name, folder / "environments" / f"{name}.webp")
    _write(folder / "environments" / "index.md", environments.overview(not why))
    for name in ENVIRONMENTS:
        _write(folder / "environments" / f"{name}.md", environments.page(name, not why))
    say(f"plotting {len(effects.LIBRARY)} effects")
    for name in effects.LIBRARY:
        _write(folder / "effects" / f"{name}.md", effects.page(name, plots.draw(name), plots.caption(name)))
    _write(out / "mkdocs.yml", yaml.safe_dump(configuration(), sort_keys=False, allow_unicode=True))
    return out / "mkdocs.yml"


def refresh(out: Path, changed_since: float = 0.0) -> int:
    """Write the pages that somebody wrote, those alone whose file is newer than a time [s]; how many these are."""
    links = Rewriter(ROOT)
    newer = {place: path for place, path in pages().items() if path.stat().st_mtime > changed_since}
    for place, path in newer.items():
        _write(out / "pages" / place, rendered(place, path, links))
    links.copy(out / "pages")
    return len(newer)


def configuration() -> dict[str, Any]:
    """MkDocs' configuration, with the generated pages in its navigation."""
    found: dict[str, Any] = yaml.safe_load((HERE / "mkdocs.yml").read_text(encoding="utf-8"))
    stages: dict[str, list[str]] = {}
    for name, declared in effects.LIBRARY.items():
        stages.setdefault(effects.title(declared.stage), []).append(f"effects/{name}.md")
    generated: dict[str, list[Any]] = {
        "@environments": [
            {title: [f"environments/{name}.md" for name in names]} for title, names in environments.families().items()
        ],
        "@effects": [{stage: listed} for stage, listed in stages.items()],
    }
    for section in found["nav"]:
        for title, entries in section.items():
            section[title] = [one for entry in entries for one in _entries(entry, generated)]
    next(one["mkdocstrings"] for one in found["plugins"] if isinstance(one, dict))["handlers"]["python"]["paths"] = [
        str(ROOT)
    ]
    return found


def _entries(entry: Any, generated: dict[str, list[Any]]) -> list[Any]:
    return generated.get(entry, [entry]) if isinstance(entry, str) else [entry]


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
