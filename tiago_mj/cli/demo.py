"""What ``tiago-mj demo`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.io import outputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("--data", type=Path, metavar="DIR", help="holds tiago_arm/, a recording of a real arm")
    parser.add_argument("--out", type=outputs.folder, metavar="DIR", default="out", help="where to write (out)")
    parser.add_argument(
        "--seed", type=int, metavar="N", default=0, help="seed of the hidden effect and of the noise (0)"
    )
    parser.add_argument("--json", action="store_true", help="print demo.json instead of the summary")
