"""What ``tiago-mj evaluate`` takes."""

from __future__ import annotations

import argparse

from tiago_mj.cli import options
from tiago_mj.io import outputs

#: Files that the command writes into ``--out``.
DATA, PICTURE = "evaluation.json", "episodes.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    options.add_environment(parser)
    parser.add_argument(
        "--policy",
        required=True,
        action="append",
        metavar="NAME|FILE",
        help="pi, pi-tuned, random, or a file that rollout takes; give it once for each controller",
    )
    options.add_episodes(parser, 10)
    parser.add_argument("--out", type=outputs.folder, metavar="FOLDER", help=f"for {DATA}, {PICTURE} and films")
    parser.add_argument("--film", action="store_true", help="film each controller's first episode, into --out")
    parser.add_argument(
        "--bound", action="store_true", help="a reward that no controller can exceed, and the distance from it"
    )
    parser.add_argument("--json", action="store_true", help="print the same as data")
