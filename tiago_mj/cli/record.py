"""What ``tiago-mj record`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.cli import options
from tiago_mj.io import outputs
from tiago_mj.io.numbers_option import add_numbers


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    robot = parser.add_mutually_exclusive_group(required=True)
    robot.add_argument("--env", metavar="ID", help="such as GripperTactile-v0")
    robot.add_argument("--model", type=Path, metavar="FILE.xml", help="any MJCF")
    options.add_known(robot, parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--policy", metavar="pi|random|NAME|FILE", help="who commands, as of rollout; --model takes random only"
    )
    what.add_argument(
        "--motion",
        type=Path,
        metavar="FILE",
        help="CSV or YAML with time and command.ACTUATOR, or a name of docs/motions.md",
    )
    parser.add_argument("--episodes", type=int, default=1, metavar="N", help="how many (1)")
    parser.add_argument(
        "--effects",
        action="append",
        metavar="JSON|FILE.yaml",
        help="what reality has and the model lacks, such as '{\"force_lag\": {}}'; may be given several times; not "
        "written into the recordings",
    )
    add_numbers(parser)
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of the first episode; each later one adds 1 (0)"
    )
    parser.add_argument("--out", type=outputs.folder, required=True, metavar="DIR", help="folder of the recordings")
    parser.add_argument("--arguments", metavar="JSON", help="of the environment, such as '{\"object_offset\": 0.002}'")
    parser.add_argument(
        "--minari", metavar="NAME-v0", help="of --env: write the episodes as a Minari dataset of that name, too"
    )
    options.add_facts(parser)
    parser.add_argument("--rate", type=float, metavar="HZ", help="control rate of --model (the motion's, or 100)")
    parser.add_argument("--trust", action="store_true", help="load FILE.zip although loading runs code that it holds")
    parser.add_argument("--json", action="store_true", help="print what was written as data")
