"""``tiago-mj diagnose``: from recordings to a verdict, a report and a calibration."""

from __future__ import annotations

import argparse
import importlib
import math
import shlex
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import current_process
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tiago_mj.cli import options
from tiago_mj.gap.faults import FAULT, FaultError, keeping
from tiago_mj.io import atomic, extra, outputs
from tiago_mj.io.deadline import Deadline, OutOfTimeError
from tiago_mj.io.numbers_option import add_numbers, with_numbers
from tiago_mj.io.progress import Progress
from tiago_mj.io.quoting import one_line
from tiago_mj.recordings.recording import ReadResult, RecordingError, Trial
from tiago_mj.recordings.trials import LONGEST, MOST_ROWS, too_long
from tiago_mj.robots import options as robots

if TYPE_CHECKING:
    from tiago_mj.gap.result import Diagnosis
    from tiago_mj.gap.simulation.plant import Plant
    from tiago_mj.view.beside import Pictures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help="files or folders of recordings")
    options.add_robot(parser)
    options.add_known_effects(parser)
    parser.add_argument(
        "--out",
        type=outputs.folder,
        required=True,
        help="folder for report.html, diagnosis.json, calibration.yaml, repaired.xml of a model, scene.html ('[view]')",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on where a run into the same folder was killed, interrupted or stopped",
    )
    parser.add_argument(
        "--policy", metavar="NAME|FILE|MODULE:FUNCTION", help="predict this policy's return before and after"
    )
    parser.add_argument(
        "--trust", action="store_true", help="load a FILE or MODULE although loading runs code that it holds"
    )
    options.add_seed(parser)
    options.add_threads(parser)
    parser.add_argument("--time-budget", type=float, help="seconds after which the best verdict so far is written")
    options.add_without(parser)
    add_numbers(parser)
    parser.add_argument("--json", action="store_true", help="print diagnosis.json instead of the summary")


def considered(without: str) -> tuple[str, ...] | None:
    """Effects of the library but those; None for all.

    Raises:
        ValueError: there is no such effect.
    """
    from tiago_mj.effects import EFFECTS

    left_out = [name.strip() for name in without.split(",") if name.strip()]
    for name in left_out:
        if name not in EFFECTS:
            raise ValueError(f"--without {name}: there is no such effect: docs/effects.md lists them")
    return tuple(name for name in EFFECTS if name not in left_out) if left_out else None


#: Stages of a diagnosis, in words.
STAGES: Final = {
    "replaying": "replaying the recordings",
    "fitting the nominal model": "fitting the nominal model",
    "screening": "trying effects at several magnitudes",
    "fitting": "fitting the most promising",
    "weighing": "fitting the best of them to all recordings",
    "refitting": "fitting all around the best",
    "lost commands": "looking for commands that were lost",
    "pairs": "adding a second effect to the best",
    "all trials": "fitting the best to the other recordings as well",
    "triples": "adding a third effect to the best",
    "next motion": "choosing the motion to record next",
    "comparing torques": "comparing torques along the motion",
}


#: How long writing the files and drawing the robots take, beside loading the program's parts in the same run: so it is
#: on machines of any speed and load. And the least of it [s], where the parts were there already.
WRITING: Final = (0.5, 0.5)
DRAWING: Final = (1.5, 2.0)


class Told:
    """Progress of a diagnosis, as it tells of it; see :class:`tiago_mj.gap.ahead.Listener`."""

    def __init__(self, progress: Progress, before: str = "") -> None:
        """``before``: words before the name of every stage."""
        self._progress, self._before, self._stage = progress, before, ""

    def __call__(self, stage: str, done: float, left: float | None) -> None:
        """A stage begins, or goes on."""
        if stage != self._stage:
            self._stage = stage
            self._progress.stage(self._before + STAGES.get(stage, stage), part=True)
        self._progress.worked(done, left)


