"""Options that commands on recordings share."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_simulator(parser: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    """``--env`` or ``--model``: what recordings are compared with; the group, for what else excludes both."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--env", metavar="ID", help="environment that they are compared with, where they do not say")
    what.add_argument("--model", type=Path, metavar="FILE.xml", help="MJCF file that they are compared with")
    return what


def add_map(parser: argparse.ArgumentParser) -> None:
    """``--map``: what columns hold."""
    parser.add_argument("--map", type=Path, metavar="FILE.yaml", help="YAML: column to kind and name")


def add_known_effects(
    parser: argparse.ArgumentParser, what: str = "effects that are known already, applied first"
) -> None:
    """``--effects``: what the nominal simulator has beside its model."""
    parser.add_argument(
        "--effects", action="append", metavar="FILE.yaml|JSON", help=f"{what}; may be given several times"
    )


def add_without(parser: argparse.ArgumentParser) -> None:
    """``--without``: what no explanation may have."""
    parser.add_argument(
        "--without", default="", metavar="NAME,...", help="effects that are left out, as if the library lacked them"
    )


def add_seed(parser: argparse.ArgumentParser) -> None:
    """``--seed``: of what is drawn at random."""
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of what is drawn at random (0)")


def add_threads(parser: argparse.ArgumentParser) -> None:
    """``--jobs``: of the simulations."""
    parser.add_argument(
        "--jobs", type=int, default=0, metavar="N", help="threads of the simulations; 0: all processors"
    )
