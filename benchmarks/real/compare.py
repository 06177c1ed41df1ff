"""``tiago-mj compare`` on real recordings: the double pendulum with and without friction compensation, and the XL-330
at its gains.

    python -m benchmarks.real.compare --data FOLDER --out DIR [--only NAME,...] [--save NAME]

Along a measured motion the gain of a servo tells nothing, so that of the motor nothing may change; of replayed commands
the gain is all that does.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks import machine
from benchmarks.real import logs
from benchmarks.real.logs import Log
from benchmarks.real.robots import double_pendulum, xl330
from tiago_mj import cli
from tiago_mj.change import command
from tiago_mj.change.result import as_data
from tiago_mj.cli import compare as declared
from tiago_mj.io import atomic, outputs

PROG: Final = "python -m benchmarks.real.compare"


@dataclass(frozen=True)
class Sets:
    """Two sets of recordings of one robot.

    Attributes:
        name: unique.
        before, after: recordings from the user's folder.
        model: the nominal MJCF.
        expected: what is true, in words.
    """

    name: str
    before: Callable[[Path], list[Log]]
    after: Callable[[Path], list[Log]]
    model: Callable[[], str]
    expected: str


def _motor(low: int, high: int) -> Sets:
    return Sets(
        f"xl330-motor-{low}-{high}",
        lambda data: xl330.torques(data, xl330.AT_GAIN[low]),
        lambda data: xl330.torques(data, xl330.AT_GAIN[high]),
        xl330.model,
        "nothing of the motor changed",
    )


def _gain(low: int, high: int) -> Sets:
    return Sets(
        f"xl330-gain-{low}-{high}",
        lambda data: xl330.goals(data, xl330.AT_GAIN[low]),
        lambda data: xl330.goals(data, xl330.AT_GAIN[high]),
        lambda: xl330.model(gain=low),
        f"the servo's stiffness, by the factor {high / low:g} of its register",
    )


SETS: Final = (
    Sets(
        "double-pendulum-compensation",
        lambda data: double_pendulum.logs(data, double_pendulum.AS_IS),
        lambda data: double_pendulum.logs(data, double_pendulum.COMPENSATED),
        double_pendulum.model,
        "the drives' own compensation of friction; the measured torque holds what it adds, so that along the motion "
        "the friction is there as ever",
    ),
    Sets(
        "double-pendulum-other-day",
        lambda data: double_pendulum.logs(data, double_pendulum.AS_IS),
        lambda data: double_pendulum.logs(data, double_pendulum.OTHER_DAY),
        double_pendulum.model,
        "three days; friction of the shoulder is 0.17 N·m by one day's regression and 0.09 by the other's",
    ),
    _motor(100, 200),
    _motor(200, 400),
    _motor(400, 800),
    _gain(100, 200),
    _gain(400, 800),
)


def compared(sets: Sets, data: Path, folder: Path) -> dict[str, Any]:
    """Write both sets and compare them."""
    for which, read in (("before", sets.before), ("after", sets.after)):
        logs.write(read(data), folder / which, sets.model())
    parser = argparse.ArgumentParser()
    declared.add_arguments(parser)
    places = [str(folder / which / logs.RECORDINGS) for which in ("before", "after")]
    model = str(folder / "before" / logs.ROBOT)
    given = parser.parse_args([*places, "--model", model, "--jobs", "1", "--json", "--out", str(folder / "out")])
    begun = time.process_time()
    said = as_data(command.compared(given, given.before, given.after))
    return {**said, "processor_seconds": round(time.process_time() - begun, 1)}


def run(arguments: argparse.Namespace) -> int:
    """Compare what is asked for; goes on where it stopped."""
    wanted = set(arguments.only.split(",")) if arguments.only else {sets.name for sets in SETS}
    found = {}
    for sets in SETS:
        kept = arguments.out / f"{sets.name}.json"
        if sets.name in wanted and not kept.exists():
            atomic.write_text(kept, json.dumps(compared(sets, arguments.data, arguments.out / sets.name)) + "\n")
        if kept.exists():
            said = json.loads(kept.read_text())
            shown = [[change["name"] for change in one["changes"]] for one in said["alternatives"]]
            print(f"{sets.name}: {said['kind']} {shown}, {said['processor_seconds']} s", flush=True)
            short = {key: value for key, value in said.items() if key not in ("findings", "before", "after")}
            found[sets.name] = {"expected": sets.expected, **short, "ranking": said["ranking"][:4]}
    if arguments.save:
        machine.save(arguments.save, found, f"{PROG} --data FOLDER --out DIR --save {arguments.save}")
    return 0


def main(words: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = cli.Parser(prog=PROG, description="Compare sets of real recordings.")
    parser.add_argument("--data", type=Path, required=True, metavar="FOLDER", help="of the published files")
    parser.add_argument("--out", type=outputs.folder, required=True, metavar="DIR", help="goes on where it stopped")
    parser.add_argument("--only", metavar="NAME,...", help="some of the sets")
    parser.add_argument("--save", metavar="NAME", help="write benchmarks/results/NAME.json")
    parser.set_defaults(run=run)
    return cli.guarded(PROG, parser.parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
