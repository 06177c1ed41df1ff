"""A LeRobot SO-101's servos, commanded and measured angles at 50 Hz (isaac-sim2real/sage), each joint by itself.

The nominal servo is a published one (a Feetech STS3215 as Open_Duck_Playground has it), without dry friction. Angles
alone give forces only over that servo's stiffness, and a dead zone that turns with the motion may be called dry
friction or play: both are right, each with the value that its dead zone has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.real import signals
from benchmarks.real.declare import COMMANDS, NOTHING, REGRESSION, WHOLE, Case, Cause, File, Source
from benchmarks.real.logs import Array, Log, log
from tiago_mj.recordings.imports import so101
from tiago_mj.recordings.trials import cut

STIFFNESS: Final = so101.STIFFNESS
SOURCE: Final = Source(
    "so101",
    so101.DATA.repository,
    so101.DATA.commit,
    so101.DATA.licence,
    tuple(
        File(f"so101/{name}", f"{so101.DATA.path}/{name}", digest)
        for name, digest in so101.DATA.sha256.items()
        if not name.startswith(("backlash_detection", "gripper_cycles", "step_response"))
    ),
)


def _places(*motions: str) -> tuple[str, ...]:
    return tuple(file.place for file in SOURCE.files if file.place.split("/")[1] in motions)


DIAGNOSED: Final = _places("multisine")
DERIVED: Final = _places("friction_gravity", "chirp_sweep")


def _whole(data: Path, motion: str, joint: str) -> tuple[Array, Array, Array]:
    """Time [s], command and position [rad] of one joint where both are known."""
    trial = next(so101.trials(str(data / "so101" / motion)))
    command, position = trial.commands[joint], trial.positions[joint]
    seen = np.isfinite(position)
    held = np.interp(trial.time, trial.time[np.isfinite(command)], command[np.isfinite(command)])
    return trial.time[seen], held[seen], position[seen]


def _logs(data: Path, joint: str) -> list[Log]:
    whole = next(so101.trials(str(data / "so101" / "multisine")))
    alone = replace(
        whole,
        commands={joint: whole.commands[joint]},
        positions={joint: whole.positions[joint]},
        velocities={},
        efforts={},
        sidecar=replace(whole.sidecar, initial=None),
    )
    made = []
    for part in cut(alone):
        position = part.positions[joint]
        start = float(position[np.isfinite(position)][0])
        made.append(
            log(
                part.name,
                part.time,
                command={joint: part.commands[joint]},
                position={joint: position},
                interface="position",
                rate_hz=whole.sidecar.rate_hz,
                initial={"position": {joint: start}},
                uncertainty=so101.KNOWN_TO,
            )
        )
    return made


def servo_errors(data: Path, motion: str, joint: str) -> dict[str, float]:
    """What the error of a servo follows along a motion: speed, direction, place."""
    time, command, position = _whole(data, motion, joint)
    motion_ = signals.motion(time, position[:, None], command[:, None], rate=49.85, cutoff=5.0)
    speed = motion_.velocity[:, 0]
    found = signals.fit(
        {
            "lag": speed,
            "dead": signals.turning(speed, 0.03),
            "inertia": motion_.acceleration[:, 0],
            "offset": np.ones_like(speed),
            "slope": motion_.position[:, 0],
        },
        motion_.beside[:, 0] - motion_.position[:, 0],
    )
    return {**found.values, "explained": found.explained}


def regress(data: Path, joints: Sequence[str] = ("Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")) -> dict[str, float]:
    """Along the motions that no case has."""
    return {
        f"{joint} {motion}: {key}": value
        for joint in joints
        for motion in ("friction_gravity", "chirp_sweep")
        for key, value in servo_errors(data, motion, joint).items()
    }


def _model(joint: str) -> str:
    return so101.servo(joint)


def _case(joint: str, dead: float, low: float, high: float) -> Case:
    """Dry friction or play of one joint; half widths of the dead zone [rad]."""
    rubs = Cause(
        ("coulomb_friction",),
        joint,
        round(dead * STIFFNESS, 4),
        "N·m",
        round(low * STIFFNESS, 4),
        round(high * STIFFNESS, 4),
        REGRESSION,
        f"half a dead zone of {dead * 1e3:.0f} mrad ({low * 1e3:.0f} to {high * 1e3:.0f}) along two other motions, "
        f"times {STIFFNESS:g} N·m/rad",
        others=(("backlash", 2 * low, 2 * high),),
    )
    return Case(
        f"so101-{joint.lower().replace('_', '-')}",
        "SO-101",
        WHOLE,
        COMMANDS,
        SOURCE.name,
        DIAGNOSED,
        lambda data: _logs(data, joint),
        lambda: _model(joint),
        "a published servo of this type at the gain of the recordings; the arm around it is not known",
        "dry friction and play",
        (rubs,),
        truth_files=DERIVED,
        may=_SMALL,
        note="how links and weight act on a servo is stated as uncertainty in the sidecars",
    )


#: Speeds lag by 72 to 96 ms where the nominal servo has 67; the encoder's steps are 1.5 mrad.
_SMALL: Final = (
    "viscous_friction",
    "servo_damping",
    "command_delay",
    "command_lag",
    "armature",
    "encoder_bias",
    "encoder_scale",
    "encoder_quantization",
    "asymmetric_friction",
)

CASES: Final = (
    _case("Wrist_Roll", 0.012, 0.009, 0.015),
    _case("Wrist_Pitch", 0.013, 0.009, 0.017),
    _case("Elbow", 0.035, 0.030, 0.040),
    Case(
        "so101-jaw-nothing",
        "SO-101",
        NOTHING,
        COMMANDS,
        SOURCE.name,
        DIAGNOSED,
        lambda data: _logs(data, "Jaw"),
        lambda: _model("Jaw"),
        "a published servo of this type at the gain of the recordings; the jaw carries nothing",
        "nothing but a tenth of the damping",
        (),
        truth_files=DERIVED,
        may=_SMALL,
        note="its dead zone is below 1 mrad along the motion of the regression, less than a step of its encoder; its "
        "speed lags by 80 ms where the nominal servo has 67",
    ),
)
