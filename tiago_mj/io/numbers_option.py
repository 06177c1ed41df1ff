"""``--numbers`` of the commands that write or apply a diagnosis."""

from __future__ import annotations

import argparse


def add_numbers(parser: argparse.ArgumentParser) -> None:
    """``--numbers``: whether the repair has the nominal model's own numbers as fitted, beside the effects."""
    parser.add_argument(
        "--numbers",
        choices=("yes", "no"),
        default="yes",
        help="no: leave out the model's own numbers as a diagnosis fitted them, beside its effects (yes)",
    )


def with_numbers(arguments: argparse.Namespace) -> bool:
    """Whether they are wanted."""
    return bool(arguments.numbers == "yes")
