"""What ``tiago-mj view`` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiago_mj.cli import options
from tiago_mj.io import outputs
from tiago_mj.view.server import PORT


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "recordings", nargs="*", type=Path, metavar="RECORDING", help="files or folders of recordings to watch"
    )
    parser.add_argument(
        "--env", metavar="ID", help="environment to watch live; of recordings: the robot, where they do not say"
    )
    live = parser.add_argument_group("an environment live")
    live.add_argument(
        "--env-option",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="argument of the environment, value in JSON; as often as needed",
    )
    live.add_argument("--policy", metavar="pi|random|NAME|FILE", help="who commands at first; else your sliders do")
    live.add_argument("--trust", action="store_true", help="load a FILE.zip although loading runs code that it holds")
    live.add_argument("--seed", type=int, default=0, metavar="N", help="of the first episode (0)")
    watched = parser.add_argument_group("recordings")
    watched.add_argument("--diagnosis", type=Path, metavar="DIR", help="folder that tiago-mj diagnose wrote of them")
    watched.add_argument("--model", type=Path, metavar="FILE.xml", help="MJCF that they are compared with")
    options.add_known(watched, watched)
    options.add_map(watched)
    options.add_facts(watched)
    watched.add_argument("--trial", metavar="NAME", help="which recording to show first")
    watched.add_argument("--beside", action="store_true", help="robots side by side, not as ghosts in one place")
    watched.add_argument(
        "--save", type=outputs.file, metavar="FILE.html", help="write one file that opens without a server, and end"
    )
    parser.add_argument(
        "--effects",
        action="append",
        metavar="JSON|FILE.yaml",
        help="effects at the start; of recordings: those of the repaired robot, in place of the diagnosis's",
    )
    parser.add_argument(
        "--port",
        type=int,
        default=PORT,
        metavar="N",
        help=f"port at which it is served, on this machine alone ({PORT})",
    )
    parser.add_argument("--json", action="store_true", help="print the address, or the file, as data")
