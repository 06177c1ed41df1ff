"""A Franka Emika Panda, seven joints: torques of its joints' sensors along an exciting trajectory of 20 s.

C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca, "Dynamic Identification of the Franka Emika Panda Robot
With Retrieval of Feasible Parameters Using Penalty-Based Optimization", IEEE Robotics and Automation Letters, 2019, and
its repository: links, and friction as a sigmoid of each joint's speed.
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

_DIGESTS: Final = {
    "time": "031063612f297011dc005ab29830903e36f4bfeba77bce59c0fbde13620fb20d",
    "positions": "50bf82a082c439aff8220e8142985c8dd783f7ddc1415987cd75c9efb88bcf69",
    "velocity": "3340f299e926c501b66d540fa461ea0a7184b8dda32e505ebed062db57860d49",
    "torques": "11fda32785bb29ce444e14e0f45f4893aab7142dc6ee29576d828ab154852f9c",
}
SOURCE: Final = Source(
    "panda",
    "marcocognetti/FrankaEmikaPandaDynModel",
    "24d85ce4e648e2e894c832bfeee9b16711eb1a1a",
    "GPL-3.0",
    tuple(
        File(
            f"panda/exciting_traj_{name}.txt",
            f"matlab/data/Exciting_Traj/Trajectory_1/rbt_log/exciting_traj_{name}.txt",
            digest,
        )
        for name, digest in _DIGESTS.items()
    ),
)
PLACES: Final = tuple(file.place for file in SOURCE.files)
JOINTS: Final = tuple(f"joint_{k}" for k in range(1, 8))
#: Modified Denavit-Hartenberg: a [m], alpha [rad], d [m].
FRAMES: Final = (
    (0.0, 0.0, 0.333),
    (0.0, -np.pi / 2, 0.0),
    (0.0, np.pi / 2, 0.316),
    (0.0825, np.pi / 2, 0.0),
    (-0.0825, -np.pi / 2, 0.384),
    (0.0, np.pi / 2, 0.0),
    (0.088, np.pi / 2, 0.0),
)
#: Of each link: mass [kg], centre [m], inertia about it (xx, xy, xz, yy, yz, zz) [kg·m²].
LINKS: Final = (
    (4.970684, (3.875e-3, 2.081e-3, 0.0), (0.70337, -1.39e-4, 6.772e-3, 0.70661, 0.019169, 9.117e-3)),
    (0.646926, (-3.141e-3, -0.02872, 3.495e-3), (7.962e-3, -3.925e-3, 0.010254, 0.02811, 7.04e-4, 0.025995)),
    (3.228604, (0.027518, 0.039252, -0.066502), (0.037242, -4.761e-3, -0.011396, 0.036155, -0.012805, 0.01083)),
    (3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 7.796e-3, -1.332e-3, 0.019552, 8.641e-3, 0.028323)),
    (1.225946, (-0.011953, 0.041065, -0.038437), (0.035549, -2.117e-3, -4.037e-3, 0.029474, 2.29e-4, 8.627e-3)),
    (1.666555, (0.060149, -0.014117, -0.010517), (1.964e-3, 1.09e-4, -1.158e-3, 4.354e-3, 3.41e-4, 5.433e-3)),
    (0.735522, (0.010517, -4.252e-3, 0.061597), (0.012516, -4.28e-4, -1.196e-3, 0.010027, -7.41e-4, 4.815e-3)),
)
#: Friction: height of the sigmoid [N·m], twice the dry friction; speed at its middle [rad/s]; slope [s/rad].
HEIGHT: Final = (0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489)
MIDDLE: Final = (0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526)
SLOPE: Final = (5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336)


def _tables(data: Path) -> tuple[Array, Array, Array, Array]:
    """Time [s], position [rad], speed [rad/s], torque [N·m]."""
    time, *rest = (np.loadtxt(data / place) for place in PLACES)
    return (time, *(one.reshape(len(time), len(JOINTS)) for one in rest))  # type: ignore[return-value]


def recordings(data: Path, *, gain: float = 1.0) -> list[Log]:
    """Positions, speeds and efforts, 1 kHz, 21 s.

    Args:
        data: the user's folder.
        gain: of joint 4's efforts.
    """
    time, position, velocity, torque = _tables(data)
    torque[:, 3] *= gain
    by = [{joint: one[:, k] for k, joint in enumerate(JOINTS)} for one in (position, velocity, torque)]
    start = {joint: float(position[0, k]) for k, joint in enumerate(JOINTS)}
    return [log("panda", time, position=by[0], velocity=by[1], effort=by[2], initial={"position": start})]


def model(*, rubs: bool = False) -> str:
    """The arm as identified.

    Args:
        rubs: with half of each sigmoid's height as dry friction.
    """
    bodies = ""
    for k, (a, alpha, d) in enumerate(FRAMES):
        mass, centre, inertia = LINKS[k]
        rub = f' frictionloss="{HEIGHT[k] / 2:.6g}"' if rubs else ""
        origin = (a, -np.sin(alpha) * d, np.cos(alpha) * d)
        xx, xy, xz, yy, yz, zz = inertia
        told = " ".join(f"{one:.6g}" for one in (xx, yy, zz, xy, xz, yz))
        bodies += (
            f'\n    <body name="link_{k + 1}" pos="{_words(origin)}" euler="{alpha:.9g} 0 0">'
            f'<joint name="{JOINTS[k]}" axis="0 0 1"{rub}/>'
            f'<inertial pos="{_words(centre)}" mass="{mass}" fullinertia="{told}"/>'
        )
    motors = "".join(f'<motor name="{joint}" joint="{joint}"/>' for joint in JOINTS)
    return f"""<mujoco model="panda">
  <compiler angle="radian" balanceinertia="true"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>{bodies}{"</body>" * len(FRAMES)}
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>
"""


def _words(values: Sequence[float] | Array) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def regress(data: Path) -> dict[str, float]:
    """Friction that the published links leave of the torques; compared with what is published, no truth here."""
    time, position, _, torque = _tables(data)
    motion = signals.motion(time, position, torque, rate=500.0, cutoff=8.0)
    arm = mujoco.MjModel.from_xml_string(model())
    left = motion.beside - signals.needed(arm, motion)
    out: dict[str, float] = {}
    for j, joint in enumerate(JOINTS):
        speed = motion.velocity[:, j]
        columns = {
            "viscous": speed,
            "coulomb": signals.turning(speed, 0.02),
            "acceleration": motion.acceleration[:, j],
            "offset": np.ones_like(speed),
        }
        found = signals.fit(columns, left[:, j])
        shape = np.tanh(SLOPE[j] * (speed + MIDDLE[j]) / 2)
        sigmoid = signals.fit({"half": shape, "offset": np.ones_like(speed)}, left[:, j])
        out |= {f"{joint}.{name}": value for name, value in found.values.items()}
        out[f"{joint}.sigmoid"] = 2 * sigmoid["half"]
        out[f"{joint}.explained"] = float(1 - found.residual.var() / motion.beside[:, j].var())
    return out


_PAPER: Final = "half the height of the sigmoid that its authors identified; what of so soft a curve is dry is less"
#: Least squares of dry and viscous friction and a constant beside the published links: what is dry of the curve.
_DRY: Final = (0.247, 0.200, 0.165, 0.415, 0.326, 0.140, 0.241)
_RUBS: Final = tuple(
    Cause(
        ("coulomb_friction",),
        joint,
        round(HEIGHT[k] / 2, 4),
        "N·m",
        _DRY[k],
        round(HEIGHT[k] / 2, 4),
        PUBLISHED,
        _PAPER,
    )
    for k, joint in enumerate(JOINTS)
)
#: A soft curve is part viscous; its middle is off rest, which is a constant; links are known to some per cent.
_SMALL: Final = ("viscous_friction", "asymmetric_friction", "armature")
_NOMINAL: Final = "kinematics and links as the authors identified them"
#: Of joint 4's torque, in the case that withholds its gain.
WRONG_GAIN: Final = 0.75

CASES: Final = (
    Case(
        "panda-friction",
        "Panda",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        PLACES,
        recordings,
        model,
        _NOMINAL,
        "all friction",
        _RUBS,
        may=_SMALL,
    ),
    Case(
        "panda-gain",
        "Panda",
        SEMI,
        EFFORTS,
        SOURCE.name,
        PLACES,
        lambda data: recordings(data, gain=WRONG_GAIN),
        lambda: model(rubs=True),
        f"{_NOMINAL}, and half of each sigmoid's height as dry friction",
        "a quarter of joint 4's torque: its efforts read 0.75 of what they are",
        (
            Cause(
                ("torque_constant",),
                JOINTS[3],
                round(1 / WRONG_GAIN, 4),
                "–",
                1.28,
                1.39,
                PUBLISHED,
                "the maker's torque sensor, with which the links were identified; our reader takes a quarter away",
            ),
        ),
        may=(*_SMALL, "coulomb_friction"),
        note="the factor is the true torque over what the efforts say (docs/effects.md)",
    ),
    Case(
        "panda-nothing",
        "Panda",
        NOTHING,
        EFFORTS,
        SOURCE.name,
        PLACES,
        recordings,
        lambda: model(rubs=True),
        f"{_NOMINAL}, and half of each sigmoid's height as dry friction",
        "nothing",
        (),
        may=(*_SMALL, "coulomb_friction"),
    ),
)
