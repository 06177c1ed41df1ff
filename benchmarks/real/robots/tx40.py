"""A Stäubli TX40: motor torques along an excitation trajectory; the motors of its two last joints are coupled.

The recording is published with Figaroh (thanhndv212/figaroh-plus), with the links of a CAD model and what was
identified along it (``results/TX40_bp_5.csv``, ordinary least squares, with relative deviations). The motor of joint 6
turns with the sum of the speeds of joints 5 and 6, so that its rotor and its friction act on both.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from benchmarks.real import signals
from benchmarks.real.declare import EFFORTS, NOTHING, PUBLISHED, SEMI, WHOLE, Case, Cause, File, Source
from benchmarks.real.logs import Array, Log, log

PLACES: Final = ("tx40/pos_read_data.csv", "tx40/curr_data.csv")
_DIGESTS: Final = (
    "5cc1cecc1024ef0e331d0caba06f689456ab789ec3f1e904599c0a8be5c27bc8",
    "f4592f4ba4db42f5d7625688986be25b575ca34d0504b27979ca6b0276bd3af9",
)
SOURCE: Final = Source(
    "tx40",
    "thanhndv212/figaroh-plus",
    "c3b5172849b744984b7181fd9d517c83fb4242e1",
    "Apache-2.0",
    tuple(
        File(place, f"examples/staubli_TX40/data/{Path(place).name}", digest)
        for place, digest in zip(PLACES, _DIGESTS, strict=True)
    ),
)
JOINTS: Final = tuple(f"joint_{k}" for k in range(1, 7))
#: Rows of the files, and of the recordings that are made of them [Hz].
RATE, ROWS = 5000, 1000
#: Motor's over joint's turns.
GEARS: Final = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)
#: Of the encoders' zero from the joints' [rad].
ZERO: Final = (0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0)
#: Of the motor that turns with joints 5 and 6, on the joints' side: viscous friction [N·m·s/rad], Coulomb friction
#: [N·m], rotor inertia [kg·m²].
SHARED_VISCOUS, SHARED_COULOMB, SHARED_ROTOR = 0.597, 2.033, 0.00768
#: The same of every joint. Those of joints 5 and 6 are published with what the shared motor does by the joint's own
#: speed and acceleration (1.858 and 0.644 N·m·s/rad, 0.0436 kg·m²), which is taken out here. Rotors of joints 1 and 2
#: are those of the repository's configuration, and joint 6 has none of its own to speak of.
VISCOUS: Final = (8.107, 5.601, 1.978, 1.107, 1.858 - SHARED_VISCOUS, 0.644 - SHARED_VISCOUS)
COULOMB: Final = (6.967, 8.123, 6.307, 2.484, 3.026, 0.244)
ROTORS: Final = (0.362, 0.362, 0.0921, 0.0318, 0.0436 - SHARED_ROTOR, 1e-4)
#: Published relative deviations of both, and of the shared motor's.
VISCOUS_TO, COULOMB_TO = (0.005, 0.008, 0.017, 0.03, 0.023), (0.017, 0.014, 0.017, 0.048, 0.037)
SHARED_TO: Final = (0.047, 0.027)
#: Of each joint: origin in the link before [m], its angles (fixed axes x, y, z) [rad].
FRAMES: Final = (
    ((0.0, 0.0, 0.32), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0)),
    ((0.225, 0.0, 0.035), (0.0, 0.0, 0.0)),
    ((0.0, -0.225, 0.0), (np.pi / 2, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (np.pi / 2, np.pi, 0.0)),
)
#: Of each link: mass [kg], centre [m], angle of the inertia's frame about z [rad], inertia (xx, yy, zz, xy, xz, yz)
#: [kg·m²], as the CAD model has them, to a gram square metre; none of which is given for the last link.
LINKS: Final = (
    (10.5, (0.0, 0.020, -0.043), 0.0, (0.055, 0.047, 0.035, 0.0, 0.0, 0.003)),
    (3.6, (0.109, -0.002, 0.134), -np.pi / 2, (0.009, 0.038, 0.040, 0.0, 0.002, 0.0)),
    (4.07, (0.008, 0.006, 0.041), -np.pi / 2, (0.012, 0.012, 0.004, 0.0, 0.001, -0.001)),
    (3.62, (-0.004, 0.002, -0.107), np.pi / 2, (0.013, 0.014, 0.004, 0.0, 0.0, 0.001)),
    (1.02, (-0.004, -0.003, -0.001), -np.pi / 2, (0.001, 0.001, 0.001, 0.0, 0.0, 0.0)),
    (0.2, (0.0, 0.0, 0.042), -np.pi / 2, (1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0)),
)  # fmt: skip


def _tables(data: Path) -> tuple[Array, Array]:
    """Joint positions [rad] and torques [N·m] of the joints' sides, (T, 6), means of 5 rows."""
    turned, torque = (np.loadtxt(data / place, delimiter=",", skiprows=1) for place in PLACES)
    gears = np.diag(GEARS)
    gears[5, 4] = GEARS[5]  # the motor of joint 6 turns with joint 5 as well, and so pushes both
    position = turned @ np.linalg.inv(gears).T + np.array(ZERO)
    effort = torque @ gears
    together = RATE // ROWS
    rows = len(position) // together * together
    return tuple(table[:rows].reshape(-1, together, 6).mean(axis=1) for table in (position, effort))  # type: ignore[return-value]


