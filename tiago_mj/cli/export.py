"""What ``tiago-mj export`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.io import outputs
from tiago_mj.io.numbers_option import add_numbers


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``export``."""
    parser.add_argument("diagnosis", type=Path, nargs="?", metavar="DIAGNOSIS", help="folder that diagnose wrote")
    parser.add_argument("--to", default="mujoco", metavar="TARGET", help="which simulator or format (default: mujoco)")
    parser.add_argument("--mujoco", metavar="VERSION", help="of MuJoCo that is to load the files: 3.11, 3.17 or 4.0")
    parser.add_argument("--model", type=Path, metavar="FILE.xml", help="the MJCF that was diagnosed")
    parser.add_argument("--rate", type=float, metavar="HZ", help="of commands, where the diagnosis does not say")
    parser.add_argument("--out", type=outputs.folder, metavar="FOLDER", help="where the files go")
    add_numbers(parser)
    parser.add_argument(
        "--randomisation",
        action="store_true",
        help="write the target's domain randomisation, too: simulators drawn from the diagnosis's posterior",
    )
    parser.add_argument("--table", action="store_true", help="print which effects every target holds, and nothing else")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.epilog = "Targets: mujoco, mjlab, playground, isaaclab, newton, gymnasium, ros2_control, urdf, sdf."
