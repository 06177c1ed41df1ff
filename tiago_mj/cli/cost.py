"""What ``tiago-mj cost`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.cli import options
from tiago_mj.io.numbers_option import add_numbers
from tiago_mj.policy_cost import DRAWS, EPISODES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("diagnosis", type=Path, metavar="DIAGNOSIS", help="folder that diagnose wrote")
    options.add_environment(parser, required=False)
    parser.add_argument(
        "--policy", metavar="NAME|FILE|MODULE:FUNCTION", help="pi, pi-tuned, random, an agent, a file, or a function"
    )
    parser.add_argument(
        "--rollouts",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="logged rollouts: the episodes have their objects, goals and starts; without --policy the logged actions "
        "are sent again, open loop",
    )
    options.add_episodes(parser, EPISODES)
    parser.add_argument(
        "--draws", type=int, default=DRAWS, metavar="N", help=f"of the magnitudes from their intervals ({DRAWS})"
    )
    add_numbers(parser)
    options.add_processes(parser)
    parser.add_argument("--json", action="store_true", help="print the same as data")
