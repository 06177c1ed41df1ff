"""``tiago-mj calibrate-sensor``: noise, threshold and scale of a user's own load cells."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import yaml

from tiago_mj.effects import read_effects
from tiago_mj.io import atomic, extra
from tiago_mj.io.progress import told
from tiago_mj.recordings import lint
from tiago_mj.recordings.read import read_recordings
from tiago_mj.recordings.recording import RecordingError
from tiago_mj.sensor_calibration.rest import FALSE_CONTACTS
from tiago_mj.sensor_calibration.sheet import UNKNOWN, Calibration, calibrate, text


def run(arguments: argparse.Namespace) -> int:
    """Calibrate, write, and say in short what was found."""
    extra.load("pandas", "reading recordings")

    if arguments.out.suffix not in (".yaml", ".yml"):
        raise ValueError(f"--out {arguments.out}: give a file that ends with .yaml")
    try:
        defaults = {"robot": arguments.env or UNKNOWN}
        read = read_recordings(arguments.recordings, map_file=arguments.map, defaults=defaults, replayed=False)
        findings = (*read.findings, *lint.inspect(read.trials))
        lint.refuse(read.trials, [f for f in findings if f.refuses])
        with told("calibrate-sensor", f"{len(read.trials)} recordings", quiet=arguments.json):
            found: Calibration = calibrate(
                read.trials,
                env=arguments.env,
                given=read_effects(arguments.effects),
                false_contacts=FALSE_CONTACTS if arguments.false_contacts is None else arguments.false_contacts,
                threads=max(arguments.jobs, 0),
            )
    except RecordingError as fault:
        print(f"tiago-mj calibrate-sensor: {fault}", file=sys.stderr)
        return 2
    sheet = text(found, arguments.out.name)
    atomic.write_text(arguments.out, sheet)
    if arguments.json:
        print(json.dumps({**yaml.safe_load(sheet), "written": str(arguments.out)}, indent=1, ensure_ascii=False))
    else:
        _say(found, arguments.out)
    return 0


def _say(found: object, path: Path) -> None:

    assert isinstance(found, Calibration)
    sizes = {scale.sensor: scale for scale in found.scales}
    root = found.average**0.5
    for rest in found.rests:
        low, high = (v * root for v in rest.noise_interval)
        threshold, _ = rest.threshold(found.false_contacts)
        print(
            f"{rest.sensor}: noise {rest.noise * root:.4g} [{low:.4g}, {high:.4g}], bias {rest.bias:.3g}, threshold "
            f"{threshold:.4g} ({rest.readings} readings at rest in {rest.windows} stretches)"
        )
        if rest.sensor in sizes:
            scale = sizes[rest.sensor]
            low, high = (v * found.contact_unit for v in scale.interval)
            print(
                f"{' ' * len(rest.sensor)}  scale {scale.per_newton * found.contact_unit:.4g} [{low:.4g}, {high:.4g}] "
                f"per {found.contact_unit:.4g} N: {scale.per_newton:.4g} sensor units per newton, {scale.grasps} grasps"
            )
    for note in found.notes:
        print(f"note: {note}")
    print(f"written: {path}; use it with:\n  {found.load(str(path))}")
