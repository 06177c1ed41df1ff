"""Options that commands share: on recordings, of episodes, of many processes."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_simulator(parser: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    """``--env`` or ``--model``: what recordings are compared with; the group, for what else excludes both."""
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--env", metavar="ID", help="environment that they are compared with, where they do not say")
    what.add_argument("--model", type=Path, metavar="FILE.xml", help="MJCF file that they are compared with")
    return what


def add_map(parser: argparse._ActionsContainer) -> None:
    """``--map``: what columns hold."""
    parser.add_argument("--map", type=Path, metavar="FILE.yaml", help="YAML: column to kind and name")


def add_robot(parser: argparse.ArgumentParser) -> None:
    """``--env``, ``--model`` or ``--robot``, ``--map``, and what is known of gains, base and like parts."""
    add_known(add_simulator(parser), parser)
    add_map(parser)
    add_facts(parser)


def add_known(what: argparse._ActionsContainer, parser: argparse._ActionsContainer) -> None:
    """``--robot``, into the group of what else names a simulator, and ``--menagerie``."""
    what.add_argument("--robot", metavar="NAME", help="a robot that tiago-mj robots lists, with its model")
    parser.add_argument(
        "--menagerie", type=Path, metavar="FOLDER", help="checkout of MuJoCo Menagerie with the model of --robot"
    )


def add_facts(parser: argparse._ActionsContainer) -> None:
    """``--gains``, ``--fix-base``, ``--like`` and ``--tie``."""
    parser.add_argument(
        "--gains",
        metavar="kp=50±30%,kv=…|KP,KD|guessed",
        help="gains of the servos, or of the controllers of motors, and their uncertainty; guessed: to a factor of ten",
    )
    parser.add_argument(
        "--fix-base", action="store_true", help="the floating base of the model was held: legs in the air"
    )
    parser.add_argument(
        "--like", metavar="FL,FR,…", help="what the joints of like parts begin with: says which of them differs"
    )
    parser.add_argument(
        "--tie", action="store_true", help="like parts share one magnitude of each effect on the same joint"
    )


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


def add_environment(parser: argparse.ArgumentParser, *, required: bool = True) -> None:
    """``--env``, which something else may say unless it is ``required``, and ``--env-option``."""
    parser.add_argument("--env", required=required, metavar="ID", help="such as GripperTactile-v0")
    parser.add_argument(
        "--env-option",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="argument of the environment, value in JSON: servo=ideal, goal='[0.5, 1.5]'; as often as needed",
    )


def add_episodes(parser: argparse.ArgumentParser, count: int) -> None:
    """``--episodes``, ``count`` unless told, ``--seed``, and ``--trust`` for the policy that plays them."""
    parser.add_argument("--episodes", type=int, default=count, metavar="N", help=f"of each policy ({count})")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of the first episode; each later one adds 1 (0)"
    )
    parser.add_argument(
        "--trust", action="store_true", help="load a FILE or MODULE although loading runs code that it holds"
    )


def add_processes(parser: argparse.ArgumentParser) -> None:
    """Options of a command that runs many tasks."""
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes at once (1); 0: one a processor")
    parser.add_argument(
        "--backend",
        choices=("local", "ray"),
        default="local",
        help="processes of this machine, or of the Ray cluster at RAY_ADDRESS (local)",
    )
