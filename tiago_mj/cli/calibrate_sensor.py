"""What ``tiago-mj calibrate-sensor`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.cli import options
from tiago_mj.io import outputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help="files or folders of recordings")
    parser.add_argument(
        "--out",
        type=outputs.file,
        required=True,
        metavar="FILE.yaml",
        help='for gymnasium.make(ID, sensing="FILE.yaml")',
    )
    parser.add_argument("--env", metavar="ID", help="environment that grasps are compared with, where they do not say")
    options.add_map(parser)
    options.add_known_effects(parser)
    parser.add_argument(
        "--false-contacts",
        type=float,
        metavar="P",
        help="probability of a reading above the threshold without contact (2.9e-7: 5 standard deviations)",
    )
    parser.add_argument("--json", action="store_true", help="print what is written as JSON")
    options.add_threads(parser)
