"""The command line: ``tiago-mj COMMAND``.

A command is a module with ``run(arguments) -> exit status``, named in :data:`COMMANDS`, and one with
``add_arguments(parser)``: the same, or one of this room where the first takes long to import. Both are imported only
when the command is asked for, and the first only when it is run.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import importlib
import os
import select
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Final, NoReturn

from gymnasium.error import DependencyNotInstalled

from tiago_mj import __version__
from tiago_mj.io.quoting import one_line, unquoted
from tiago_mj.view import headless

#: Command: module that runs it, and what it does.
COMMANDS: Final[Mapping[str, tuple[str, str]]] = MappingProxyType(
    {
        "demo": ("tiago_mj.demo.command", "grasp, compare with real recordings, write a page with the pictures"),
        "rollout": ("tiago_mj.rollout.command", "run a policy in an environment: returns, forces, a film"),
        "evaluate": ("tiago_mj.evaluate.command", "compare controllers and policies: reward, bounces, the bound"),
        "train": ("tiago_mj.learn.command", "train agents with stable-baselines3; the same command again goes on"),
        "agents": ("tiago_mj.learn.shipped", "list the agents that come with the package, or export one of your own"),
        "convert": ("tiago_mj.models.convert.command", "turn a robot's URDF into MJCF"),
        "robots": ("tiago_mj.robots.command", "list the robots that --robot knows: model, joints, gains, motion"),
        "preflight": ("tiago_mj.experiment_design.command", "what recordings can tell, before anything is fitted"),
        "diagnose": ("tiago_mj.gap.command", "say why recordings differ from the simulator, and mend it"),
        "compare": ("tiago_mj.change.command", "say what changed between two sets of recordings of one robot"),
        "cost": (
            "tiago_mj.policy_cost.command",
            "say what each effect that was found costs a policy; what to mend first",
        ),
        "export": ("tiago_mj.export.command", "write what a diagnosis found for MuJoCo 3, mjlab, Isaac Lab, URDF, …"),
        "view": ("tiago_mj.view.command", "watch an environment, or recordings beside simulators, in a browser"),
        "diagnose-all": ("tiago_mj.gap.diagnose_all", "diagnose many folders, each by itself, in many processes"),
        "calibrate-sensor": (
            "tiago_mj.sensor_calibration.command",
            "noise, threshold and scale of your own load cells",
        ),
        "record": ("tiago_mj.recordings.record.command", "log an environment or any MJCF as a real robot would be"),
        "import": ("tiago_mj.recordings.imports.command", "turn public recordings and ROS bags into recordings"),
        "doctor": ("tiago_mj.doctor", "say what works on this machine, and how to mend what does not"),
        "completion": ("tiago_mj.completion", "print a script that completes this command in a shell"),
    }
)

#: Commands whose arguments are declared in a module of this room, which imports nothing heavy: ``--help`` is quick.
DECLARED: Final[Mapping[str, str]] = MappingProxyType(
    {
        "calibrate-sensor": "calibrate_sensor",
        "compare": "compare",
        "convert": "convert",
        "cost": "cost",
        "demo": "demo",
        "diagnose-all": "diagnose_all",
        "evaluate": "evaluate",
        "export": "export",
        "import": "import_",
        "preflight": "preflight",
        "record": "record",
        "rollout": "rollout",
        "train": "train",
        "view": "view",
    }
)
#: How a complaint of a drive without room begins, whatever the command.
FULL: Final = "the drive is full"
#: Exit status where whoever read the output closed it: 128 and SIGPIPE, as a shell says it of other commands.
BROKEN_PIPE: Final = 141
#: Set to see where an error came from.
TRACEBACK: Final = "TIAGO_MJ_TRACEBACK"


class Parser(argparse.ArgumentParser):
    """A parser whose complaint is one line."""

    def error(self, message: str) -> NoReturn:
        """Leave with exit status 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def build_parser(*wanted: str | None) -> argparse.ArgumentParser:
    """The parser, with the options of some commands filled in."""
    parser = Parser(
        prog="tiago-mj",
        description="TIAGo and the TA11 gripper in MuJoCo.",
        epilog=f"With {TRACEBACK}=1 set, an error shows where it came from.",
    )
    parser.add_argument("--version", action="version", version=f"tiago-mj {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (module, summary) in COMMANDS.items():
        sub = commands.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        if name in wanted:
            declared = f"{__name__}.{DECLARED[name]}" if name in DECLARED else module
            importlib.import_module(declared).add_arguments(sub)
            sub.set_defaults(run=partial(run, module))
    return parser


def run(module: str, arguments: argparse.Namespace) -> int:
    """Import the module of a command and run it; the exit status."""
    status: int = importlib.import_module(module).run(arguments)
    return status


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command.

    Returns:
        Exit status: what the command returns; 2 where something it was given is unusable, said in one line on stderr.
    """
    try:
        try:
            return _run(argv)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read the output has enough (``| head``): nothing more is written, at exit neither.
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return BROKEN_PIPE


def _unread() -> bool:
    """Whether nobody reads what is printed any more: a pipe may be broken that is not the terminal's."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            poll = select.poll()
            poll.register(stream.fileno(), 0)
            if any(state & select.POLLERR for _, state in poll.poll(0)):
                return True
    return False


def _run(argv: Sequence[str] | None) -> int:
    """The same, where somebody reads what is printed."""
    given = list(sys.argv[1:] if argv is None else argv)
    headless.hush_unmade_viewers()
    arguments = build_parser(next((word for word in given if not word.startswith("-")), None)).parse_args(given)
    return guarded(f"tiago-mj {arguments.command}", arguments)


def guarded(prog: str, arguments: argparse.Namespace) -> int:
    """Run what a command line asks for (``run`` of its arguments), as ``tiago-mj`` does.

    Returns:
        Exit status: what it returns; 2 where something it was given is unusable, said in one line on stderr.
    """
    from tiago_mj.io import mujoco_log

    try:
        with mujoco_log.counted() as warned:
            status: int = arguments.run(arguments)
        for sentence in mujoco_log.sentences(warned) if status != 2 else ():  # of what is unusable one line is said
            print(f"{prog}: {sentence}", file=sys.stderr)
        return status
    except KeyboardInterrupt:
        return 130
    except Exception as fault:
        if isinstance(fault, BrokenPipeError) and _unread():
            raise
        if os.environ.get(TRACEBACK) or not isinstance(fault, _foreseen()):
            raise
        print(f"{prog}: {one_line(_told(fault, arguments))}", file=sys.stderr)
        return 2


def _told(fault: Exception, arguments: argparse.Namespace) -> str:
    """What a user is told of it: of the system's own errors which file and what to do, not their number."""
    if not isinstance(fault, OSError) or fault.errno is None:
        return str(fault)
    out = getattr(arguments, "out", None)
    if fault.errno in (errno.ENOSPC, errno.EDQUOT):
        where = f"{unquoted(out)}: " if out is not None else ""
        return f"{where}{FULL}: make room on it, or name another place"
    reason = (fault.strerror or str(fault)).lower()
    return f"{unquoted(os.fsdecode(fault.filename))}: {reason}" if fault.filename else reason


def _foreseen() -> tuple[type[BaseException], ...]:
    """What a user can mend: bad input, missing files, missing libraries."""
    return (ValueError, OSError, ModuleNotFoundError, DependencyNotInstalled)
