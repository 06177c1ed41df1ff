"""What ``tiago-mj import`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from tiago_mj.io import outputs
from tiago_mj.sensing.load_cell import TA11_SLOPE

#: Public data sets, then recordings of a user's own robot.
KINDS: Final = ("tiago-arm", "so101", "xl330", "ta11-curve", "bag", "lerobot", "minari")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("kind", choices=KINDS, metavar="|".join(KINDS), help="what SRC holds")
    parser.add_argument(
        "source", metavar="SRC", help="folder or bag; 'download' fetches a public data set and checks every file"
    )
    parser.add_argument(
        "--map", type=Path, metavar="FILE", help="YAML: topics of a bag, columns of minari (docs/recordings.md)"
    )
    parser.add_argument("--robot", metavar="ID|FILE.xml", help="of a bag or minari: environment id or MJCF")
    parser.add_argument(
        "--model", type=Path, metavar="FILE.xml", help="of lerobot: MJCF of the arm, whose joints the names are"
    )
    parser.add_argument(
        "--units",
        metavar="degrees|normalised|radians",
        help="of lerobot: unit of the joints' numbers, where these do not decide it; of one joint as ,JOINT=percent",
    )
    parser.add_argument(
        "--joints", metavar="NAME=JOINT,...", help="of lerobot: the model's joints, where the names do not match"
    )
    parser.add_argument(
        "--commands",
        choices=("torque", "position"),
        default="torque",
        help="of xl330: which quantity is taken as the command",
    )
    parser.add_argument(
        "--apart",
        action="store_true",
        help="of so101: each joint as a servo of its own, a folder and a model each, motions cut into trials",
    )
    parser.add_argument(
        "--slope",
        type=float,
        default=TA11_SLOPE,
        help="of ta11-curve: sensor units per metre of servo error of the simulator that it is compared with (330)",
    )
    parser.add_argument("--json", action="store_true", help="print what was written and found as data")
    parser.add_argument("--out", type=outputs.folder, required=True, metavar="DIR", help="folder of the recordings")
