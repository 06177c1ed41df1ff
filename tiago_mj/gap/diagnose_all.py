"""``tiago-mj diagnose-all``: many folders of recordings, each diagnosed by itself, in many processes.

Every diagnosis is what ``tiago-mj diagnose FOLDER`` writes: this only calls that command, and says in a table what came
of each. A folder that cannot be used keeps no other from its diagnosis.

All of them appear in ``--out`` at once, with the summary. Until then what is finished is kept in a hidden folder beside
``--out``; the same command again goes on from there.
"""

from __future__ import annotations

import argparse
import errno
import hashlib
import importlib.util
import io
import json
import os
import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

from tiago_mj import __version__, cli
from tiago_mj.cli.diagnose_all import SUMMARY
from tiago_mj.effects import EFFECTS
from tiago_mj.gap import faults
from tiago_mj.gap.analysis.promises import CLOSES
from tiago_mj.gap.report import PARTS
from tiago_mj.gap.report.consistency import NAMING
from tiago_mj.gap.report.json import NAME
from tiago_mj.gap.report.words import percent
from tiago_mj.io import atomic, held
from tiago_mj.io.numbers_option import with_numbers
from tiago_mj.io.progress import told
from tiago_mj.robots import options as robots
from tiago_mj.rollout import scale

#: Of the hidden folder: what is finished, and the outcomes of it.
UNFINISHED, OUTCOME = ".{}.unfinished", "outcome.json"
#: What a model may be made of, and files beside it that are looked at.
OF_MODELS: Final = (".xml", ".mjcf", ".urdf", ".obj", ".stl", ".dae", ".msh", ".skn", ".png", ".bin", ".hf")
MOST_BESIDE: Final = 5000
#: What stands in the place of a verdict where a search ended early.
STOPPED: Final = "stopped early"
HEADER: Final = ("folder", "verdict", "effects", "probability", "closed")


@dataclass(frozen=True)
class Task:
    """One diagnosis.

    Attributes:
        words: the command line, of absolute paths.
        out: folder that it is to be in at the end.
        kept: folder that it is kept in until then.
        effects: names that the library must hold.
    """

    words: tuple[str, ...]
    out: str
    kept: str
    effects: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """What came of one.

    Attributes:
        status: exit status of the command.
        complaint: what it said where the status is not 0.
        verdict: ``verdict`` of its ``diagnosis.json``.
        closed: share of the gap that the repair closes; None where unknown.
        complete: whether its search came to its end; else the verdict is none yet.
    """

    status: int
    complaint: str = ""
    verdict: dict[str, Any] | None = None
    closed: float | None = None
    complete: bool = True


def run(arguments: argparse.Namespace) -> int:
    """Diagnose every folder.

    Returns:
        The worst exit status of the diagnoses: 1 before 2 before 0.

    Raises:
        ValueError: an argument is unusable; says which and how to mend it.
    """
    for name in ("seed", "jobs", "threads"):
        if (getattr(arguments, name) or 0) < 0:
            raise ValueError(f"--{name} is {getattr(arguments, name)}: give 0 or more")
    jobs = _jobs(len(arguments.folders)) if arguments.jobs is None else arguments.jobs
    threads = arguments.threads
    if threads is None:
        threads = 0 if jobs == 1 and arguments.backend == "local" else 1
    given = ["--json", "--seed", str(arguments.seed), "--jobs", str(threads)]
    given += robots.words(arguments, absolute=True)
    if not with_numbers(arguments):
        given += ["--numbers", "no"]
    for name in ("without", "time_budget"):
        if getattr(arguments, name):
            given += [f"--{name.replace('_', '-')}", str(getattr(arguments, name))]
    place: Path = arguments.out.resolve()
    kept = place.parent / UNFINISHED.format(place.name)
    tasks = []
    for folder, name in zip(arguments.folders, names(arguments.folders), strict=True):
        words = ("diagnose", str(folder.resolve()), "--out", str(place / name), *given)
        tasks.append(Task(words, str(place / name), str(kept / name), tuple(EFFECTS)))
    with held.alone(kept, "diagnosing"):
        with told("diagnose-all", "diagnosing folders", len(tasks), quiet=arguments.json) as progress:
            outcomes = scale.run_all(
                diagnose, tasks, jobs=jobs, backend=arguments.backend, done=lambda task: progress.advance()
            )
        found = {name: asdict(one) for name, one in zip(names(arguments.folders), outcomes, strict=True)}
        text = json.dumps(found, indent=1, ensure_ascii=False) + "\n"
        _appear(place, {name: Path(task.kept) for name, task in zip(found, tasks, strict=True)}, text)
        for file in kept.glob(f".*.{OUTCOME}"):  # first: a diagnosis of which some files are gone is not finished
            file.unlink()
        shutil.rmtree(kept, ignore_errors=True)
    if arguments.json:
        print(text, end="")
    else:
        print(table(found))
    return next((status for status in (1, 2) if any(one.status == status for one in outcomes)), 0)


def _appear(out: Path, kept: dict[str, Path], summary: str) -> None:
    """Put all diagnoses, tracebacks of faults and the summary into ``out`` at once."""
    told = {
        name: folder
        for name, folder in kept.items()
        if _outcome_file(folder).exists() or (folder / faults.FAULT).exists()
    }
    with atomic.replacing_set(out, parts=[f"{name}/{part}" for name in told for part in PARTS]) as new:
        for name, folder in told.items():
            shutil.copytree(folder, new / name, copy_function=_linked)
        atomic.write_text(new / SUMMARY, summary)


