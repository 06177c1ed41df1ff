"""The committed models, from the table of numbers: ``python -m tiago_mj.models.build`` writes them, ``--check`` compares them.

numbers.yaml -> URDF sources (``models/sources``) -> converter with the additions beside them -> MJCF (``models/robots``).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tiago_mj.models.convert import convert
from tiago_mj.models.files import models_folder
from tiago_mj.models.urdf_source import read_table, robot_names, urdf_text


def build(sources: Path, robots: Path) -> dict[Path, str]:
    """Texts of all files that follow from the sources, by the path where each belongs.

    Args:
        sources: folder of ``numbers.yaml`` and the additions; the URDF files there are read, not written.
        robots: folder of the MJCF files.
    """
    table = read_table(sources / "numbers.yaml")
    texts = {sources / f"{name}.urdf": urdf_text(table, name) for name in robot_names(table)}
    for name in robot_names(table):
        if (
            not (sources / f"{name}.urdf").is_file()
            or (sources / f"{name}.urdf").read_text() != texts[sources / f"{name}.urdf"]
        ):
            continue  # stale: converted once the URDF is written
        texts[robots / f"{name}.xml"] = convert(sources / f"{name}.urdf").xml
    return texts


def main(arguments: list[str] | None = None) -> int:
    """Write the models, or compare them; exit status 1 when a committed file is out of date."""
    parser = argparse.ArgumentParser(prog="python -m tiago_mj.models.build", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with the committed files and write nothing")
    options = parser.parse_args(arguments)
    folder = models_folder()
    sources, robots = folder / "sources", folder / "robots"
    if not options.check:
        for path, text in build(sources, robots).items():
            path.write_text(text, encoding="utf-8")
    texts = build(sources, robots)
    stale = [path for path, text in texts.items() if not path.is_file() or path.read_text(encoding="utf-8") != text]
    for path in stale:
        print(f"out of date: {path.relative_to(folder)}", file=sys.stderr)
    if not stale:
        print(f"up to date: {', '.join(path.relative_to(folder).as_posix() for path in texts)}")
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
