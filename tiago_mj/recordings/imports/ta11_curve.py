"""Import of the real TA11 force curve: steady fingertip force over a held servo error, as recordings of its protocol.

Each number was one squeeze (:mod:`tiago_mj.sensing.ta11_curve`): every 40 ms both fingers were commanded to where they
measured themselves to be, less dq, and after 6 s the mean of the last ten readings was noted. A recording is that
squeeze: commands of -dq from the measured position, and one force at its end. Numbers at dq of 0.3 mm are left out, as
there nothing was sent.

What is not known is not needed, and said in the sidecars: objects' stiffness and masses, and how the fingers came to
the object. The recordings begin 1 mm off it and last :data:`SECONDS`, when the simulated fingers stand (a test compares
with 6 s).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from tiago_mj.io.rows import numbers, read_rows
from tiago_mj.models import names
from tiago_mj.models.objects import GraspObject
from tiago_mj.recordings.recording import SCHEMA, RecordingError, Sidecar, Trial
from tiago_mj.sensing.load_cell import PAPER_SCALE, SERVO_STIFFNESS, TA11_NOISE, TA11_SLOPE
from tiago_mj.sensing.ta11_curve import (
    CONTROL_HZ,
    ITEMS,
    MEASURED,
    SOURCE,
    STEADY_READINGS,
    Series,
    is_sent,
)

#: ``SRC`` for the numbers that this package carries itself.
BUILTIN: Final = "builtin"
ROBOT: Final = "gripper_ta11"
COLUMNS: Final = ("series", "object", "dq_m", "force_sensor_units")
#: Length of a recording [s]: the protocol's was 6, of which the approach, over after 1.5 at most, is not known.
SECONDS: Final = 2.0
#: Where the fingers begin, off the object [m].
APART: Final = 1e-3
#: Of a finger's way [m], and a reading that no load cell gives [sensor units].
DEEPEST: Final = 0.045
STRONGEST: Final = 1e6
#: Stand-in where no width is known (glue): the force does not depend on it.
ANY: Final = GraspObject(width=0.06)
#: An object's pads touch at half its width less this [m] (gap of the closed pads, facts of the fingertip).
CLOSED_GAP: Final = 0.2e-3


def trials(source: str, slope: float = TA11_SLOPE) -> Iterator[tuple[str, Trial]]:
    """Every squeeze, with the folder of its series.

    Args:
        source: the CSV file, or :data:`BUILTIN`.
        slope: of the simulator that they are to be compared with: (servo stiffness) · (sensor gain) [sensor units per
            metre of servo error]; only this product shows in the curve.

    Raises:
        RecordingError: there is no such file, or it is not the data set's format.
        ValueError: the slope is none.
    """
    if not (np.isfinite(slope) and slope > 0):
        raise ValueError(f"--slope is {slope!r}: give sensor units per metre of servo error, above 0 (330)")
    series = list(MEASURED) if source == BUILTIN else read(Path(source))
    uncertainty = scatter(series)
    for one in series:
        for dq, force in zip(one.dq, one.force, strict=True):
            if is_sent(np.array(dq)):
                yield f"{one.session}-{one.object}", _trial(one, dq, force, slope, uncertainty)


def read(path: Path) -> list[Series]:
    """The series of a CSV file with columns :data:`COLUMNS`.

    Raises:
        RecordingError: it is not there, or not of that format; one line.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: no such file: give the CSV of the force curve, or '{BUILTIN}'")
    points: dict[tuple[str, str], list[tuple[float, float]]] = {}
    lead = f"{path.name} is no force curve"
    rows = read_rows(path, COLUMNS, lead, error=RecordingError)
    dq, force = (numbers([row[name] for row in rows], name, lead, error=RecordingError) for name in COLUMNS[2:])
    for row, deep, felt in zip(rows, dq.tolist(), force.tolist(), strict=True):
        if not 0 < deep < DEEPEST:
            raise RecordingError(f"{path.name}: dq_m is {deep:g}: give metres, above 0 and below {DEEPEST:g}")
        if not abs(felt) < STRONGEST:
            raise RecordingError(f"{path.name}: force_sensor_units is {felt:g}: no load cell reads that")
        series = points.setdefault((row["series"], row["object"]), [])
        if any(deep == other for other, _ in series):
            raise RecordingError(f"{path.name}: a series has dq_m {deep:g} twice: delete one of the rows")
        series.append((deep, felt))
    if not points:
        raise RecordingError(f"{path.name}: it holds no row")
    return [
        Series(session, item, *(tuple(column) for column in zip(*sorted(found), strict=True)))
        for (session, item), found in points.items()
    ]


def scatter(series: Sequence[Series]) -> float:
    """Standard deviation of a force about the line through its neighbours [sensor units]."""
    apart = []
    for one in series:
        x, y = np.array(one.dq), np.array(one.force)
        x, y = x[is_sent(x)], y[is_sent(x)]
        after = (x[2:] - x[1:-1]) / (x[2:] - x[:-2])
        apart += list((y[1:-1] - after * y[:-2] - (1 - after) * y[2:]) / np.sqrt(1 + after**2 + (1 - after) ** 2))
    return float(np.sqrt(np.mean(np.square(apart)))) if apart else 0.0


def _trial(series: Series, dq: float, force: float, slope: float, uncertainty: float) -> Trial:
    item = replace(ITEMS.get(series.object, ANY))
    rows = round(SECONDS * CONTROL_HZ) + 1
    command = np.full(rows, -dq)
    command[-1] = np.nan
    reading = np.full(rows, np.nan)
    reading[-1] = force
    begin = item.width / 2 - CLOSED_GAP + APART
    name = f"{series.session}-{series.object}-{dq * 1e3:.2f}mm"
    raw: dict[str, Any] = {
        "command_reference": "measured",
        # One number stands for both fingers: with √2 of its uncertainty on each it counts once.
        "uncertainty": {"force": float(f"{uncertainty * np.sqrt(2):.6g}")},
    }
    return Trial(
        name=name,
        time=np.arange(rows) / CONTROL_HZ,
        commands={joint: command.copy() for joint in names.FINGERS},
        positions={},
        velocities={},
        efforts={},
        forces={side: reading.copy() for side in names.SIDES},
        sidecar=Sidecar(
            schema=SCHEMA,
            trial=name,
            robot=ROBOT,
            rate_hz=CONTROL_HZ,
            interface="position",
            servo={"name": "pal"},
            sensing={
                "scale": PAPER_SCALE,
                "contact_unit": PAPER_SCALE * SERVO_STIFFNESS / slope,
                "average": STEADY_READINGS,
                "noise": TA11_NOISE,
            },
            object={
                "shape": item.shape,
                "width_m": item.width,
                "height_m": item.height,
                "mass_kg": item.mass,
                "stiffness": item.stiffness,
                "damping": item.damping,
                "offset_m": 0.0,
            },
            initial={
                "position": dict.fromkeys(names.FINGERS, begin),
                "set_point": dict.fromkeys(names.FINGERS, begin),
            },
            motion=f"servo error of {dq * 1e3:g} mm held, {series.object}, session {series.session}",
            source={
                "repository": SOURCE,
                "imported": f"squeezes of the steady-force curve; compared at {slope:g} sensor units per metre; one "
                "force stands for both fingers",
                "unknown": "stiffness and mass of the object, the approach"
                + ("" if series.object in ITEMS else ", its width"),
            },
            raw=raw,
        ),
        source=f"{name}.parquet",
    )
