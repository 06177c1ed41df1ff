"""EMPS: a linear axis with a DC motor, the benchmark of friction identification.

A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", 2019 workshop on nonlinear system
identification benchmarks. A horizontal carriage on a ball screw; the control is a cascade,
``vir = kv (kp (qg - q) - v)``, and the force is ``gtau vir``, which is MuJoCo's position servo with the stiffness
``gtau kv kp`` and the damping ``gtau kv``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.real import signals
from benchmarks.real.declare import COMMANDS, EFFORTS, NOTHING, PUBLISHED, SEMI, WHOLE, Case, Cause, File, Source
from benchmarks.real.logs import Array, Log, log

FILE: Final = "emps/DATA_EMPS.mat"
SOURCE: Final = Source(
    "emps",
    "forgi86/sysid-neural-continuous",
    "956aa7ecd73061b0321c6f6098d74c9e4a7ce67a",
    "Apache-2.0 (repository); data by A. Janot",
    (
        File(
            FILE,
            "examples/EMPS/data/DATA_EMPS.mat",
            "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e",
        ),
    ),
)
JOINT: Final = "axis"
#: Published: carriage [kg], viscous [N·s/m] and Coulomb friction [N], constant force [N]; force per control [N/V].
MASS, VISCOUS, COULOMB, OFFSET, FORCE_PER_VOLT = 95.11, 203.5, 20.39, -3.16, 35.15
#: Of the cascade: position gain [1/s], speed gain [V·s/m].
POSITION_GAIN, SPEED_GAIN = 160.18, 243.45
#: The speed in the control is a difference of positions, 1.05 ms old: with it the law above meets the logged control to
#: 1 part in 1e7 (:func:`law`). The model's steps of 1 ms are late by half a millisecond themselves; the rest is, to
#: first order, a mass of ``-gtau kv 0.55 ms`` under the servo.
LATE: Final = 0.55e-3
LATE_MASS: Final = FORCE_PER_VOLT * SPEED_GAIN * LATE
#: What is left of a number that is withheld.
LESS: Final = 0.7


def _columns(data: Path) -> dict[str, Array]:
    from scipy.io import loadmat

    table = loadmat(data / FILE)
    return {name: np.asarray(table[name], dtype=np.float64).ravel() for name in ("t", "qg", "qm", "vir")}


def commanded(data: Path) -> list[Log]:
    """Reference [m] and position [m], 1 kHz."""
    raw = _columns(data)
    return [
        log(
            "emps",
            raw["t"],
            command={JOINT: raw["qg"]},
            position={JOINT: raw["qm"]},
            interface="position",
            rate_hz=1000,
            initial={"position": {JOINT: float(raw["qm"][0])}, "set_point": {JOINT: float(raw["qg"][0])}},
        )
    ]


def measured(data: Path) -> list[Log]:
    """Position [m] and force [N]; no command."""
    raw = _columns(data)
    return [
        log(
            "emps",
            raw["t"],
            position={JOINT: raw["qm"]},
            effort={JOINT: FORCE_PER_VOLT * raw["vir"]},
            rate_hz=1000,
            initial={"position": {JOINT: float(raw["qm"][0])}},
        )
    ]


def model(*, mass: float = MASS, rubs: bool = False, gain: float = 1.0, served: bool = False) -> str:
    """The axis. It steps with the control, which compares reference and position once a millisecond and holds the
    force: a servo that compares all the time, at 0.13 m/s, would give up to 89 N less.

    Args:
        mass: of the carriage [kg].
        rubs: with the published friction.
        gain: share of the published force per control that the servo has.
        served: it moves by the servo, whose speed is late; else its forces are known.
    """
    late = gain * LATE_MASS if served else 0.0
    rub = f' damping="{VISCOUS}" frictionloss="{COULOMB}"' if rubs else ""
    speed = gain * FORCE_PER_VOLT * SPEED_GAIN
    return f"""<mujoco model="emps">
  <option timestep="0.001" integrator="Euler" gravity="0 0 0"/>
  <worldbody>
    <body name="carriage">
      <joint name="{JOINT}" type="slide" axis="1 0 0"{rub}/>
      <geom type="box" size="0.1 0.1 0.05" mass="{mass - late:.6g}" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>
    <position name="{JOINT}" joint="{JOINT}" kp="{speed * POSITION_GAIN:.8g}" kv="{speed:.8g}"/>
  </actuator>
