"""A Universal Robots UR10e: motor currents along excitation trajectories, with and without a weighed load.

S. Mamedov, S. Mikhel, "Practical Aspects of Model-Based Collision Detection", Frontiers in Robotics and AI, 2020, and
its repository, whose ``UR10E_parameters.txt`` has drive gains, rigid parameters, motor inertias and friction as the
authors identified them. Torque is gain times current. The kinematics are those of the manufacturer's description.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from benchmarks.real import signals
from benchmarks.real.declare import EFFORTS, NOTHING, PUBLISHED, SEMI, WEIGHED, WHOLE, Case, Cause, File, Source
from benchmarks.real.logs import Array, Log, log

JOINTS: Final = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_DIGESTS: Final[Mapping[str, str]] = {
    "ur-20_01_31-unload": "513feea3e662364fad89214d5ff49e6ef96e02d56f85b4de57a408fc2563cb1c",
    "ur-20_02_10-30sec_12harm": "341fff80f177be564c8720ea898165addfd46d7cbe6f3ffd8923eeaae0eef000",
    "ur-20_02_12-50sec_12harm": "bb48cca42716a88f8b255d2d1b3eb3fa4a6eac4a9a52b694d4c1066ce8b4ca51",
    "ur-20_02_19_14harm50sec": "cd503afc985c41a6ad8fbe47d443c961eadbde4822a87ff3e17adcb2a24fa103",
    "ur-20_02_19_14harm50secLoad": "e689a99e5ff00ac38d03a2b9302e77688de0db8388b1d9c0e6aad3f77962758c",
    "ur-20_02_19_15harm50sec": "23d367463e0b1ad3fde0581304178fefc46a4729dfc97ea5dfaf23fdd5e30dcf",
    "ur-20_02_19_15harm50secLoad": "8e1db750ccc2cde660cf73d459eca0c6ff79a5a1cd60d715ef742ae06cbd800d",
}
SOURCE: Final = Source(
    "ur10e",
    "shamilmamedov/dynamic_calibration",
    "11af40e7deb758ec080a175fed8fcdd6c99aca29",
    "none stated: the user fetches it for their own use",
    tuple(
        File(f"ur10e/{name}.csv", f"dataset_ur10e/identification_data/{name}.csv", digest)
        for name, digest in _DIGESTS.items()
    ),
)
UNLOADED, LOADED, DERIVED = (
    tuple(f"ur10e/{name}.csv" for name in names)
    for names in (
        ("ur-20_02_12-50sec_12harm", "ur-20_02_19_15harm50sec"),
        ("ur-20_02_19_15harm50secLoad",),
        ("ur-20_01_31-unload", "ur-20_02_10-30sec_12harm", "ur-20_02_19_14harm50sec"),
    )
)
#: Columns of a file.
WIDTH: Final = 31
#: Torque over current [N·m/A].
GAINS: Final = (10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232)
#: Rotor inertia [kg·m²], on the joint's side.
ROTORS: Final = (0.0, 3.7434, 0.0, 0.0708, 0.2342, 0.4365)
#: Viscous [N·m·s/rad] and Coulomb friction [N·m].
VISCOUS: Final = (21.256, 20.221, 10.378, 3.575, 2.491, 3.026)
COULOMB: Final = (12.548, 13.266, 4.994, 1.998, 2.690, 2.298)
#: The load [kg] (estimate_drive_gains.m).
LOAD: Final = 2.805
#: Inertia about the joint's origin (xx, xy, xz, yy, yz, zz) [kg·m²], first moments [kg·m] and mass [kg] of each link.
LINKS: Final = (
    (16.01766, 0.0, 0.0, 16.01766, 0.0, 0.0, 0.0, 0.0, 0.0, 4.82736),
    (3.93252, 0.852873, 0.151907, 3.72056, -0.594538, 1.90316, 0.0499515, -0.275934, 3.26327, 7.92589),
    (2.22453, -0.536563, -0.176607, 1.38899, -0.216689, 1.38868, 0.0239479, 0.242903, 0.893879, 2.48086),
    (1.02974, 0.232810, -0.0122593, 0.0751258, 0.0743540, 1.06527, -0.000582815, -0.253394, 0.191763, 2.15600),
    (0.0286149, -0.0338339, -0.0256613, 0.108051, -0.0138456, 0.111089, 0.00787524, 0.0934251, 0.114659, 2.15599),
    (0.0283844, -0.00207559, -0.013982, 0.0353598, -0.0040084, 0.00814486, 0.0026661, -0.0010802, -0.0158006, 0.22217),
)  # fmt: skip
#: Of each joint: origin in the link before [m], angle about y [rad], axis.
FRAMES: Final = (
    ((0.0, 0.0, 0.181), 0.0, "0 0 1"),
    ((0.0, 0.176, 0.0), np.pi / 2, "0 1 0"),
    ((0.0, -0.137, 0.613), 0.0, "0 1 0"),
    ((0.0, 0.0, 0.571), np.pi / 2, "0 1 0"),
    ((0.0, 0.135, 0.0), 0.0, "0 0 1"),
    ((0.0, 0.0, 0.12), 0.0, "0 1 0"),
)
#: Flange, in the last link [m].
FLANGE: Final = (0.0, 0.117, 0.0)


def _table(path: Path) -> Array:
    """The rows of a file, without torn ones: some files end within a row or hold packets read at the wrong byte."""
    lines = (line.split(",") for line in path.read_text().splitlines())
    raw = np.array([[float(word) for word in line] for line in lines if len(line) == WIDTH])
    good = np.abs(raw[:, 0] - np.median(raw[:, 0])) < 1000.0  # s
    for first, most in ((1, 2 * np.pi), (7, 4.0), (13, 60.0)):  # rad, rad/s, A
        good &= (np.abs(raw[:, first : first + 6]) <= most).all(axis=1)
    raw = raw[good]
    gaps = np.flatnonzero(np.diff(raw[:50, 0]) > 0.1)  # a first row from before the recording
    return np.asarray(raw[gaps[-1] + 1 if len(gaps) else 0 :], dtype=np.float64)


def _logs(data: Path, places: Sequence[str], *, gain: Mapping[int, float] | None = None) -> list[Log]:
    made = []
    for place in places:
        raw = _table(data / place)
        gains = [k * (gain or {}).get(j, 1.0) for j, k in enumerate(GAINS)]
        by = [
            {joint: raw[:, first + j] * scale[j] for j, joint in enumerate(JOINTS)}
            for first, scale in ((1, [1.0] * 6), (7, [1.0] * 6), (13, gains))
        ]
        start = {joint: float(values[0]) for joint, values in by[0].items()}
        name = Path(place).stem
        made.append(log(name, raw[:, 0], position=by[0], velocity=by[1], effort=by[2], initial={"position": start}))
    return made


def model(*, rubs: bool = False) -> str:
    """The arm as identified; what its authors' constraints left on the edge of what a body can have is rounded up.

    Args:
        rubs: with the identified friction.
    """
    bodies = ""
    for k, (origin, angle, axis) in enumerate(FRAMES):
        about, moments, mass = LINKS[k][:6], np.array(LINKS[k][6:9]), LINKS[k][9]
        centre = moments / mass
        xx, xy, xz, yy, yz, zz = about
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        matrix = matrix - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        second = np.trace(matrix) / 2 * np.eye(3) - matrix  # of mass, none of whose moments can be negative
        values, vectors = np.linalg.eigh(second)
        second = vectors @ np.diag(np.maximum(values, 1e-5)) @ vectors.T
        inertia = np.trace(second) * np.eye(3) - second
        told = " ".join(f"{inertia[i, j]:.6g}" for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        rub = f' damping="{VISCOUS[k]}" frictionloss="{COULOMB[k]}"' if rubs else ""
        armature = f' armature="{ROTORS[k]}"' if ROTORS[k] else ""
        bodies += (
            f'\n    <body name="{JOINTS[k]}_link" pos="{_words(origin)}" euler="0 {angle:.9g} 0">'
            f'<joint name="{JOINTS[k]}" axis="{axis}"{armature}{rub}/>'
            f'<inertial pos="{_words(centre)}" mass="{mass:.6g}" fullinertia="{told}"/>'
        )
    bodies += (
        f'\n    <body name="tool" pos="{_words(FLANGE)}"><inertial pos="0 0 0" mass="1e-4" '
        'diaginertia="1e-7 1e-7 1e-7"/></body>' + "</body>" * len(FRAMES)
    )
    motors = "".join(f'<motor name="{joint}" joint="{joint}"/>' for joint in JOINTS)
    return f"""<mujoco model="ur10e">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>{bodies}
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>
"""


def _words(values: Sequence[float] | Array) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _needed(motion: signals.Motion) -> Array:
    """Torques that the rigid model needs along a motion, (T, 6)."""
    arm = mujoco.MjModel.from_xml_string(model())
    arm.dof_armature[:] = 0.0
    return signals.needed(arm, motion)


def _motion(data: Path, place: str) -> signals.Motion:
    raw = _table(data / place)
    return signals.motion(raw[:, 0], raw[:, 1:7], raw[:, 13:19] * np.array(GAINS), rate=100.0, cutoff=5.0)


def friction(data: Path, places: Sequence[str]) -> dict[str, float]:
    """Friction of every joint: what the identified rigid model leaves of the torques."""
    motions = [_motion(data, place) for place in places]
    left = np.vstack([one.beside - _needed(one) for one in motions])
    torque, speed, change = (
        np.vstack([getattr(one, name) for one in motions]) for name in ("beside", "velocity", "acceleration")
    )
    out: dict[str, float] = {}
    for j, joint in enumerate(JOINTS):
        rows = np.abs(speed[:, j]) > 0.01
        found = signals.fit(
            {
                "viscous": speed[rows, j],
                "coulomb": np.sign(speed[rows, j]),
                "armature": change[rows, j],
                "offset": np.ones(rows.sum()),
            },
            left[rows, j],
        )
        out |= {f"{joint}.{name}": value for name, value in found.values.items()}
        out[f"{joint}.explained"] = float(1 - found.residual.var() / torque[rows, j].var())
    return out


def regress(data: Path) -> dict[str, float]:
    """Friction along the recordings that no case has."""
    if not all((data / place).exists() for place in DERIVED):
        return {}
    return friction(data, DERIVED)


_PAPER: Final = "identified by Mamedov and Mikhel on 30 s of another trajectory; ours on three others within 15 %"
#: Of our regression: how far the two identifications are apart, and days from each other.
_VISCOUS: Final = ((17.5, 22.0), (17.0, 20.9), (8.5, 10.8), (2.5, 4.0), (2.0, 2.7), (2.6, 3.3))
_COULOMB: Final = ((12.0, 15.0), (12.8, 15.5), (4.7, 6.5), (1.9, 2.6), (2.5, 3.1), (2.1, 2.7))
_RUBS: Final = tuple(
    cause
    for k, joint in enumerate(JOINTS)
    for cause in (
        Cause(("coulomb_friction",), joint, COULOMB[k], "N·m", *_COULOMB[k], PUBLISHED, _PAPER),
        Cause(
            ("viscous_friction",), joint, VISCOUS[k], "N·m·s/rad", *_VISCOUS[k], PUBLISHED, _PAPER, ("servo_damping",)
        ),
    )
)
_LOAD: Final = Cause(
    ("payload",),
    "",
    LOAD,
    "kg",
    2.75,
    2.85,
    WEIGHED,
    "the authors' scales; the drive gains were found with the same load on another trajectory",
)
#: Friction is known to 15 %, rotors to 0.3 kg·m² (wrists) and 3 (shoulder).
_SMALL: Final = ("armature", "asymmetric_friction")
_RUBBING: Final = ("coulomb_friction", "viscous_friction")
_NOMINAL: Final = "kinematics of the manufacturer, links, rotors and drive gains as the authors identified them"
#: Of the elbow's current, in the case that withholds its gain.
WRONG_GAIN: Final = 0.75

CASES: Final = (
    Case(
        "ur10e-friction",
        "UR10e",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        UNLOADED,
        lambda data: _logs(data, UNLOADED),
        model,
        _NOMINAL,
        "all friction",
        _RUBS,
        truth_files=DERIVED,
        may=_SMALL,
    ),
    Case(
        "ur10e-load",
        "UR10e",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        LOADED,
        lambda data: _logs(data, LOADED),
        lambda: model(rubs=True),
        f"{_NOMINAL}, and its friction",
        "the load at the flange",
        (_LOAD,),
        truth_files=DERIVED,
        may=(*_SMALL, *_RUBBING),
        note="by regression its centre is 0.17 m off the flange and it weighs 2.5 kg; the gears' friction grows with "
        "what they carry: a rest is to be expected",
    ),
    Case(
        "ur10e-load-and-friction",
        "UR10e",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        LOADED,
        lambda data: _logs(data, LOADED),
        model,
        _NOMINAL,
        "the load at the flange and all friction",
        (_LOAD, *_RUBS),
        truth_files=DERIVED,
        may=_SMALL,
    ),
    Case(
        "ur10e-gain",
        "UR10e",
        SEMI,
        EFFORTS,
        SOURCE.name,
        UNLOADED,
        lambda data: _logs(data, UNLOADED, gain={2: WRONG_GAIN}),
        lambda: model(rubs=True),
        f"{_NOMINAL}, and its friction",
        "a quarter of the elbow's drive gain: its efforts read 0.75 of what they are",
        (
            Cause(
                ("torque_constant",),
                "elbow",
                round(1 / WRONG_GAIN, 4),
                "–",
                1.25,
                1.43,
                PUBLISHED,
                "the authors' drive gain, from a weighed load; our reader multiplies the current by 0.75 of it",
            ),
        ),
        truth_files=DERIVED,
        may=(*_SMALL, *_RUBBING),
        note="the factor is the true torque over what the efforts say (docs/effects.md)",
    ),
    Case(
        "ur10e-nothing",
        "UR10e",
        NOTHING,
        EFFORTS,
        SOURCE.name,
        UNLOADED,
        lambda data: _logs(data, UNLOADED),
        lambda: model(rubs=True),
        f"{_NOMINAL}, and its friction",
        "nothing",
        (),
        truth_files=DERIVED,
        may=(*_SMALL, *_RUBBING),
        note="friction is known to 15 %, so a rest of it may be named",
    ),
)
