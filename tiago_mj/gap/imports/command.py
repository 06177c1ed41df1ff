"""``tiago-mj import``: other people's recordings, and ROS bags, as recordings of this package."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

from tiago_mj import atomic
from tiago_mj.gap.imports import so101, ta11_curve, tiago_arm, xl330
from tiago_mj.gap.lint import inspect
from tiago_mj.gap.read import read_recordings
from tiago_mj.gap.recording import Trial
from tiago_mj.gap.write import write_trial
from tiago_mj.sensing.load_cell import TA11_SLOPE

#: Importer: trials of a source, each with its folder below the output.
PUBLIC: Final[Mapping[str, Callable[[argparse.Namespace], Iterator[tuple[str, Trial]]]]] = {
    "tiago-arm": lambda arguments: (("", trial) for trial in tiago_arm.trials(arguments.source)),
    "so101": lambda arguments: (
        so101.apart(arguments.source) if arguments.apart else (("", trial) for trial in so101.trials(arguments.source))
    ),
    "xl330": lambda arguments: xl330.trials(arguments.source, arguments.commands),
    "ta11-curve": lambda arguments: ta11_curve.trials(arguments.source, arguments.slope),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument(
        "kind", choices=[*PUBLIC, "bag"], metavar="tiago-arm|so101|xl330|ta11-curve|bag", help="what SRC holds"
    )
    parser.add_argument(
        "source", metavar="SRC", help="folder or bag; 'download' fetches a public data set and checks every file"
    )
    parser.add_argument("--map", type=Path, metavar="FILE", help="YAML: topics of a bag (docs/recordings.md)")
    parser.add_argument("--robot", metavar="ID|FILE.xml", help="of a bag: environment id or MJCF")
    parser.add_argument(
        "--commands",
        choices=xl330.COMMANDS,
        default="torque",
        help="of xl330: what the pendulum is said to be commanded",
    )
    parser.add_argument(
        "--apart",
        action="store_true",
        help="of so101: each joint as a servo of its own, a folder and a model each, motions cut into trials",
    )
    parser.add_argument(
        "--slope",
        type=float,
        default=TA11_SLOPE,
        help="of ta11-curve: sensor units per metre of servo error of the simulator that it is compared with (330)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the recordings")


def run(arguments: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: the source is unusable; one line says what and how to mend it.
    """
    if arguments.kind == "bag":
        trials = _of_bags(arguments)
    else:
        if arguments.map is not None or arguments.robot is not None:
            raise ValueError("--map and --robot are of bags")
        trials = list(PUBLIC[arguments.kind](arguments))
    for folder, trial in trials:
        write_trial(trial, arguments.out / folder)
        if arguments.kind == "xl330":
            atomic.write_text(arguments.out / folder / xl330.MODEL, xl330.model_for(trial))
        elif arguments.kind == "so101" and arguments.apart:
            atomic.write_text(arguments.out / folder / so101.MODEL, so101.servo(folder))
    found = inspect([trial for _, trial in trials])
    print(f"{len(trials)} recording{'s' if len(trials) > 1 else ''} in {arguments.out}")
    for code in dict.fromkeys(finding.code for finding in found):
        listed = dict.fromkeys(finding.channel for finding in found if finding.code == code and finding.channel)
        first = next(finding for finding in found if finding.code == code)
        print(f"  {code}: {', '.join(listed) or first.message}")
    folders = dict.fromkeys(str(arguments.out / folder) for folder, _ in trials)
    print(f"next: tiago-mj diagnose {next(iter(folders))} --out DIR")
    return 0


def _of_bags(arguments: argparse.Namespace) -> list[tuple[str, Trial]]:
    defaults = {"robot": arguments.robot} if arguments.robot else {}
    result = read_recordings([Path(arguments.source)], map_file=arguments.map, defaults=defaults)
    for finding in result.findings:
        print(f"{finding.code}: {finding}")
    return [("", trial) for trial in result.trials]
