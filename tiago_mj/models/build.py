"""The committed models, from the table of numbers.

``python -m tiago_mj.models.build`` writes them, with ``--check`` it compares them and writes nothing:
numbers.yaml -> URDF sources (``models/sources``) -> converter, with the additions beside them -> MJCF
(``models/robots``).
"""

from __future__ import annotations

import argparse
import math
import re
import sys
import tempfile
from pathlib import Path
from typing import Final

from tiago_mj.models.convert import Options, convert
from tiago_mj.models.files import models_folder
from tiago_mj.models.urdf_source import read_table, robot_names, urdf_text

_NUMBER: Final = re.compile(r"(?<![\w.])([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w.])")
#: Processors round differently in the last digits, which is no other model: relative, and absolute (metres, kilograms).
ROUNDING: Final = (1e-9, 1e-14)


def build(folder: Path) -> dict[str, str]:
    """Texts of all files that follow from ``folder/sources``, by path relative to ``folder``; writes none of them."""
    sources = folder / "sources"
    table = read_table(sources / "numbers.yaml")
    texts: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as work:
        for name in robot_names(table):
            texts[f"sources/{name}.urdf"] = urdf_text(table, name)
            urdf = Path(work) / f"{name}.urdf"
            urdf.write_text(texts[f"sources/{name}.urdf"], encoding="utf-8")
            texts[f"robots/{name}.xml"] = convert(
                urdf, extras=sources / f"{name}.yaml", options=Options(scene=False, masses=None)
            ).xml
    return texts


def stale(folder: Path, texts: dict[str, str]) -> list[str]:
    """Files that differ from ``texts`` by more than rounding, or are missing."""
    return [
        name
        for name, text in texts.items()
        if not (folder / name).is_file() or not _same((folder / name).read_text(encoding="utf-8"), text)
    ]


def _same(one: str, other: str) -> bool:
    """Whether two texts are the same apart from how their numbers are rounded."""
    ours, theirs = _NUMBER.split(one), _NUMBER.split(other)  # words and numbers by turns
    return (
        ours[::2] == theirs[::2]
        and len(ours) == len(theirs)
        and all(
            math.isclose(float(a), float(b), rel_tol=ROUNDING[0], abs_tol=ROUNDING[1])
            for a, b in zip(ours[1::2], theirs[1::2], strict=True)
        )
    )


def main(arguments: list[str] | None = None) -> int:
    """Write the models, or compare them; exit status 1 when a committed file is out of date."""
    parser = argparse.ArgumentParser(prog="python -m tiago_mj.models.build", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with the committed files and write nothing")
    check = parser.parse_args(arguments).check
    folder = models_folder()
    texts = build(folder)
    different = stale(folder, texts)
    for name in different:
        if not check:
            (folder / name).write_text(texts[name], encoding="utf-8")
        print(f"{'out of date' if check else 'wrote'}: {name}", file=sys.stderr if check else sys.stdout)
    if not different:
        print(f"up to date: {', '.join(texts)}")
    return 1 if check and different else 0


if __name__ == "__main__":
    sys.exit(main())
