"""A diagnosis as files and on the terminal: ``diagnosis.json``, ``calibration.yaml``, ``report.html``."""

from __future__ import annotations

from pathlib import Path

from tiago_mj import atomic
from tiago_mj.gap.report import calibration, html, json
from tiago_mj.gap.result import Diagnosis


def write(diagnosis: Diagnosis, folder: Path) -> dict[str, Path]:
    """Write all files, each whole or not at all, into ``folder``, which is made where it is missing; paths by name."""
    paths = {name: folder / name for name in ("diagnosis.json", "calibration.yaml", "report.html")}
    page = html.render(diagnosis)
    json.write(diagnosis, paths["diagnosis.json"])
    calibration.write(diagnosis, paths["calibration.yaml"], paths["diagnosis.json"])
    atomic.write_text(paths["report.html"], page)
    return paths
