"""Consistency of a sidecar with its columns."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tiago_mj.models.objects import SHAPES
from tiago_mj.recordings.recording import Finding, Trial, sampled

#: An initial position may differ from the first row by this share of the joint's motion, and this much [m, rad].
TOLERANCE_SHARE, MIN_TOLERANCE = 0.2, 2e-3
#: Beyond this many times what the joint ever reads, the two are in different units.
OTHER_UNIT_RATIO = 5.0


def check(trial: Trial) -> Iterator[Finding]:
    """Findings on entries of a sidecar that contradict the columns or are unknown."""
    shape = (trial.sidecar.object or {}).get("shape")
    if shape is not None and shape not in SHAPES:
        yield Finding(
            "contradiction",
            trial.source,
            "",
            f"the sidecar's object is a {shape!r}, which is none of {', '.join(SHAPES)}: it is taken for a cylinder",
        )
    initial = trial.sidecar.initial or {}
    stated = initial.get("position", {})
    known = set(trial.positions) | set(trial.velocities) | set(trial.efforts)
    strange = sorted(set(stated) - known)
    if known and strange:
        yield Finding(
            "contradiction",
            trial.source,
            "",
            f"the sidecar's initial.position names the joint {strange[0]!r}, which no column has: mend the name",
        )
    for joint, value in stated.items():
        if joint not in trial.positions:
            continue
        readings = sampled(trial, f"position.{joint}")[1]
        apart = abs(value - float(readings[0]))
        if apart <= max(MIN_TOLERANCE, TOLERANCE_SHARE * float(np.ptp(readings))):
            continue
        far = apart > OTHER_UNIT_RATIO * (float(np.abs(readings).max()) + 0.05)
        yield Finding(
            "unit_scale" if far else "contradiction",
            trial.source,
            f"position.{joint}",
            f"the sidecar's initial.position is {value:.5g}, the first row has {readings[0]:.5g}: "
            + ("one of the two is in another unit; mend it" if far else "the first row is used"),
            refuses=far,
            repaired=False,
        )
