"""One HTML file with everything in it: no network, no other file needed."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiago_mj.demo.arm_torque import HOW_TO_GET
from tiago_mj.demo.report import headline
from tiago_mj.io import pages

TYPES: Final = {".png": "image/png", ".jpg": "image/jpeg", ".mp4": "video/mp4"}


def embedded(content: bytes, suffix: str) -> str:
    """A file as a data URI."""
    return f"data:{TYPES[suffix]};base64,{base64.b64encode(content).decode()}"


def photo(frame: NDArray[np.uint8]) -> str:
    """A frame, (height, width, 3), as the data URI of a JPEG."""

    stream = io.BytesIO()
    Image.fromarray(frame).save(stream, format="JPEG", quality=85)
    return embedded(stream.getvalue(), ".jpg")


def render(data: Mapping[str, Any], pictures: Mapping[str, str], strip: str | None) -> str:
    """The page.

    Args:
        data: what ``demo.json`` holds.
        pictures: data URIs by name: ``force`` and ``curve``; ``gap``, ``arm``, ``nominal``, ``repaired``, ``film``
            where they exist.
        strip: data URI of the whole robot's pictures in a row; None where nothing could be rendered.
    """
    environment = pages.environment("tiago_mj.demo")
    environment.filters["fixed"] = lambda value, digits=2: f"{value + 0.0:.{digits}f}".replace("-", "−")
    environment.filters["percent"] = lambda value: f"{100 * value:.0f} %".replace("-", "−")
    template = environment.get_template("demo.html.j2")
    shown = {"film": None, "nominal": None, "repaired": None, "gap": None, **pictures}
    return template.render(
        **data,
        pictures=shown,
        strip=strip,
        headline=headline(dict(data)),
        how_to_get=HOW_TO_GET,
        policy=pages.of_page(),
    )
