"""What ``tiago-mj rollout`` takes."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from tiago_mj.cli import options
from tiago_mj.io import outputs


def film_file(text: str) -> Path:
    """Argparse type: the file of a film. What writes films is imported where one is asked for.

    Raises:
        argparse.ArgumentTypeError: no film of that name can be written here.
    """
    path: Path = importlib.import_module("tiago_mj.view.film").film_file(text)
    return path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    options.add_environment(parser)
    parser.add_argument(
        "--policy",
        required=True,
        metavar="pi|random|NAME|FILE|MODULE:FUNCTION",
        help="PI force control, random, an agent, its npz, a stable-baselines3 zip, or your own function",
    )
    options.add_episodes(parser, 1)
    parser.add_argument(
        "--film",
        type=film_file,
        metavar="FILE",
        help=".mp4, .gif, .png; a png is a filmstrip of the first episode",
    )
    parser.add_argument(
        "--record",
        type=outputs.folder,
        metavar="DIR",
        help="log the episodes as recordings that diagnose and cost read",
    )
    parser.add_argument("--json", action="store_true", help="print the same as data")
    options.add_processes(parser)
