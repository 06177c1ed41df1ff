"""Steady forces of a real TIAGo gripper with TA11 load cells over a held servo error (llach/learning_fc).

Two sessions squeezed wood and sponge. Only the product of servo stiffness and sensor gain shows in the slope of force
over servo error; the simulator has half of it here, and the slope of the *other* session of the same object is the
truth. The dead zone of these curves differs by session and is not asked for.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.real.declare import BOTH, NOTHING, REGRESSION, SEMI, Case, Cause, Source
from benchmarks.real.logs import Log
from tiago_mj.recordings.imports import ta11_curve
from tiago_mj.sensing.ta11_curve import MEASURED, is_sent

#: The 68 forces are facts that this package carries itself: there is nothing to fetch.
SOURCE: Final = Source(
    "ta11",
    "llach/learning_fc",
    "ee792cf (session A), 3dd34c2 (session B)",
    "numbers that this package carries",
    (),
)
#: Slope of the nominal simulator in the cases that withhold gain [sensor units per metre].
HALF: Final = 165.0


def _logs(data: Path, series: str, slope: float) -> list[Log]:
    del data
    made = []
    for folder, trial in ta11_curve.trials(ta11_curve.BUILTIN, slope):
        if folder != series:
            continue
        side = trial.sidecar
        given: dict[str, Any] = {
            key: getattr(side, key)
            for key in ("robot", "rate_hz", "interface", "servo", "sensing", "object", "initial")
            if getattr(side, key) is not None
        }
        columns = {f"command.{joint}": values for joint, values in trial.commands.items()}
        columns |= {f"force.{name}": values for name, values in trial.forces.items()}
        made.append(Log(trial.name, trial.time, columns, {**given, **(side.raw or {})}))
    return made


def regress(data: Path) -> dict[str, float]:
    """Slope [per metre] and dead zone [m] of every series, by a line."""
    del data
    out: dict[str, float] = {}
    for one in MEASURED:
        deep, felt = np.array(one.dq), np.array(one.force)
        sent = is_sent(deep)
        if sent.sum() > 2:
            slope, zero = np.polyfit(deep[sent], felt[sent], 1)
            out |= {
                f"{one.session}-{one.object}: slope": float(slope),
                f"{one.session}-{one.object}: dead": -zero / slope,
            }
    return out


#: What takes a constant from every force, which these curves have, by session 0.09 to 0.29 mm.
_DEAD: Final = (
    "coulomb_friction",
    "force_dead_zone",
    "backlash",
    "force_bias",
    "force_hysteresis",
    "force_drift",
    "asymmetric_friction",
    "command_deadband",
    "coupling_error",
)


def _half(series: str, other: str, slope: float, low: float, high: float) -> Case:
    return Case(
        f"ta11-half-{series.lower()}",
        "TA11 gripper",
        SEMI,
        BOTH,
        SOURCE.name,
        (),
        lambda data: _logs(data, series, HALF),
        None,
        f"this package's gripper at {HALF:g} sensor units per metre",
        "half of the product of servo stiffness and sensor gain",
        (
            Cause(
                ("servo_stiffness",),
                "",
                round(slope / HALF, 3),
                "–",
                round(low / HALF, 3),
                round(high / HALF, 3),
                REGRESSION,
                f"slope of {other}, another session with the same object: {slope:g} per metre",
                ("torque_constant", "force_gain"),
            ),
        ),
        may=_DEAD,
        parts=f"diagnosed: {series}; regression: {other}",
        note="forces scatter by 0.019 sensor units, and sessions by up to 25 % at 3 mm",
    )


CASES: Final = (
    _half("A-wood", "B-wood", 330.0, 290.0, 370.0),
    _half("B-wood", "A-wood", 333.0, 290.0, 370.0),
    _half("A-sponge", "B-sponge", 278.0, 240.0, 315.0),
    Case(
        "ta11-nothing-b-wood",
        "TA11 gripper",
        NOTHING,
        BOTH,
        SOURCE.name,
        (),
        lambda data: _logs(data, "B-wood", 330.0),
        None,
        "this package's gripper at 330 sensor units per metre",
        "nothing but a dead zone of 0.1 to 0.3 mm",
        (),
        may=_DEAD,
        parts="diagnosed: B-wood; regression: A-wood",
    ),
)
