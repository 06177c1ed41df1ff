"""Lines that documents, reports and outputs print for a reader to run: found, and run as they stand."""

from __future__ import annotations

import contextlib
import html
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
#: Documents of users, and of those who contribute.
PAGES: Final = (
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "notebooks" not in path.parts),
)
_BLOCK: Final = re.compile(
    r"(?P<not_run><!-- not run: [^\n]+ -->\n)?"
    r"^(?P<indent> *)```(?P<kind>\w*)(?P<options>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$",
    re.DOTALL | re.MULTILINE,
)
#: What a command begins with.
PROGRAMS: Final = r"(?:[\w./~-]*/)?(?:mkdir|tiago-mj|python3?(?:\.11)?|pip|ray|marimo|tensorboard|rosbag|xacro)"
_COMMAND: Final = re.compile(rf"(?:[A-Z_]+=\S+ )?{PROGRAMS} ?\S*")
#: A line of a shell that only sets the stage for the next ones of its block.
_SETS: Final = re.compile(r"cd \S+|[A-Z]+=\S+|\. \S+/activate")


@dataclass(frozen=True)
class Printed:
    """One command, or one snippet of Python.

    Attributes:
        where: page and line, or which output.
        kind: ``sh`` or ``python``.
        text: as printed; what only sets the stage for it (``cd``, a variable) stands before it.
    """

    where: str
    kind: str
    text: str

    @property
    def page(self) -> str:
        return self.where.partition(":")[0]


def blocks(path: Path) -> Iterator[tuple[int, str, str, str]]:
    """(line, kind, options, text without its indent) of the code blocks of a page."""
    page = path.read_text(encoding="utf-8")
    for one in _BLOCK.finditer(page):
        line = page.count("\n", 0, one.start("text")) + 1
        text = re.sub(rf"^{one['indent']}", "", one["text"], flags=re.MULTILINE)
        yield line, one["kind"], one["options"], text


def of_page(path: Path) -> list[Printed]:
    """What a page prints in blocks, in its order; a file that a block shows (``title="a.py"``) is no line."""
    name, found = path.relative_to(ROOT).as_posix(), []
    for line, kind, options, text in blocks(path):
        if "title=" in options:
            continue
        if kind == "python":
            found.append(Printed(f"{name}:{line}", kind, text))
        elif kind == "sh" or (not kind and _COMMAND.match(text)):
            found += [Printed(f"{name}:{line + offset}", "sh", one) for offset, one in commands(text)]
    return found


def in_prose(path: Path) -> list[Printed]:
    """Whole commands within the sentences of a page: a program and what it is given."""
    name = path.relative_to(ROOT).as_posix()
    page = path.read_text(encoding="utf-8")
    prose = _BLOCK.sub(lambda block: "\n" * block[0].count("\n"), page)
    spans = ((one[1], prose.count("\n", 0, one.start()) + 1) for one in re.finditer(r"`([^`\n]+)`", prose))
    return [Printed(f"{name}:{line}", "sh", code) for code, line in spans if is_command(code)]


def is_command(code: str) -> bool:
    """Whether it is a program with something given to it, rather than its name or that of one of its commands."""
    return bool(_COMMAND.match(code)) and code.count(" ") >= (2 if "tiago-mj" in code.partition(" ")[0] else 1)


def commands(block: str) -> Iterator[tuple[int, str]]:
    """(offset of its line, text) of every command of a shell's block."""
    stage: list[str] = []
    held: list[str] = []
    for offset, line in enumerate(block.splitlines()):
        held.append(line)
        text = "\n".join(held)
        if line.endswith("\\") or (text.startswith("for ") and line.strip() != "done"):
            continue
        held = []
        bare = re.sub(r"\s+#\s.*$", "", line).strip() if "\n" not in text else text
        if not bare or bare.startswith("#"):
            continue
        if _SETS.fullmatch(bare):
            stage.append(bare)
            continue
        yield offset - text.count("\n"), "\n".join([*stage, text])


def of_report(page: str, where: str) -> list[Printed]:
    """What a report's page prints: its blocks, and whole commands within its sentences."""
    found = []
    for tag, text in re.findall(r"<(pre|code)\b[^>]*>(.*?)</\1>", page, re.DOTALL):
        said = html.unescape(re.sub(r"<[^>]+>", "", text)).strip()
        if tag == "pre" and re.search(r"^(?:import |from |env = |robot = )", said, re.MULTILINE):
            found.append(Printed(where, "python", said))
        elif tag == "pre":
            found += [Printed(where, "sh", one) for _, one in commands(said)]
        elif is_command(said):
            found.append(Printed(where, "sh", said))
        elif re.match(r"import \w|(?:gymnasium\.make|tiago_mj\.gap\.apply)\(", said):
            found.append(Printed(where, "python", said))
    return list(dict.fromkeys(found))


