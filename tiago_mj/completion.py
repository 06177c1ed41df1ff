"""``tiago-mj completion SHELL``: a script with which a shell completes commands, options, environments and files.

The script is static: completing starts no Python. Print it again after an update.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

import shtab

from tiago_mj import cli
from tiago_mj.registration import ENVIRONMENTS

SHELLS: Final = ("bash", "zsh", "tcsh")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("shell", choices=SHELLS, metavar="|".join(SHELLS), help="whose script is printed")
    parser.epilog = (
        "bash: mkdir -p ~/.local/share/bash-completion/completions && "
        "tiago-mj completion bash > ~/.local/share/bash-completion/completions/tiago-mj; "
        "zsh: tiago-mj completion zsh > _tiago-mj in a folder of $fpath; then start a new shell."
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    print(script(arguments.shell))
    return 0


def script(shell: str) -> str:
    """The script for one of :data:`SHELLS`."""
    parser = cli.build_parser(*cli.COMMANDS)
    subcommands = next(action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    for sub in subcommands.choices.values():
        for action in sub._actions:
            if action.type is Path:
                action.complete = shtab.FILE
            elif action.dest == "env":  # of this parser alone: with the namespace it is accepted, too
                action.choices = list(ENVIRONMENTS)
    return str(shtab.complete(parser, shell=shell))
