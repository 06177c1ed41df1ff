"""``tiago-mj robots``: the robots that ``diagnose --robot`` knows, and the motion to record with one."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from tiago_mj.io import atomic, outputs
from tiago_mj.robots.known import ROBOTS, KnownRobot, named
from tiago_mj.robots.model import VARIABLE, place_of
from tiago_mj.robots.motion import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("name", nargs="?", metavar="ROBOT", help="one of them; all by default")
    parser.add_argument(
        "--menagerie", type=Path, metavar="FOLDER", help=f"checkout of MuJoCo Menagerie (${VARIABLE}, else its package)"
    )
    parser.add_argument("--motion", type=outputs.file, metavar="FILE.csv", help="write the motion to record with ROBOT")
    parser.add_argument("--json", action="store_true", help="print all that is known as JSON")


def run(arguments: argparse.Namespace) -> int:
    """List the robots, or say what is known of one."""
    robots = ROBOTS if arguments.name is None else (named(arguments.name),)
    if arguments.motion is not None:
        if arguments.name is None:
            raise ValueError("--motion is of one robot: name it, tiago-mj robots so101 --motion FILE.csv")
        facts = {"interface": "position", "rate_hz": robots[0].rate_hz}
        atomic.write_text(arguments.motion, table(robots[0]))
        atomic.write_text(arguments.motion.with_suffix(".json"), json.dumps(facts) + "\n")
        print(f"wrote {arguments.motion}: play it in free space, at {robots[0].rate_hz:g} Hz, and log as it goes")
        return 0
    if arguments.json:
        print(json.dumps([_facts(robot, arguments.menagerie) for robot in robots], indent=1, ensure_ascii=False))
    elif arguments.name is None:
        for robot in robots:
            print(f"{robot.name:8}{robot.title}; model {place_of(robot, arguments.menagerie)}")
        print("next: tiago-mj robots NAME; tiago-mj diagnose --robot NAME DIR --out OUT")
    else:
        print("\n".join(_lines(robots[0], arguments.menagerie)))
    return 0


def _facts(robot: KnownRobot, folder: Path | None) -> dict[str, Any]:
    own = {key: value for key, value in vars(robot).items() if key not in ("columns", "names")}
    return {**own, "map": {"columns": robot.map, **robot.facts}, "model": place_of(robot, folder)}


def _lines(robot: KnownRobot, folder: Path | None) -> list[str]:
    joints = ", ".join(a if a == j else f"{j} (by {a})" for a, j in robot.joints.items())
    said = [f"{robot.title}", f"  model   {place_of(robot, folder)}", f"  joints  {joints}"]
    said.append(f"  gains   {robot.gains or 'yours'}: {robot.gains_from}")
    if robot.columns_from:
        said.append(f"  logs    {robot.columns_from}")
    if robot.like:
        said.append(f"  like    {', '.join(robot.like)}")
    if robot.base:
        said.append("  base    floats in the model; taken as held")
    said.append(f"  motion  tiago-mj robots {robot.name} --motion {robot.name}.csv")
    return said