def recordings(data: Path) -> list[Log]:
    """Positions and efforts, 1 kHz, 9 s."""
    position, effort = _tables(data)
    return [
        log(
            "tx40",
            np.arange(len(position)) / ROWS,
            position={joint: position[:, k] for k, joint in enumerate(JOINTS)},
            effort={joint: effort[:, k] for k, joint in enumerate(JOINTS)},
            rate_hz=ROWS,
            initial={"position": {joint: float(position[0, k]) for k, joint in enumerate(JOINTS)}},
        )
    ]


def model(*, rubs: bool = False, shared: bool = True, rotors: bool = True) -> str:
    """The arm; the motor of two joints is a fixed tendon over both.

    Args:
        rubs: with the published friction.
        shared: with that of the shared motor, too.
        rotors: with the published rotors.
    """
    bodies = ""
    for k, (origin, angles) in enumerate(FRAMES):
        mass, centre, turned, inertia = LINKS[k]
        armature = f' armature="{ROTORS[k]:.6g}"' if rotors else ""
        rub = f' damping="{VISCOUS[k]:.6g}" frictionloss="{COULOMB[k]}"' if rubs else ""
        cosine, sine = np.cos(turned), np.sin(turned)
        turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
        xx, yy, zz, xy, xz, yz = inertia
        matrix = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        told = " ".join(f"{matrix[i, j]:.6g}" for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        bodies += (
            f'\n    <body name="link_{k + 1}" pos="{_words(origin)}" euler="{_words(angles)}">'
            f'<joint name="{JOINTS[k]}" axis="0 0 1"{armature}{rub}/>'
            f'<inertial pos="{_words(centre)}" mass="{mass}" fullinertia="{told}"/>'
        )
    armature = f' armature="{SHARED_ROTOR}"' if rotors else ""
    rub = f' damping="{SHARED_VISCOUS}" frictionloss="{SHARED_COULOMB}"' if rubs and shared else ""
    both = "".join(f'<joint joint="{joint}" coef="1"/>' for joint in JOINTS[4:])
    motors = "".join(f'<motor name="{joint}" joint="{joint}"/>' for joint in JOINTS)
    return f"""<mujoco model="tx40">
  <compiler angle="radian" eulerseq="XYZ" balanceinertia="true"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>{bodies}{"</body>" * len(FRAMES)}
  </worldbody>
  <tendon><fixed name="motor_6"{armature}{rub}>{both}</fixed></tendon>
  <actuator>{motors}</actuator>
</mujoco>
"""


def _words(values: Sequence[float] | Array) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def regress(data: Path) -> dict[str, float]:
    """Friction and rotors that the CAD links leave of the torques; compared with what is published, no truth here."""
    position, effort = _tables(data)
    time = np.arange(len(position)) / ROWS
    motion = signals.motion(time, position, effort, rate=ROWS, cutoff=20.0)
    arm = mujoco.MjModel.from_xml_string(model(rotors=False))
    left = motion.beside - signals.needed(arm, motion)
    out: dict[str, float] = {}
    both_speed, both_change = (getattr(motion, name)[:, 4:].sum(axis=1) for name in ("velocity", "acceleration"))
    for j, joint in enumerate(JOINTS):
        speed = motion.velocity[:, j]
        columns = {
            "viscous": speed,
            "coulomb": signals.turning(speed, 0.02),
            "rotor": motion.acceleration[:, j],
            "offset": np.ones_like(speed),
        }
        if j >= 4:
            columns |= {
                "shared viscous": both_speed,
                "shared coulomb": signals.turning(both_speed, 0.02),
                "shared rotor": both_change,
            }
        found = signals.fit(columns, left[:, j])
        out |= {f"{joint}.{name}": value for name, value in found.values.items()}
        out[f"{joint}.explained"] = float(1 - found.residual.var() / motion.beside[:, j].var())
    return out


#: Deviations of the published numbers that count as their uncertainty.
NINETY: Final = 1.645
_PAPER: Final = "identified along this motion by those who published it; least squares beside the CAD links agree"


def _cause(effect: str, joint: str, value: float, unit: str, known_to: float, alike: tuple[str, ...] = ()) -> Cause:
    off = NINETY * known_to * value
    return Cause(
        (effect,), joint, round(value, 4), unit, round(value - off, 4), round(value + off, 4), PUBLISHED, _PAPER, alike
    )


_RUBS: Final = tuple(
    cause
    for k, joint in enumerate(JOINTS[:5])
    for cause in (
        _cause("coulomb_friction", joint, COULOMB[k], "N·m", COULOMB_TO[k]),
        _cause("viscous_friction", joint, VISCOUS[k], "N·m·s/rad", VISCOUS_TO[k], ("servo_damping",)),
    )
)
_SHARED: Final = (
    _cause("coupled_motor_friction", JOINTS[5], SHARED_COULOMB, "N·m", SHARED_TO[0]),
    _cause("coupled_motor_damping", JOINTS[5], SHARED_VISCOUS, "N·m·s/rad", SHARED_TO[1]),
)
#: Joint 6 has 0.24 N·m of its own; links of a CAD model and constants that the model lacks are left to these.
_SMALL: Final = ("armature", "asymmetric_friction", "coulomb_friction")
#: Known to a few per cent, so that a rest of it may be named.
_RUBBING: Final = ("viscous_friction",)
_NOMINAL: Final = "links of a CAD model; rotors as published"

CASES: Final = (
    Case(
        "tx40-friction",
        "TX40",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        PLACES,
        recordings,
        model,
        _NOMINAL,
        "all friction, that of the motor that turns with joints 5 and 6 among it",
        (*_RUBS, *_SHARED),
        may=_SMALL,
    ),
    Case(
        "tx40-motor",
        "TX40",
        SEMI,
        EFFORTS,
        SOURCE.name,
        PLACES,
        recordings,
        lambda: model(rubs=True, shared=False),
        f"{_NOMINAL}; friction of the joints as published",
        "friction of the motor that turns with joints 5 and 6",
        _SHARED,
        may=(*_SMALL, *_RUBBING),
    ),
    Case(
        "tx40-nothing",
        "TX40",
        NOTHING,
        EFFORTS,
        SOURCE.name,
        PLACES,
        recordings,
        lambda: model(rubs=True),
        f"{_NOMINAL}; friction as published",
        "nothing",
        (),
        may=(*_SMALL, *_RUBBING),
    ),
)
