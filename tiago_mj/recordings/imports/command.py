"""``tiago-mj import``: other people's recordings, and ROS bags, as recordings of this package."""

from __future__ import annotations

import argparse
import json
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tiago_mj.io import atomic
from tiago_mj.io.progress import told
from tiago_mj.io.quoting import quoted
from tiago_mj.recordings.imports import lerobot, minari, so101, ta11_curve, tiago_arm, xl330
from tiago_mj.recordings.lint import inspect
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import Finding, Trial
from tiago_mj.recordings.usable import check_trial
from tiago_mj.recordings.write import check_name, write_trial

#: Importer: trials of a source, each with its folder below the output.
PUBLIC: Final[Mapping[str, Callable[[argparse.Namespace], Iterator[tuple[str, Trial]]]]] = {
    "tiago-arm": lambda arguments: (("", trial) for trial in tiago_arm.trials(arguments.source)),
    "so101": lambda arguments: (
        so101.apart(arguments.source) if arguments.apart else (("", trial) for trial in so101.trials(arguments.source))
    ),
    "xl330": lambda arguments: xl330.trials(arguments.source, arguments.commands),
    "ta11-curve": lambda arguments: ta11_curve.trials(arguments.source, arguments.slope),
}

#: Recordings of a user's own robot; the rest are public data sets.
OWN: Final = ("bag", "lerobot", "minari")
#: Options that only some of the kinds take.
_OPTIONS: Final[Mapping[str, tuple[str, ...]]] = {
    "map": ("bag", "minari"),
    "robot": ("bag", "minari"),
    "model": ("lerobot",),
    "units": ("lerobot",),
    "joints": ("lerobot",),
}


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: the source is unusable; one line says what and how to mend it.
    """
    for option, kinds in _OPTIONS.items():
        if getattr(arguments, option) is not None and arguments.kind not in kinds:
            raise ValueError(f"--{option} is of {' and '.join(kinds)}")
    if arguments.kind == "bag":
        trials, said = _of_bags(arguments)
    elif arguments.kind == "lerobot":
        trials, said = _of_lerobot(arguments)
    elif arguments.kind == "minari":
        trials, said = _told(arguments, *minari.read(arguments.source, map_file=arguments.map, robot=arguments.robot))
    else:
        with told("import", arguments.kind, quiet=arguments.json):
            trials, said = list(PUBLIC[arguments.kind](arguments)), ()
    _check(trials)
    paths = []
    with atomic.replacing_set(arguments.out) as new:
        for folder, trial in trials:
            paths.append(arguments.out / folder / write_trial(trial, new / folder).name)
            if arguments.kind == "xl330":
                atomic.write_text(new / folder / xl330.MODEL, xl330.model_for(trial))
            elif arguments.kind == "so101" and arguments.apart:
                atomic.write_text(new / folder / so101.MODEL, so101.servo(folder))
    found = inspect([trial for _, trial in trials])
    if arguments.json:
        print(json.dumps({"recordings": [str(path) for path in paths], "findings": _data((*said, *found))}, indent=1))
        return 0
    print(f"{len(trials)} recording{'s' if len(trials) > 1 else ''} in {arguments.out}")
    for code in dict.fromkeys(finding.code for finding in found):
        listed = dict.fromkeys(finding.channel for finding in found if finding.code == code and finding.channel)
        first = next(finding for finding in found if finding.code == code)
        print(f"  {code}: {', '.join(listed) or first.message}")
    folders = dict.fromkeys(str(arguments.out / folder) for folder, _ in trials)
    modelless = arguments.kind == "lerobot" and arguments.model is None
    folder = shlex.quote(next(iter(folders)))
    print(f"next: tiago-mj diagnose {folder}{' --model FILE.xml' if modelless else ''} --out diagnosis")
    return 0


def _check(trials: Sequence[tuple[str, Trial]]) -> None:
    """Names come from the files: none may lead out of the output, or be another's. Nor may numbers be none. That is
    seen before anything is written.

    Raises:
        ValueError: says which; one line.
    """
    seen: set[tuple[str, str]] = set()
    for folder, trial in trials:
        if folder:
            check_name(folder, "folder name")
        check_name(trial.name)
        check_trial(trial)
        if (folder, trial.name) in seen:
            raise ValueError(f"two recordings would be {quoted(trial.name)}: import them one by one, each to its --out")
        seen.add((folder, trial.name))


#: Trials with their folders below the output, and what was found in reading them.
_Read = tuple[list[tuple[str, Trial]], Sequence[Finding]]


def _of_bags(arguments: argparse.Namespace) -> _Read:
    defaults = {"robot": arguments.robot} if arguments.robot else {}
    result = read_recordings([Path(arguments.source)], map_file=arguments.map, defaults=defaults)
    return _told(arguments, result.trials, result.findings)


def _of_lerobot(arguments: argparse.Namespace) -> _Read:
    model = arguments.model
    return _told(
        arguments,
        *lerobot.read(
            arguments.source,
            model=model,
            robot=None if model is None else Path(os.path.relpath(model, arguments.out)).as_posix(),
            units=arguments.units,
            joints=arguments.joints,
        ),
    )


def _told(arguments: argparse.Namespace, trials: Sequence[Trial], findings: Sequence[Finding]) -> _Read:
    for finding in () if arguments.json else findings:
        print(f"{finding.code}: {finding}")
    return [("", trial) for trial in trials], findings


def _data(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    return [
        {"code": f.code, "file": f.file, "channel": f.channel, "message": f.message, "repaired": f.repaired}
        for f in findings
    ]
