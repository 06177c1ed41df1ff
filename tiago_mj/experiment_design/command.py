"""``tiago-mj preflight``: what recordings can tell, before anything is fitted."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import Any, Final

from tiago_mj.effects import read_effects
from tiago_mj.experiment_design.along import preflight_along
from tiago_mj.experiment_design.excitation import preflight
from tiago_mj.gap.simulation.along_a_motion import along_a_motion
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.gap.simulation.session import session_of
from tiago_mj.io import atomic, extra
from tiago_mj.io.progress import told
from tiago_mj.io.quantities import quantity
from tiago_mj.recordings import lint
from tiago_mj.recordings.lint.summary import summary
from tiago_mj.recordings.recording import Finding, RecordingError
from tiago_mj.robots import options as robots

#: Deviations that are told as such at most.
FAR: Final = 10_000


def run(arguments: argparse.Namespace) -> int:
    """Look, and say what the recordings can tell."""
    extra.load("pandas", "reading recordings")
    if not arguments.json:
        extra.load("rich", "the table")

    try:
        robot = robots.said(arguments)
        read = robot.read(arguments.recordings, arguments.map)
        given = read_effects(arguments.effects)
        plant = plant_of(read.trials, env=robot.env, model=robot.model, given=given)
        findings = (*read.findings, *lint.inspect_all(read.trials, plant))
        lint.refuse(read.trials, findings)

        usable = lint.believed(read.trials, findings)
        with told("preflight", "trying what these recordings would show", quiet=arguments.json):
            if along_a_motion(plant, read.trials):
                found = preflight_along(session_of(plant, read.trials), findings)
            else:
                found = preflight(plant, read.trials, usable=usable, threads=max(arguments.jobs, 0))
    except RecordingError as fault:
        print(f"tiago-mj preflight: {fault}", file=sys.stderr)
        return 2
    data = as_data(found, findings)
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    if arguments.out:
        atomic.write_text(arguments.out, text + "\n")
    if arguments.json:
        print(text)
    else:
        _show(data, findings)
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
                "target": one.target or "all",
                "visible": one.visible,
                "parameter": one.parameter,
                "smallest_visible": one.smallest,
                "unit": one.unit,
                "distance_at_default": one.distance,
                "by_readings": one.by_readings,
            }
            for one in found.effects
        ],
        "not_excited": _not_excited(found.effects),
        "alike": [list(group) for group in found.alike],
        "notes": list(found.notes),
        "lint": [{"code": f.code, "file": f.file, "channel": f.channel, "message": f.message} for f in findings],
    }


def _not_excited(effects: Sequence[Any]) -> list[str]:
    """Effects that no target shows."""
    seen = {one.effect for one in effects if one.visible}
    return list(dict.fromkeys(one.effect for one in effects if one.effect not in seen))


def _show(data: dict[str, Any], findings: Sequence[Finding]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    count = f"{data['trials']} recording{'s' if data['trials'] > 1 else ''}"
    table = Table(title=f"What {count} of {data['robot']} can tell", title_justify="left")
    by_target = any(one["target"] != "all" for one in data["effects"])
    for name in ("effect", *(("on",) if by_target else ()), "visible from", "its default stands out by"):
        table.add_column(name)
    for one in _sorted(data["effects"]):
        on = (one["target"],) if by_target else ()
        if one["by_readings"]:
            table.add_row(one["name"], *on, "measured on the readings", "")
        elif one["visible"]:
            least = one["smallest_visible"]
            amount = "any limit" if least is None else quantity(least, one["unit"])
            table.add_row(one["name"], *on, f"{one['parameter']} {amount}", _deviations(one["distance_at_default"]))
    console.print(table)
    if data["not_excited"]:
        console.print(f"Not excited, so not ruled out: {', '.join(data['not_excited'])}", soft_wrap=True)
    for line in _alike(data["alike"]):
        console.print(f"Cannot be told apart: {line}", soft_wrap=True)
    for note in data["notes"]:
        console.print(note, soft_wrap=True, markup=False)
    for kind in summary(findings):
        console.print(str(kind), soft_wrap=True, markup=False)


def _deviations(distance: float) -> str:
    """Beyond :data:`FAR` a number would say no more, or that a simulation went astray."""
    if distance > FAR:
        return f"over {FAR} deviations"
    return f"{round(distance)} deviation{'' if round(distance) == 1 else 's'}"


def _sorted(effects: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """By how far the clearest target of an effect stands out; the targets of one effect stay together."""
    clearest: dict[str, float] = {}
    for one in effects:
        clearest[one["name"]] = max(clearest.get(one["name"], 0.0), one["distance_at_default"])
    return sorted(effects, key=lambda one: (-clearest[one["name"]], one["name"]))


def _alike(groups: Sequence[Sequence[str]]) -> list[str]:
    """One line a group; groups of the same effects on one joint each are one line."""
    joints: dict[tuple[str, ...], list[str]] = {}
    for group in groups:
        names, targets = zip(*(name.partition(" on ")[::2] for name in group), strict=True)
        if len(set(targets)) == 1:
            joints.setdefault(names, []).append(targets[0])
        else:
            joints[tuple(group)] = []
    return [", ".join(names) + (f" (on {', '.join(on)})" if any(on) else "") for names, on in joints.items()]