#: How an output says that something may be run.
_SAYS: Final = re.compile(
    r"(?:(?:[Nn]ext|look at it|with|mend|try|run|then|or|bash|reinstall it|here):?|by:) '?"
    rf"(?P<command>{PROGRAMS} [^\n;]+?)(?= \(see|[\n;]|$)|"
    rf"^ +(?P<alone>{PROGRAMS} [^\n]+)$",
    re.MULTILINE,
)


def of_output(text: str, where: str) -> list[Printed]:
    """What an output suggests to run."""
    shell = [Printed(where, "sh", (one["command"] or one["alone"]).strip()) for one in _SAYS.finditer(text)]
    return shell + [Printed(where, "python", one[1]) for one in re.finditer(r"^#? +(import \w.*)$", text, re.MULTILINE)]


@dataclass(frozen=True)
class Way:
    """How far a line is run.

    Attributes:
        to: ``end``: until it ends; ``line``: until it prints its first line; ``answer``: until it serves its page;
            ``display``: until it shows a window, or complains that there is no display.
        seconds: that it may take until then.
    """

    to: str = "end"
    seconds: float = 900.0


def run(line: Printed, way: Way, folder: Path, environment: Mapping[str, str]) -> str:
    """Run a line; what went wrong, empty where nothing did."""
    words: Sequence[str | Path] = ("bash", "-ec", line.text)
    if line.kind == "python":
        program = folder / ".snippet.py"
        program.write_text(line.text, encoding="utf-8")
        words = ("python", program.name)
    said = folder / ".said"
    with said.open("wb") as output:
        process = subprocess.Popen(
            words,
            cwd=folder,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            return _watch(process, way, said)
        finally:
            _end(process)


def _watch(process: subprocess.Popen[bytes], way: Way, said: Path) -> str:
    since = time.monotonic()
    while process.poll() is None and time.monotonic() < since + way.seconds:
        text = said.read_text(encoding="utf-8", errors="replace")
        if way.to == "line" and text.strip() and "Traceback" not in text:
            time.sleep(1.0)
            break
        if way.to == "answer" and (address := re.search(r"http://[\w.]+:\d+", text)) and _answers(address[0]):
            return ""
        time.sleep(0.1)
    text = said.read_text(encoding="utf-8", errors="replace")
    told = f": …{text[-1500:]}" if text.strip() else ": it said nothing"
    if way.to == "answer":
        return f"it served no page within {way.seconds:.0f} s{told}"
    if way.to == "display" and (process.poll() is None or _lacks_display(text)):
        return ""
    if process.poll() is None:
        return "" if text.strip() or way.to == "line" else f"nothing came of it within {way.seconds:.0f} s"
    return f"exit status {process.returncode}{told}" if process.returncode else ""


def _answers(address: str) -> bool:
    with contextlib.suppress(OSError), urllib.request.urlopen(address, timeout=5) as answer:
        return answer.status == 200
    return False


def _lacks_display(text: str) -> bool:
    return re.search(r"DISPLAY|GLFW|[Dd]isplay", text) is not None and "Error opening file" not in text


def _end(process: subprocess.Popen[bytes]) -> None:
    """As with Ctrl-C, and by force where that is not enough: it and all that it started."""
    for how, patience in ((signal.SIGINT, 15), (signal.SIGKILL, 5)):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, how)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(patience)
            if how is signal.SIGINT:
                continue


def clone(folder: Path) -> Path:
    """A copy of the checkout as it stands, in a repository of its own, as a clone is."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@example.org"]
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-q", "-m", "a clone"]):
        subprocess.run([*git, *words], cwd=folder, check=True, capture_output=True)
    return folder


def environment(folder: Path, scripts: Path | None = None) -> dict[str, str]:
    """Of a reader who has activated the environment: this interpreter's with the copy's code, or another's."""
    given = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    given.pop("PYTHONPATH", None)
    if scripts is None:
        given["PYTHONPATH"] = str(folder)
    here = Path(sys.executable).parent
    others = [one for one in os.environ["PATH"].split(os.pathsep) if scripts is None or Path(one) != here]
    given["PATH"] = os.pathsep.join([str(scripts or here), *others])
    given["HOME"] = str(folder / ".home")
    (folder / ".home").mkdir(exist_ok=True)
    given.setdefault("PIP_CACHE_DIR", str(Path.home() / ".cache" / "pip"))
    return given