def check_length(trials: Sequence[Trial], plant: Plant) -> None:
    """Refuse what is too long to be replayed again and again. Recordings of a plain model are cut by themselves.

    Raises:
        RecordingError: a recording of commands is longer than :data:`LONGEST` or :data:`MOST_ROWS`.
    """
    if plant.environment is None:
        return
    for trial in trials:
        if trial.commands and too_long(trial):
            raise RecordingError(
                f"{trial.source}: {trial.time[-1]:.0f} s in {len(trial.time)} rows are too long to be replayed as one "
                f"trial, {LONGEST:.0f} s and {MOST_ROWS} rows are the most: cut it where it rests, one motion a file"
            )


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM, as a scheduler or ``timeout`` sends it, ends the work as Ctrl-C does: with an answer. Worker processes,
    whose parents end them that way, are left alone."""
    mine = current_process().name == "MainProcess" and threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def end(number: int, frame: object) -> None:
        raise KeyboardInterrupt("SIGTERM")

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def run(arguments: argparse.Namespace) -> int:
    """Diagnose, write, and say in short what was found."""
    with terminated_as_interrupted():
        return _run(arguments, time.monotonic())


def _run(arguments: argparse.Namespace, entered: float) -> int:
    _check_numbers(arguments)
    deadline = Deadline(math.inf if arguments.time_budget is None else arguments.time_budget, entered)
    extra.load("pandas", "reading recordings")
    threadpool_limits = extra.load("threadpoolctl", "the same answer on every machine").threadpool_limits
    importlib.import_module("tiago_mj.recordings.read")
    loaded = deadline.spent()
    try:
        read = _read(arguments)
        # What cannot be used is said before the rest is loaded, which takes a second.
        from tiago_mj.effects import read_effects
        from tiago_mj.gap.simulation.plant import plant_of
        from tiago_mj.recordings import lint

        given = read_effects(arguments.effects, numbers=with_numbers(arguments))
        plant = plant_of(read.trials, env=arguments.env, model=arguments.model, given=given)
        findings = (*read.findings, *lint.inspect_all(read.trials, plant))
        lint.refuse(read.trials, findings)
        check_length(read.trials, plant)
        checked = deadline.spent()
        from tiago_mj.gap.pipeline import diagnose
        from tiago_mj.gap.report import JOURNAL

        loaded += deadline.spent() - checked
        deadline = deadline.sooner(max(WRITING[0] * loaded, WRITING[1]))
        usable = lint.believed(read.trials, findings)
        # One thread of linear algebra: the order of its sums must not depend on the machine.
        shown = Progress("diagnose", quiet=arguments.json, budget=arguments.time_budget)
        model = arguments.model
        if model is None and plant.file is not None:  # that the recordings name: a report says which
            arguments.model = plant.file
        fault = None
        try:
            with threadpool_limits(1), shown as progress:
                diagnosis = diagnose(
                    read.trials,
                    findings=findings,
                    usable=usable,
                    model=model,
                    given=given,
                    deadline=deadline,
                    tick=Told(progress),
                    journal=atomic.place(arguments.out) / JOURNAL,
                    **_asked(arguments),
                )
            needed = max(DRAWING[0] * loaded, DRAWING[1])
            diagnosis, seen = _pictures(plant, read.trials, diagnosis, deadline, needed)
        except FaultError as met:
            diagnosis, seen, fault = met.answer, None, met.fault
    except RecordingError as unusable:
        print(f"tiago-mj diagnose: {unusable}", file=sys.stderr)
        return 2
    return _written(diagnosis, seen, fault, arguments)


def _asked(arguments: argparse.Namespace) -> dict[str, Any]:
    """What the command line asks of a diagnosis as it stands there."""
    return {
        "env": arguments.env,
        "names": considered(arguments.without),
        "seed": arguments.seed,
        "threads": arguments.jobs,
        "policy": arguments.policy,
        "trust": arguments.trust,
        "command": shlex.join(words(arguments)),
        "resume": arguments.resume,
        "numbers": with_numbers(arguments),
    }


def _check_numbers(arguments: argparse.Namespace) -> None:
    for name, least in (("jobs", 0), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise ValueError(f"--{name} is {getattr(arguments, name)}: give {least} or more")
    if arguments.time_budget is not None and not arguments.time_budget > 0:
        raise ValueError(f"--time-budget is {arguments.time_budget:g}: give a positive number of seconds")


def _read(arguments: argparse.Namespace) -> ReadResult:
    """The recordings, with what the command line says of their robot; the model of a named robot becomes ``model``."""
    robot = robots.said(arguments)
    arguments.model = robot.model
    return robot.read(arguments.recordings, arguments.map)


def _written(
    diagnosis: Diagnosis, seen: Pictures | None, fault: Exception | None, arguments: argparse.Namespace
) -> int:
    """Write the answer and say it in short; the exit status."""
    from tiago_mj.gap.report import advice, json, terminal, write

    paths = write(diagnosis, arguments.out, seen, fault)
    if arguments.json:
        print(json.text(diagnosis))
    else:
        terminal.show(diagnosis, paths)
        if recorded := advice.to_record(diagnosis):
            print(f"To record next: {recorded}")
        print(f"next: {shlex.join(view(arguments))}")
    if FAULT in paths:
        said = f" ({type(fault).__name__}: {one_line(fault)})" if fault is not None else ""
        print(f"tiago-mj diagnose: a fault of this program{said}: {paths[FAULT]} says where", file=sys.stderr)
        return 1
    return 130 if diagnosis.interrupted else 0


def _pictures(
    plant: Plant, trials: Sequence[Trial], diagnosis: Diagnosis, deadline: Deadline, needed: float
) -> tuple[Diagnosis, Pictures | None]:
    """The robots to be seen; None where there is no time for it (``needed`` seconds) or the user ended it, which the
    diagnosis then says.

    Raises:
        FaultError: of drawing; it has the diagnosis as it was.
    """
    if deadline.over(needed) or diagnosis.interrupted:
        note = "The robots are not drawn: " + (
            "the diagnosis was ended early." if diagnosis.interrupted else "the time budget left no time for it."
        )
        return replace(diagnosis, notes=(*diagnosis.notes, note)), None
    from tiago_mj.view.beside import pictures

    try:
        with keeping(lambda fault: diagnosis):
            return diagnosis, pictures(plant, trials, diagnosis, deadline)
    except (OutOfTimeError, KeyboardInterrupt) as end:
        note, stopped = "The robots are not drawn: there was no time for it.", isinstance(end, KeyboardInterrupt)
        return replace(diagnosis, notes=(*diagnosis.notes, note), interrupted=stopped), None


def view(arguments: argparse.Namespace) -> list[str]:
    """The command line that shows these recordings with their diagnosis in a browser."""
    recordings = (str(path) for path in arguments.recordings)
    return ["tiago-mj", "view", *recordings, *robots.words(arguments), "--diagnosis", str(arguments.out)]


def words(arguments: argparse.Namespace) -> list[str]:
    """The command line, as it can be run again."""
    out = ["tiago-mj", "diagnose", *(str(path) for path in arguments.recordings), *robots.words(arguments)]
    for name in ("effects", "policy", "without", "time_budget"):
        value = getattr(arguments, name)
        several = value if isinstance(value, list) else [value]
        for one in several:
            if one is not None and one != "":
                out += [f"--{name.replace('_', '-')}", str(one)]
    out += ["--trust"] if arguments.trust else []
    if not with_numbers(arguments):
        out += ["--numbers", "no"]
    return [*out, "--seed", str(arguments.seed), "--out", str(arguments.out)]
