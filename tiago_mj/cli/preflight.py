"""What ``tiago-mj preflight`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.cli import options
from tiago_mj.io import outputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help="files or folders of recordings")
    options.add_robot(parser)
    options.add_known_effects(parser)
    parser.add_argument("--out", type=outputs.file, metavar="FILE.json", help="write the same as JSON")
    parser.add_argument("--json", action="store_true", help="print the same as data")
    options.add_threads(parser)
