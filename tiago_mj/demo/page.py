"""One HTML file with everything in it: no network, no other file needed."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any, Final

import jinja2

from tiago_mj.demo.arm_torque import HOW_TO_GET
from tiago_mj.demo.report import headline

TYPES: Final = {".png": "image/png", ".mp4": "video/mp4"}


def embedded(content: bytes, suffix: str) -> str:
    """A file as a data URI."""
    return f"data:{TYPES[suffix]};base64,{base64.b64encode(content).decode()}"


def render(data: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    """The page.

    Args:
        data: what ``demo.json`` holds.
        pictures: data URIs by name: ``force`` and ``curve``; ``arm``, ``filmstrip``, ``film`` where they exist.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("tiago_mj.demo", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["fixed"] = lambda value, digits=2: f"{value + 0.0:.{digits}f}".replace("-", "−")
    environment.filters["percent"] = lambda value: f"{100 * value:.0f} %".replace("-", "−")
    template = environment.get_template("demo.html.j2")
    shown = {"filmstrip": None, "film": None, **pictures}
    return template.render(**data, pictures=shown, headline=headline(dict(data)), how_to_get=HOW_TO_GET)
