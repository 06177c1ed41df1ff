"""``tiago-mj diagnose``: from recordings to a verdict, a report and a calibration."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tiago_mj import extra, outputs
from tiago_mj.gap.data.recording import RecordingError, Trial
from tiago_mj.gap.data.trials import LONGEST, MOST_ROWS, too_long
from tiago_mj.progress import Progress

if TYPE_CHECKING:
    from tiago_mj.gap.result import Diagnosis
    from tiago_mj.gap.simulation.plant import Plant
    from tiago_mj.view.beside import Pictures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help="files or folders of recordings")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--env", help="environment that they are compared with, where they do not say")
    what.add_argument("--model", type=Path, help="MJCF file that they are compared with")
    parser.add_argument("--map", type=Path, help="YAML: column to kind and name")
    parser.add_argument(
        "--effects",
        action="append",
        metavar="FILE.yaml|JSON",
        help="effects that are known already, applied first; may be given several times",
    )
    parser.add_argument(
        "--out",
        type=outputs.folder,
        required=True,
        help="folder for report.html, diagnosis.json, calibration.yaml, repaired.xml of a model, scene.html ('[view]')",
    )
    parser.add_argument("--policy", metavar="pi|FILE.zip", help="predict this policy's return before and after")
    parser.add_argument("--trust", action="store_true", help="load FILE.zip although loading runs what it holds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=0, help="threads of the simulations; 0: all processors")
    parser.add_argument("--time-budget", type=float, help="seconds after which the best verdict so far is written")
    parser.add_argument(
        "--without",
        default="",
        metavar="NAME,...",
        help="effects that are left out, as if the library lacked them",
    )
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
    "triples": "adding a third effect to the best",
    "next motion": "choosing the motion to record next",
    "comparing torques": "comparing torques along the motion",
    "narrowing the band": "comparing the slower part of the motion",
    "explaining": "explaining the torques",
    "rivals": "explaining them without each effect in turn",
}


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


def _left(budget: float | None, since: float) -> float | None:
    """Seconds of a budget that loading and reading have left."""
    return None if budget is None else max(budget - (time.monotonic() - since), 0.0)


def run(arguments: argparse.Namespace) -> int:
    """Diagnose, write, and say in short what was found."""
    entered = time.monotonic()
    for name, least in (("jobs", 0), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise ValueError(f"--{name} is {getattr(arguments, name)}: give {least} or more")
    if arguments.time_budget is not None and not arguments.time_budget > 0:
        raise ValueError(f"--time-budget is {arguments.time_budget:g}: give a positive number of seconds")
    extra.load("pandas", "reading recordings")
    threadpool_limits = extra.load("threadpoolctl", "the same answer on every machine").threadpool_limits
    from tiago_mj.gap.data.read import read_recordings

    try:
        defaults = {"robot": arguments.env} if arguments.env else {}
        if arguments.model:
            defaults = {"robot": str(arguments.model)}
        read = read_recordings(
            arguments.recordings, map_file=arguments.map, defaults=defaults, robot=defaults.get("robot")
        )
        # What cannot be used is said before the rest is loaded, which takes a second.
        from tiago_mj.effects import read_effects
        from tiago_mj.gap.data import lint
        from tiago_mj.gap.simulation.plant import plant_of

        given = read_effects(arguments.effects)
        plant = plant_of(read.trials, env=arguments.env, model=arguments.model, given=given)
        findings = (*read.findings, *lint.inspect_all(read.trials, plant))
        lint.refuse(read.trials, findings)
        check_length(read.trials, plant)
        from tiago_mj.gap.pipeline import diagnose
        from tiago_mj.gap.report import json, terminal, write

        usable = lint.believed(read.trials, findings)
        # One thread of linear algebra: the order of its sums must not depend on the machine.
        shown = Progress("diagnose", quiet=arguments.json, budget=arguments.time_budget)
        with threadpool_limits(1), shown as progress:
            diagnosis = diagnose(
                read.trials,
                findings=findings,
                usable=usable,
                env=arguments.env,
                model=arguments.model,
                names=considered(arguments.without),
                given=given,
                seed=arguments.seed,
                threads=arguments.jobs,
                budget=_left(arguments.time_budget, entered),
                policy=arguments.policy,
                trust=arguments.trust,
                tick=Told(progress),
            )
    except RecordingError as fault:
        print(f"tiago-mj diagnose: {fault}", file=sys.stderr)
        return 2
    diagnosis = replace(diagnosis, command=shlex.join(words(arguments)))
    paths = write(diagnosis, arguments.out, _pictures(plant, read.trials, diagnosis))
    if arguments.json:
        print(json.text(diagnosis))
    else:
        terminal.show(diagnosis, paths)
    if diagnosis.ended is None:
        return 0
    return 130 if isinstance(diagnosis.ended, KeyboardInterrupt) else 1


def _pictures(plant: Plant, trials: Sequence[Trial], diagnosis: Diagnosis) -> Pictures | None:
    """The robots to be seen; None where drawing them failed, which must not cost the answer."""
    from tiago_mj.quoting import one_line
    from tiago_mj.view.beside import pictures

    try:
        return pictures(plant, trials, diagnosis)
    except Exception as fault:
        print(f"tiago-mj diagnose: the robots could not be drawn: {one_line(fault)}", file=sys.stderr)
        return None


def words(arguments: argparse.Namespace) -> list[str]:
    """The command line, as it can be run again."""
    out = ["tiago-mj", "diagnose", *(str(path) for path in arguments.recordings)]
    for name in ("env", "model", "map", "effects", "policy", "without", "time_budget"):
        value = getattr(arguments, name)
        several = value if isinstance(value, list) else [value]
        for one in several:
            if one is not None and one != "":
                out += [f"--{name.replace('_', '-')}", str(one)]
    if arguments.trust:
        out.append("--trust")
    return [*out, "--seed", str(arguments.seed), "--out", str(arguments.out)]
