"""``tiago-mj convert ROBOT.urdf --out FILE.xml``: the arguments and the run."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from dataclasses import asdict
from pathlib import Path

from tiago_mj.io.progress import told
from tiago_mj.models.convert.assembly import Options
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.models.convert.report import ConversionReport
from tiago_mj.models.convert.urdf_to_mjcf import convert
from tiago_mj.models.gains import parsed


def run(arguments: argparse.Namespace) -> int:
    """Convert and print what was done; 2 with one line on standard error when the input cannot be used."""
    out = arguments.out or Path(arguments.urdf.stem + ".xml")
    try:
        with told("convert", f"reading {arguments.urdf.name} and its meshes", quiet=arguments.json):
            report = convert(
                arguments.urdf,
                out,
                extras=arguments.extras,
                options=Options(
                    package_paths=tuple(arguments.package_path),
                    collision=arguments.collision,
                    visual=arguments.visual,
                    base=arguments.base,
                    mass_floor=arguments.mass_floor,
                    scene=not arguments.no_scene,
                    gains=parsed(arguments.gains) if arguments.gains else {},
                ),
            )
    except ConversionError as error:
        print(error, file=sys.stderr)
        return 2
    print(_json(report) if arguments.json else _text(report))
    return 0


def _text(report: ConversionReport) -> str:
    model = report.spec.compile()
    python = shlex.quote(sys.executable)  # that has MuJoCo
    size = f"{model.nbody - 1} bodies, {model.nv} degrees of freedom, {model.nu} actuators, {model.nsensor} sensors"
    return "\n".join(
        [
            *report.lines(),
            f"wrote {report.out}: {size}",
            f"look at it: {python} -m mujoco.viewer --mjcf={shlex.quote(str(report.out))}",
        ]
    )


def _json(report: ConversionReport) -> str:
    content = {
        "robot": report.robot,
        "out": str(report.out),
        "repaired": [asdict(repair) for repair in report.repaired],
        "fitted": [asdict(fit) for fit in report.fitted],
        "excluded": report.excluded,
        "added": report.added,
        "dropped": report.dropped,
    }
    return json.dumps(content, indent=1)
