"""What ``tiago-mj compare`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.cli import options
from tiago_mj.io import outputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("before", type=Path, nargs="?", metavar="BEFORE", help="folder or file of the earlier set")
    parser.add_argument("after", type=Path, nargs="?", metavar="AFTER", help="folder or file of the later set")
    options.add_robot(parser)
    options.add_known_effects(parser, "effects that both sets are known to have")
    parser.add_argument(
        "--dates", metavar="BEFORE,AFTER", default="", help="days of the two sets, written into the answer"
    )
    parser.add_argument(
        "--history",
        type=Path,
        metavar="FOLDER",
        help="instead of two sets: a folder of sets, diagnoses or comparisons in the order of their names",
    )
    parser.add_argument(
        "--out", type=outputs.folder, required=True, help="folder for comparison.json and comparison.html"
    )
    options.add_seed(parser)
    options.add_threads(parser)
    options.add_without(parser)
    parser.add_argument("--json", action="store_true", help="print comparison.json instead of the summary")
