"""``tiago-mj preflight``: what recordings can tell, before anything is fitted."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tiago_mj import atomic, extra
from tiago_mj.gap.recording import Finding, RecordingError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help="files or folders of recordings")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--env", metavar="ID", help="environment that they are compared with, where they do not say")
    what.add_argument("--model", type=Path, metavar="FILE.xml", help="MJCF file that they are compared with")
    parser.add_argument("--map", type=Path, metavar="FILE", help="YAML: column to kind and name")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write the same as JSON")
    parser.add_argument(
        "--jobs", type=int, default=0, metavar="N", help="threads of the simulations; 0: all processors"
    )


def run(arguments: argparse.Namespace) -> int:
    """Look, and say what the recordings can tell."""
    extra.load("pandas", "reading recordings")
    extra.load("rich", "the table")
    from tiago_mj.gap import lint
    from tiago_mj.gap.plant import plant_of
    from tiago_mj.gap.preflight.excitation import preflight
    from tiago_mj.gap.read import read_recordings

    try:
        robot = arguments.env or (str(arguments.model) if arguments.model else None)
        defaults = {"robot": robot} if robot else {}
        read = read_recordings(arguments.recordings, map_file=arguments.map, defaults=defaults)
        plant = plant_of(read.trials, env=arguments.env, model=arguments.model)
        findings = (*read.findings, *lint.inspect_all(read.trials, plant))
        lint.refuse(read.trials, findings)
        usable = frozenset.intersection(*(lint.usable(trial, findings) for trial in read.trials))
        found = preflight(plant, read.trials, usable=usable, threads=max(arguments.jobs, 0))
    except RecordingError as fault:
        print(f"tiago-mj preflight: {fault}", file=sys.stderr)
        return 2
    data = as_data(found, findings)
    if arguments.out:
        atomic.write_text(arguments.out, json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    _show(data)
    return 0


def as_data(found: Any, findings: Sequence[Finding]) -> dict[str, Any]:
    """The same in JSON's own types."""
    return {
        "schema": "tiago_mj.preflight/1",
        "robot": found.robot,
        "trials": found.trials,
        "effects": [
            {
                "name": one.effect,
                "visible": one.visible,
                "parameter": one.parameter,
                "smallest_visible": one.smallest,
                "unit": one.unit,
                "distance_at_default": one.distance,
                "by_readings": one.by_readings,
            }
            for one in found.effects
        ],
        "not_excited": [one.effect for one in found.effects if not one.visible],
        "alike": [list(group) for group in found.alike],
        "lint": [{"code": f.code, "file": f.file, "channel": f.channel, "message": f.message} for f in findings],
    }


def _show(data: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table(title=f"What {data['trials']} recordings of {data['robot']} can tell", title_justify="left")
    for name in ("effect", "visible from", "its default stands out by"):
        table.add_column(name)
    for one in sorted(data["effects"], key=lambda one: -one["distance_at_default"]):
        if one["by_readings"]:
            table.add_row(one["name"], "the readings betray it", "")
        elif one["visible"]:
            unit = "" if one["unit"] in ("-", "–") else f" {one['unit']}"
            amount = "any limit" if one["smallest_visible"] is None else f"{one['smallest_visible']:.3g}{unit}"
            table.add_row(one["name"], f"{one['parameter']} {amount}", f"{one['distance_at_default']:.0f} deviations")
    console.print(table)
    if data["not_excited"]:
        console.print(f"Not excited, so not ruled out: {', '.join(data['not_excited'])}", soft_wrap=True)
    for group in data["alike"]:
        console.print(f"Cannot be told apart: {', '.join(group)}", soft_wrap=True)
    for finding in data["lint"]:
        console.print(f"{finding['code']}: {finding['file']}: {finding['message']}", soft_wrap=True, markup=False)
