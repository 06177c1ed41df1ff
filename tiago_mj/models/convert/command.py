"""``tiago-mj convert ROBOT.urdf --out FILE.xml``: the arguments and the run."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from dataclasses import asdict
from pathlib import Path

from tiago_mj.io import outputs
from tiago_mj.io.progress import told
from tiago_mj.models.convert.assembly import BASES, COLLISIONS, VISUALS, Options
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.models.convert.report import ConversionReport
from tiago_mj.models.convert.urdf_to_mjcf import convert
from tiago_mj.models.gains import parsed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``convert``."""
    parser.add_argument("urdf", type=Path, metavar="ROBOT.urdf", help="the URDF file")
    parser.add_argument("--out", type=outputs.file, metavar="FILE.xml", help="the MJCF file (default: ./ROBOT.xml)")
    parser.add_argument("--extras", type=Path, metavar="FILE.yaml", help="additions (default: beside the URDF)")
    parser.add_argument(
        "--package-path",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="folder that holds the packages of package:// addresses (repeatable; before ROS_PACKAGE_PATH)",
    )
    parser.add_argument("--collision", choices=COLLISIONS, default="primitives", help="what meshes collide as")
    parser.add_argument("--visual", choices=VISUALS, default="mesh", help="what meshes look like")
    parser.add_argument("--base", choices=BASES, default="fixed", help="root link fixed in the world, or free")
    parser.add_argument(
        "--gains",
        metavar="kp=50±30%,kv=…",
        help="gains of the servos and their uncertainty, of one joint as JOINT.kp=…; guessed by default",
    )
    parser.add_argument("--mass-floor", type=float, metavar="KG", help="mass of links that move and have none")
    parser.add_argument("--no-scene", action="store_true", help="no light and no floor: a robot for a scene of yours")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")


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
