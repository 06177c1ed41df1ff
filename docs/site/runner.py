"""Run a page as its reader does: ``python -m docs.site.runner docs/tutorials/first-grasp.md``.

In an empty folder with the examples in it, from top to bottom: Python blocks as one program, ``sh`` blocks by a shell,
and a block with ``title="NAME"`` becomes a file of that name. A comment ``<!-- not run: REASON -->`` before a block
leaves it out. A comment ``<!-- check ... -->`` holds Python that the reader does not see: what must hold at that place.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[2]
_STEP: Final = re.compile(
    r"^<!-- check\n(?P<check>.*?)-->$"
    r"|^(?P<left_out><!-- not run: [^\n]+ -->\n)?(?P<fence>`{3,})(?P<kind>\w+)(?P<options>[^\n]*)\n"
    r"(?P<text>.*?)^(?P=fence)$",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Step:
    """One thing that a reader does.

    Attributes:
        kind: ``python``, ``sh`` or ``file``.
        text: what is run or written.
        line: of the page.
        name: of the file.
    """

    kind: str
    text: str
    line: int
    name: str = ""


def steps(page: str) -> list[Step]:
    """What a page has its reader do, in order."""
    found = []
    for one in _STEP.finditer(page):
        line = page.count("\n", 0, one.start()) + 1
        if one["check"] is not None:
            found.append(Step("python", one["check"], line))
            continue
        title = re.search(r'title="([^"]+)"', one["options"])
        if one["left_out"]:
            continue
        if title:
            found.append(Step("file", one["text"], line, title[1]))
        elif one["kind"] in ("python", "sh"):
            found.append(Step(one["kind"], one["text"], line))
    return found


def run(path: Path) -> None:
    """Run a page in the working directory.

    Raises:
        subprocess.CalledProcessError: a command failed.
        Exception: whatever its Python raises.
    """
    shutil.copytree(ROOT / "examples", "examples", dirs_exist_ok=True)
    words = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": words, "PYTHONPATH": str(ROOT)}
    sys.path.insert(0, os.getcwd())  # where the page's own modules are written
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for step in steps(path.read_text(encoding="utf-8")):
        print(f"--- {path.name}:{step.line}: {step.name or step.kind}", flush=True)
        if step.kind == "file":
            Path(step.name).parent.mkdir(parents=True, exist_ok=True)
            Path(step.name).write_text(step.text, encoding="utf-8")
        elif step.kind == "sh":
            subprocess.run(["sh", "-ec", step.text], env=environment, check=True)
        else:
            exec(compile("\n" * step.line + step.text, str(path), "exec"), namespace)


if __name__ == "__main__":
    page = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        run(page)
        os.chdir(ROOT)
