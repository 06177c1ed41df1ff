"""A Feetech STS3250 that swings 1.13 kg at 0.12 m (Rhoban/bam, as it was in October 2024): goals and positions.

Its loads were not logged (they read zero). The authors' fit (params/feetech/m6.json of the same commit) has torque
constant, resistance, inertia and friction. The servo gives volts: 0.158 times its gain of 32 times the error, of 12 V.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.real.declare import COMMANDS, NOTHING, PUBLISHED, SEMI, WHOLE, Case, Cause, File, Source
from benchmarks.real.logs import Log, log
from tiago_mj.io.loading import load_json

JOINT: Final = "pendulum"
_STAMPS: Final = {
    "2024-10-26_12h23m27": "78d697ce9104c26d6452e41805de4649b75ec6de2c790bd2dfed403a461d7992",
    "2024-10-26_12h23m42": "1f2f6f02902d579d8b9a96fc6bd710f613cd7ce436a953a2d2ebd851ce1ef908",
    "2024-10-26_12h24m55": "a4bfe27a8bf8756cfe5a0eb5d874a17efa54bdce407312269229555a2a29bc95",
    "2024-10-26_12h27m27": "d84c743319df38b9221010d7cef2572f08ca07b73730cbded634a99ed815dace",
}
SOURCE: Final = Source(
    "sts3250",
    "Rhoban/bam",
    "d13c05771e2112b34b60ddccc9f226fef2cf7477",
    "Apache-2.0",
    tuple(File(f"sts3250/{stamp}.json", f"data_raw_feetech/{stamp}.json", digest) for stamp, digest in _STAMPS.items()),
)
#: Without ``sin_time_square``, whose errors of 0.7 rad saturate the servo in a way that its fit does not have.
FILES: Final = tuple(file.place for file in SOURCE.files if "12h24m55" not in file.place)
MASS, LENGTH = 1.13, 0.12
#: Torque constant [N·m/A], resistance [Ω], inertia [kg·m²], viscous friction [N·m·s/rad]: params/feetech/m6.json.
CONSTANT, RESISTANCE, ARMATURE, VISCOUS = 0.7007, 1.0219, 0.00879, 0.0550
#: Duty per error and gain [1/rad], gain, volts, most torque of the data sheet [N·m].
DUTY, GAIN, VOLTS, STRONGEST = 0.158, 32, 12.1, 4.9
STIFFNESS: Final = DUTY * GAIN * VOLTS * CONSTANT / RESISTANCE
BACK_EMF: Final = CONSTANT**2 / RESISTANCE
#: Of the motor's torque, between the fit's 0.16 in motion and 0.5 at rest.
BY_LOAD: Final = 0.25


def _logs(data: Path) -> list[Log]:
    made = []
    for place in FILES:
        facts = load_json(data / place, "it is no JSON")
        rows = facts["entries"]
        column = {
            name: np.array([float(row[name]) for row in rows])
            for name in ("timestamp", "position", "goal_position", "torque_enable")
        }
        on = column["torque_enable"] > 0
        until = slice(0, len(on) if on.all() else int(np.argmin(on)))
        position, goal = column["position"][until], column["goal_position"][until]
        made.append(
            log(
                str(facts["trajectory"]),
                column["timestamp"][until],
                command={JOINT: goal},
                position={JOINT: position},
                interface="position",
                initial={"position": {JOINT: float(position[0])}, "set_point": {JOINT: float(goal[0])}},
            )
        )
    return made


def model(*, gain: float = 1.0, moves: bool = True) -> str:
    """A point mass on a hinge, hanging down at 0, and the servo.

    Args:
        gain: share of the servo's stiffness.
        moves: with the viscous friction that the authors found.
    """
    rub = f' damping="{VISCOUS}"' if moves else ""
    return f"""<mujoco model="sts3250">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="{JOINT}" axis="0 -1 0" armature="{ARMATURE}"{rub}/>
      <geom type="sphere" pos="0 0 {-LENGTH}" size="0.01" mass="{MASS}" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>
    <position name="{JOINT}" joint="{JOINT}" kp="{gain * STIFFNESS:.6g}" kv="{BACK_EMF:.6g}"
              forcerange="{-STRONGEST} {STRONGEST}"/>
  </actuator>
</mujoco>
"""


def regress(data: Path) -> dict[str, float]:
    """Nothing: the truth is its authors'."""
    del data
    return {}


_FIT: Final = "the authors' fit of friction by load with a Stribeck part (m6), to these runs"
#: At 50 Hz with jitter, and half a volt of the supply, none of these is known.
_SMALL: Final = (
    "viscous_friction",
    "armature",
    "encoder_bias",
    "gravity_tilt",
    "asymmetric_friction",
    "backlash",
    "command_delay",
    "command_lag",
)
_KNOWN: Final = ({"name": "load_dependent_friction", "target": JOINT, "parameters": {"coefficient": BY_LOAD}},)
_NOMINAL: Final = "a weighed mass at a measured length; servo, inertia and viscous friction by the authors' fit"

CASES: Final = (
    Case(
        "sts3250-friction",
        "STS3250",
        WHOLE,
        COMMANDS,
        SOURCE.name,
        FILES,
        _logs,
        model,
        _NOMINAL,
        "dry friction and that by load",
        (Cause(("load_dependent_friction",), JOINT, None, "–", None, None, PUBLISHED, _FIT),),
        may=(*_SMALL, "servo_stiffness"),
        note="the fit has seven numbers for what is one kind of friction here, so no value is asked for; the servo's "
        "stiffness is the fit's, too",
    ),
    Case(
        "sts3250-gain",
        "STS3250",
        SEMI,
        COMMANDS,
        SOURCE.name,
        FILES,
        _logs,
        lambda: model(gain=0.5),
        f"{_NOMINAL}, friction by load between its values in motion and at rest",
        "half of the servo's stiffness",
        (
            Cause(
                ("servo_stiffness",),
                JOINT,
                2.0,
                "–",
                1.6,
                2.4,
                PUBLISHED,
                "gain, torque constant and resistance of the authors' fit",
                ("torque_constant",),
            ),
        ),
        may=(*_SMALL, "coulomb_friction"),
        known=_KNOWN,
    ),
    Case(
        "sts3250-nothing",
        "STS3250",
        NOTHING,
        COMMANDS,
        SOURCE.name,
        FILES,
        _logs,
        model,
        f"{_NOMINAL}, friction by load between its values in motion and at rest",
        "nothing",
        (),
        may=(*_SMALL, "coulomb_friction", "servo_stiffness"),
        known=_KNOWN,
    ),
)
