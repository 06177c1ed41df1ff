"""``python -m benchmarks.blind``: check the diagnosis on data whose effect is withheld from it."""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Sequence

from benchmarks.blind import command
from tiago_mj import cli
from tiago_mj.io import extra, outputs

PROG = "python -m benchmarks.blind"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--cases", type=int, required=True, metavar="N", help="how many")
    parser.add_argument("--seed", type=int, required=True, metavar="N", help="another one gives other cases")
    parser.add_argument(
        "--out", type=outputs.folder, required=True, metavar="DIR", help="folder of the run; goes on where it stopped"
    )
    parser.add_argument("--kinds", metavar="LIST", help="only some of none,one,two,outside,left_out")
    parser.add_argument("--settings", metavar="LIST", help="only some of gripper,arm,plain")
    parser.add_argument("--rates", metavar="LIST", help="only some of 25,240, the control rates [Hz]")
    parser.add_argument("--trials", type=int, metavar="N", help="recordings of a case (10)")
    parser.add_argument("--seconds", type=float, metavar="S", help="of a recording (6 at 25 Hz, 1.5 to 2.5 at 240 Hz)")
    parser.add_argument(
        "--efforts", action="store_true", help="recordings hold motion and measured efforts instead of commands"
    )
    parser.add_argument(
        "--effects", metavar="LIST", help="effects that every case with one has, and one of two in cases with a pair"
    )
    parser.add_argument(
        "--off-centre", type=float, metavar="SHARE", help="how far the links' centres of mass lie off, of their reach"
    )
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes that record cases (1)")
    parser.add_argument("--jobs", type=int, default=0, metavar="N", help="threads of one diagnosis; 0: all processors")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="diagnoses that run side by side (1)")
    parser.add_argument("--time-budget", type=float, metavar="S", help="seconds for one diagnosis")
    parser.add_argument("--diagnose-with", metavar="OPTIONS", help="further options of every diagnosis, in one string")
    parser.add_argument(
        "--no-next-motion", action="store_true", help="do not play what is recommended in ambiguous cases"
    )
    parser.add_argument("--generate-only", action="store_true", help="stop when the labels are sealed")
    parser.add_argument("--json", action="store_true", help="print the scores as data, everything else as messages")


def run(arguments: argparse.Namespace) -> int:
    """Generate, diagnose and score what is asked for."""
    extra.load("pyarrow", "the blind check")
    if not arguments.json:
        return command.blind(arguments)
    with contextlib.redirect_stdout(sys.stderr):
        status = command.blind(arguments)
    scores, seal = arguments.out / "scores.json", arguments.out / "seal.txt"
    made = {"seal": seal.read_text(encoding="utf-8").strip() if seal.exists() else None}
    made["scores"] = json.loads(scores.read_text(encoding="utf-8")) if scores.exists() else None
    print(json.dumps(made, indent=1))
    return status


def main(words: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = cli.Parser(prog=PROG, description="Check the diagnosis on data whose effect is withheld from it.")
    add_arguments(parser)
    parser.set_defaults(run=run)
    return cli.guarded(PROG, parser.parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
