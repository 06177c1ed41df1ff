"""What ``tiago-mj diagnose-all`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from tiago_mj.cli import options
from tiago_mj.io import outputs
from tiago_mj.io.numbers_option import add_numbers

#: Written into ``--out``: what came of every folder.
SUMMARY: Final = "diagnoses.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="one diagnosis is made of each")
    parser.add_argument(
        "--out", type=outputs.folder, required=True, metavar="DIR", help=f"for DIR/FOLDER/… and DIR/{SUMMARY}"
    )
    options.add_robot(parser)
    options.add_seed(parser)
    parser.add_argument("--time-budget", type=float, help="seconds after which a diagnosis writes its best verdict")
    options.add_without(parser)
    parser.add_argument(
        "--threads", type=int, metavar="N", help="of each diagnosis; 0: all processors (0 where --jobs is 1, else 1)"
    )
    add_numbers(parser)
    options.add_processes(parser)
    parser.set_defaults(jobs=None)
    parser.add_argument("--json", action="store_true", help=f"print {SUMMARY} instead of the table")