</mujoco>
"""


def law(data: Path) -> dict[str, float]:
    """The control as a sum of error, speed and acceleration of the axis, and speed of the reference."""
    raw = _columns(data)
    motion = signals.motion(
        raw["t"], raw["qm"][:, None], np.stack([raw["qg"], raw["vir"]], axis=1), rate=1000.0, cutoff=60.0
    )
    found = signals.fit(
        {
            "error": motion.beside[:, 0] - motion.position[:, 0],
            "speed": motion.velocity[:, 0],
            "acceleration": motion.acceleration[:, 0],
            "reference": np.gradient(motion.beside[:, 0]) * 1000.0,
        },
        motion.beside[:, 1],
    )
    return {
        "position gain": found["error"] / -found["speed"],
        "speed gain": -found["speed"],
        "late": found["acceleration"] / -found["speed"],
        "unexplained": 1 - found.explained,
    }


def regress(data: Path) -> dict[str, float]:
    """Mass, friction and constant force along the published motion; compared with what is published, no truth here."""
    raw = _columns(data)
    motion = signals.motion(
        raw["t"], raw["qm"][:, None], FORCE_PER_VOLT * raw["vir"][:, None], rate=1000.0, cutoff=40.0
    )
    speed = motion.velocity[:, 0]
    found = signals.fit(
        {
            "mass": motion.acceleration[:, 0],
            "viscous": speed,
            "coulomb": signals.turning(speed, 0.002),
            "offset": np.ones_like(speed),
        },
        motion.beside[:, 0],
    )
    told = {f"law: {key}": value for key, value in law(data).items()}
    return {**found.values, "explained": found.explained, **told}


_PAPER: Final = "Janot, Gautier, Brunot 2019: identified from this motion by its authors, residual 3 % of the force"
_RUBS: Final = (
    Cause(("coulomb_friction",), JOINT, COULOMB, "N", 19.3, 21.5, PUBLISHED, _PAPER),
    Cause(("viscous_friction",), JOINT, VISCOUS, "N·s/m", 193.0, 214.0, PUBLISHED, _PAPER, ("servo_damping",)),
)
_MASS: Final = Cause(
    ("armature", "payload"),
    JOINT,
    round((1 - LESS) * MASS, 3),
    "kg",
    27.5,
    29.5,
    PUBLISHED,
    f"{_PAPER}; the model has {LESS:g} of it, and on a level axis both names are the same mass",
    ("payload",),
)
#: The constant force of 3 N pushes one way: friction that differs by direction is what the library has for it.
_OFFSET: Final = ("asymmetric_friction", "gravity_tilt")
_ALL: Final = (FILE,)


def _case(name: str, kind: str, recording: str, withheld: str, causes: tuple[Cause, ...], **of_model: float) -> Case:
    return Case(
        f"emps-{name}",
        "EMPS",
        kind,
        recording,
        SOURCE.name,
        _ALL,
        commanded if recording == COMMANDS else measured,
        lambda: model(**of_model, served=recording == COMMANDS),  # type: ignore[arg-type]
        "mass, gains and force per volt as published"
        + (f"; {LATE_MASS:.3g} kg less, which is what the servo's late speed does" if recording == COMMANDS else ""),
        withheld,
        causes,
        may=_OFFSET,
    )


CASES: Final = (
    _case("commands-friction", WHOLE, COMMANDS, "all friction", _RUBS),
    _case("efforts-friction", WHOLE, EFFORTS, "all friction", _RUBS),
    _case("commands-mass", SEMI, COMMANDS, "0.3 of the mass", (_MASS,), mass=LESS * MASS, rubs=True),
    _case("efforts-mass", SEMI, EFFORTS, "0.3 of the mass", (_MASS,), mass=LESS * MASS, rubs=True),
    _case(
        "commands-gain",
        SEMI,
        COMMANDS,
        "0.3 of the force per control, in the servo",
        (
            Cause(
                ("torque_constant",),
                JOINT,
                round(1 / LESS, 4),
                "–",
                1.40,
                1.46,
                PUBLISHED,
                f"{_PAPER}; the model's servo has {LESS:g} of the force per volt",
                ("servo_stiffness",),
            ),
        ),
        rubs=True,
        gain=LESS,
    ),
    _case("efforts-nothing", NOTHING, EFFORTS, "nothing but a constant force of 3 N", (), rubs=True),
)
