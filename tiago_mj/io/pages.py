"""HTML pages with names from untrusted files: these are escaped, and a content security policy restricts the page."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import jinja2
from markupsafe import Markup

from tiago_mj.io.quoting import visible

#: Elements have styles of their own, whose colours and places follow from numbers: they cannot run anything.
STYLES = "style-src 'unsafe-inline'"


def environment(package: str) -> jinja2.Environment:
    """Template environment of a package that escapes all values, invisible characters included."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader(package, "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=shown,
    )


def shown(value: Any) -> Any:
    """A value with every text in it visible: characters that are hidden, or turn the direction of others, escaped."""
    if isinstance(value, str):
        return type(value)(visible(value))
    if isinstance(value, Mapping):
        return {shown(key): shown(one) for key, one in value.items()}
    return [shown(one) for one in value] if isinstance(value, (list, tuple)) else value


def of_page(scripts: Sequence[str] = ()) -> Markup:
    """The ``<meta>`` of a page that is one file: nothing is loaded or sent, and no script runs but these.

    Args:
        scripts: texts of its inline scripts, each as it stands between its tags.
    """
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts]
    return _meta(
        "default-src 'none'",
        "script-src " + (" ".join(f"'sha256-{one}'" for one in hashes) or "'none'"),
        STYLES,
        "img-src data: blob:",
        "media-src data:",
    )


def of_application() -> Markup:
    """The same of a page whose program is another project's: it runs what is in the file, and loads and sends nothing
    over a network."""
    inside = "data: blob:"
    return _meta(
        "default-src 'none'",
        f"script-src 'unsafe-inline' 'unsafe-eval' {inside}",
        f"{STYLES} {inside}",
        f"img-src {inside}",
        f"font-src {inside}",
        f"worker-src {inside}",
        f"connect-src {inside}",
    )


def _meta(*rules: str) -> Markup:
    policy = "; ".join((*rules, "base-uri 'none'", "form-action 'none'"))
    return Markup('<meta http-equiv="Content-Security-Policy" content="{}">').format(Markup(policy))
