"""``--numbers`` of the commands that write or apply a diagnosis."""

from __future__ import annotations

import argparse


def add_numbers(parser: argparse.ArgumentParser) -> None:
    """``--numbers``: whether the repair has the nominal model's own numbers as fitted, beside the effects."""
    parser.add_argument(
        "--numbers",
        choices=("yes", "no"),
        default="yes",
        help="no: use the effects alone, without the model's own numbers as fitted (yes)",
    )


def with_numbers(arguments: argparse.Namespace) -> bool:
    """Whether they are wanted."""
    return bool(arguments.numbers == "yes")