def _linked(source: str, target: str) -> None:
    """A second name of a file, or a copy where that cannot be."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy(source, target)


def _jobs(folders: int) -> int:
    """Processes where nobody says how many: one a processor, where there is more than one folder, joblib is installed,
    and no effect is declared in the user's own program, which other processes do not run."""
    own = any(not declared.__module__.startswith("tiago_mj.") for declared in EFFECTS.values())
    return 1 if folders < 2 or own or importlib.util.find_spec("joblib") is None else 0


def names(folders: Sequence[Path]) -> list[str]:
    """Under which each folder's diagnosis is written.

    Raises:
        ValueError: two have the same.
    """
    found = [folder.resolve().name for folder in folders]
    for name, count in Counter(found).items():
        if count > 1 or not name:
            raise ValueError(
                f"{count} of the folders are called {name!r}, and each diagnosis is written into a folder of that "
                "name: rename one, or diagnose them in two runs"
            )
    return found


def _outcome_file(kept: Path) -> Path:
    return kept.with_name(f".{kept.name}.{OUTCOME}")


def _inputs(task: Task) -> str:
    """Digest of what a diagnosis depends on: the command, the version, every file that it names, and of the models
    whatever lies beside them (meshes, included files) by its size and time."""
    digest = hashlib.sha256(repr((__version__, task.words, task.effects)).encode())
    models: set[Path] = set()
    written = (Path(task.out).parent, Path(task.kept).parent)
    for word in task.words:
        path = Path(word)
        if not path.is_absolute() or word == task.out:
            continue
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                content = file.read_bytes()
                digest.update(f"{file}\0{len(content)}\0".encode() + hashlib.sha256(content).digest())
                models |= _models(file, content)
    for folder in sorted({model.parent for model in models}):
        for file in sorted(islice(folder.rglob("*"), MOST_BESIDE)):
            if file.suffix.lower() in OF_MODELS and not any(file.is_relative_to(one) for one in written):
                status = file.stat()
                digest.update(f"{file}\0{status.st_size}\0{status.st_mtime_ns}\0".encode())
    return digest.hexdigest()


def _models(file: Path, content: bytes) -> set[Path]:
    """The model that a file is, or that a recording's sidecar names."""
    if file.suffix == ".xml":
        return {file}
    try:
        robot = json.loads(content)["robot"] if file.suffix == ".json" else None
    except (ValueError, KeyError, TypeError):
        return set()
    found = file.parent / robot if isinstance(robot, str) and robot.endswith(".xml") else None
    return {found.resolve()} if found is not None and found.is_file() else set()


def diagnose(task: Task) -> Outcome:
    """Diagnose one folder, unless that was finished before the last run was stopped.

    Raises:
        OSError: the drive is full, which is no fault of this folder: the other diagnoses could not be written, either.
    """
    inputs, file = _inputs(task), _outcome_file(Path(task.kept))
    try:
        done = json.loads(file.read_text(encoding="utf-8"))
        if done["inputs"] == inputs and Path(task.kept).is_dir():
            return Outcome(**done["outcome"])
    except (OSError, ValueError, KeyError, TypeError):
        pass  # none is there
    file.unlink(missing_ok=True)
    shutil.rmtree(task.kept, ignore_errors=True)
    with atomic.gathering(Path(task.out), Path(task.kept)):
        outcome = _diagnosed(task)
    if cli.FULL in outcome.complaint:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    if outcome.status == 0:
        atomic.write_text(file, json.dumps({"inputs": inputs, "outcome": asdict(outcome)}))
    return outcome


def _diagnosed(task: Task) -> Outcome:
    """Run the command in this process and read what it wrote."""
    unknown = sorted(set(task.effects) - set(EFFECTS))
    if unknown:
        raise ValueError(
            f"effect {unknown[0]} is declared in your own program, which other processes do not run: use --jobs 1"
        )
    said, complained = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(complained):
            status = cli.main(task.words)
    except SystemExit as stop:  # argparse's
        status = stop.code if isinstance(stop.code, int) else 1
    except Exception as fault:  # one folder's fault must not lose the others' results
        kept = Path(task.kept)
        kept.mkdir(parents=True, exist_ok=True)
        faults.write(fault, kept)
        return Outcome(1, f"{type(fault).__name__}: {' '.join(str(fault).split())}")
    if status:
        return Outcome(status, complained.getvalue().strip().removeprefix("tiago-mj diagnose: "))
    written = json.loads((Path(task.kept) / NAME).read_text(encoding="utf-8"))
    closed, complete = written["shrink"]["closed"], written["complete"]
    return Outcome(0, verdict=written["verdict"], closed=closed, complete=complete)


def _probability(one: dict[str, Any]) -> str:
    """Of a cause that is named and closes some of the gap, where there is one to close."""
    verdict, closed = one["verdict"], one["closed"]
    told = verdict["kind"] in NAMING and verdict["probability"] is not None and (closed is None or closed > CLOSES)
    return percent(verdict["probability"]) if told else "-"


def table(found: dict[str, dict[str, Any]]) -> str:
    """One line a folder, columns aligned."""
    rows: list[tuple[str, ...]] = [HEADER]
    for name, one in found.items():
        verdict = one["verdict"]
        if verdict is None:
            rows.append((name, "failed", one["complaint"], "", ""))
            continue
        effects = ", ".join(effect["name"] for effect in verdict["effects"]) or "-"
        closed = "-" if one["closed"] is None or not verdict["effects"] else percent(one["closed"])
        kind = verdict["kind"] if one["complete"] else STOPPED
        rows.append((name, kind, effects, _probability(one), closed))
    widths = [max(len(row[i]) for row in rows if row[1] != "failed" or i < 2) for i in range(len(HEADER))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )
