"""``tiago-mj compare``: what changed between two sets of recordings of one robot."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tiago_mj.change import history, report
from tiago_mj.change.comparison import compare, renamed, with_places
from tiago_mj.change.result import AFTER, BEFORE, Comparison, text
from tiago_mj.effects import read_effects
from tiago_mj.gap.command import Told, check_length, considered, terminated_as_interrupted
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.io import extra
from tiago_mj.io.progress import Progress
from tiago_mj.recordings import lint
from tiago_mj.recordings.recording import RecordingError
from tiago_mj.robots import options as robots


def run(arguments: argparse.Namespace) -> int:
    """Compare, write, and say in short what was found.

    Raises:
        ValueError: an argument is unusable; one line.
    """
    for name in ("jobs", "seed"):
        if getattr(arguments, name) < 0:
            raise ValueError(f"--{name} is {getattr(arguments, name)}: give 0 or more")
    with terminated_as_interrupted():
        try:
            return _history(arguments) if arguments.history is not None else _compare(arguments)
        except RecordingError as unusable:
            print(f"tiago-mj compare: {unusable}", file=sys.stderr)
            return 2


def _compare(arguments: argparse.Namespace) -> int:
    if arguments.before is None or arguments.after is None:
        raise ValueError("give two sets, BEFORE and AFTER, or --history FOLDER")
    if arguments.before.resolve() == arguments.after.resolve():
        raise ValueError(f"{arguments.before} is given twice: give the earlier and the later set")
    days = arguments.dates.split(",") if arguments.dates else ["", ""]
    if len(days) != 2:
        raise ValueError(f"--dates {arguments.dates}: write two days with a comma between them")
    found = compared(arguments, arguments.before, arguments.after)
    found = with_places(found, (arguments.before, arguments.after), (days[0].strip(), days[1].strip()))
    paths = report.write(found, arguments.out)
    if arguments.json:
        print(text(found), end="")
    else:
        report.show(found, paths)
    return 0


def _history(arguments: argparse.Namespace) -> int:
    if arguments.before is not None:
        raise ValueError("give two sets or --history FOLDER, not both")
    life = history.read(arguments.history, lambda one, other: compared(arguments, one, other))
    path = history.write(life, arguments.out)
    for line in history.lines(life):
        print(line)
    print(f"Written: {path}")
    return 0


def compared(arguments: argparse.Namespace, before: Path, after: Path) -> Comparison:
    """Read two sets, check them, and compare them.

    Raises:
        RecordingError: a set cannot be used; one line.
    """
    extra.load("pandas", "reading recordings")
    threadpool_limits = extra.load("threadpoolctl", "the same answer on every machine").threadpool_limits
    robot = robots.said(arguments)
    given, sets, findings = read_effects(arguments.effects), [], []
    for which, place in ((BEFORE, before), (AFTER, after)):
        read = robot.read([place], arguments.map)
        trials = renamed(read.trials, which)
        findings += [replace(one, file=f"{which}/{one.file}") for one in read.findings]
        plant = plant_of(trials, env=robot.env, model=robot.model, given=given)
        own = lint.inspect_all(trials, plant)
        lint.refuse(trials, own)
        check_length(trials, plant)
        findings += own
        sets.append(trials)
    whole: Sequence[Any] = [*sets[0], *sets[1]]
    with threadpool_limits(1), Progress("compare", quiet=arguments.json) as progress:
        return compare(
            *sets,
            findings=tuple(findings),
            usable=lint.believed(whole, findings),
            env=robot.env,
            model=robot.model,
            names=considered(arguments.without),
            given=given,
            seed=arguments.seed,
            threads=arguments.jobs,
            tick=Told(progress),
        )
