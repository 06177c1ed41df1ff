"""What ``tiago-mj convert`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.io import outputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``convert``."""
    parser.add_argument("urdf", type=Path, metavar="ROBOT.urdf", help="the URDF file")
    parser.add_argument("--out", type=outputs.file, metavar="FILE.xml", help="the MJCF file (default: ./ROBOT.xml)")
    parser.add_argument("--extras", type=Path, metavar="FILE.yaml", help="additions (default: beside the URDF)")
    parser.add_argument(
        "--package-path",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="folder that holds the packages of package:// addresses (repeatable; before ROS_PACKAGE_PATH)",
    )
    parser.add_argument(
        "--collision", choices=("primitives", "mesh", "none"), default="primitives", help="what meshes collide as"
    )
    parser.add_argument(
        "--visual", choices=("mesh", "primitives", "none"), default="mesh", help="what meshes look like"
    )
    parser.add_argument(
        "--base", choices=("fixed", "free"), default="fixed", help="root link fixed in the world, or free"
    )
    parser.add_argument(
        "--gains",
        metavar="kp=50±30%,kv=…",
        help="gains of the servos and their uncertainty, of one joint as JOINT.kp=…; guessed by default",
    )
    parser.add_argument("--mass-floor", type=float, metavar="KG", help="mass of links that move and have none")
    parser.add_argument("--no-scene", action="store_true", help="no light and no floor: a robot for a scene of yours")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
