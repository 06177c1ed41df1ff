"""The torque-limited simple pendulum of the same lab: one quasi direct drive, a weighed mass on a rod.

Swing-ups under two controllers, 333 and 500 Hz, with the drive's torque. The mass at the end (0.546 kg), rod, mount
and screws (0.13 kg) and the length (0.5 m) were weighed and measured (hardware/testbench_description.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.real import signals
from benchmarks.real.declare import EFFORTS, NOTHING, REGRESSION, SEMI, WEIGHED, WHOLE, Case, Cause, File, Source
from benchmarks.real.logs import Array, Log, log

JOINT: Final = "pendulum"
FILES: Final = tuple(
    f"simple_pendulum/{name}-data_measured.csv" for name in ("ddp", "direct_collocation", "energy_shaping")
)
DDP, COLLOCATION, SHAPING = FILES
_DIGESTS: Final = (
    "14748fd189abae7b6392a016f2f0494b54bb2a8c014bc435a84b58dbecb2da35",
    "c3f990980169815b93ab37078780e13803327dcb6fc9e019f2d261b988cdaf8f",
    "e1844e56f87cf763bdecb3f6f7e5b622a9a3b2d71e907b48ed6148b0a059c209",
)
SOURCE: Final = Source(
    "simple_pendulum",
    "dfki-ric-underactuated-lab/torque_limited_simple_pendulum",
    "ed17ea2d32a35ad944944ca03ef57693e2986732",
    "BSD-3-Clause",
    tuple(
        File(
            place,
            f"results/control_method_{Path(place).name.removesuffix('-data_measured.csv')}/data_measured.csv",
            digest,
        )
        for place, digest in zip(FILES, _DIGESTS, strict=True)
    ),
)
#: Weighed [kg] and measured [m].
POINT, ROD, LENGTH = 0.546, 0.13, 0.5
#: By regression, see CASES [N·m], [kg·m²].
COULOMB: Final = 0.16


def _table(path: Path) -> tuple[Array, Array, Array, Array]:
    raw = np.genfromtxt(path, delimiter=",", names=True)
    return tuple(np.asarray(raw[name], dtype=np.float64) for name in ("time", "position", "velocity", "torque"))  # type: ignore[return-value]


def _logs(data: Path, places: Sequence[str]) -> list[Log]:
    made = []
    for place in places:
        time, position, velocity, torque = _table(data / place)
        made.append(
            log(
                Path(place).stem.removesuffix("-data_measured"),
                time,
                position={JOINT: position},
                velocity={JOINT: velocity},
                effort={JOINT: torque},
                initial={"position": {JOINT: float(position[0])}},
            )
        )
    return made


def model(*, point: float = POINT, coulomb: float = 0.0) -> str:
    """A rod with a mass at its end, hanging down at 0.

    Args:
        point: mass at the end [kg].
        coulomb: dry friction [N·m].
    """
    rub = f' frictionloss="{coulomb:.6g}"' if coulomb else ""
    mass = max(point, 1e-4)  # a body of no mass is none to MuJoCo
    return f"""<mujoco model="simple_pendulum">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="rod">
      <joint name="{JOINT}" axis="0 -1 0"{rub}/>
      <geom type="capsule" fromto="0 0 0 0 0 {-LENGTH}" size="0.005" mass="{ROD}" contype="0" conaffinity="0"/>
      <body name="weight" pos="0 0 {-LENGTH}">
        <geom type="sphere" size="0.02" mass="{mass:.6g}" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="{JOINT}" joint="{JOINT}"/></actuator>
</mujoco>
"""


def pendulum(data: Path, place: str, until: float = np.inf) -> dict[str, float]:
    """Inertia [kg·m²], first moment [kg·m], friction of one recording.

    Args:
        data: the user's folder.
        place: which.
        until: what comes later is left out [s]: a pendulum that is balanced upright shows nothing.
    """
    time, position, _, torque = _table(data / place)
    rate = float(round(1 / np.median(np.diff(time))))
    motion = signals.motion(time, position[:, None], torque[:, None], rate=rate, cutoff=8.0)
    rows = motion.time - time[0] < until
    q, v, a = (x[rows, 0] for x in (motion.position, motion.velocity, motion.acceleration))
    found = signals.fit(
        {
            "inertia": a,
            "moment": 9.81 * np.sin(q),
            "viscous": v,
            "coulomb": signals.turning(v),
            "offset": np.ones_like(v),
        },
        motion.beside[rows, 0],
    )
    return {**found.values, "explained": found.explained}


def regress(data: Path) -> dict[str, float]:
    """By recording."""
    out: dict[str, float] = {}
    for name, place, until in (("ddp", DDP, np.inf), ("collocation", COLLOCATION, np.inf), ("shaping", SHAPING, 5.0)):
        out |= {f"{name}: {key}": value for key, value in pendulum(data, place, until).items()}
    return out


def _rubs(ours: str) -> tuple[Cause, ...]:
    return (Cause(("coulomb_friction",), JOINT, COULOMB, "N·m", 0.12, 0.22, REGRESSION, ours),)


#: A regression finds -0.005 to 0.02 N·m·s/rad; the rotor, 0.002 to 0.005 kg·m², is 1 to 3 % of the weight's inertia.
_SMALL: Final = ("viscous_friction", "armature")
_WEIGHED: Final = "masses and length as the lab weighed and measured them"

CASES: Final = (
    Case(
        "simple-pendulum-ddp",
        "simple pendulum",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        (DDP,),
        lambda data: _logs(data, (DDP,)),
        lambda: model(),
        _WEIGHED,
        "all friction",
        _rubs("0.16 N·m on the collocation's swing-up, 0.22 on that by energy shaping"),
        truth_files=(COLLOCATION, SHAPING),
        may=_SMALL,
    ),
    Case(
        "simple-pendulum-collocation",
        "simple pendulum",
        WHOLE,
        EFFORTS,
        SOURCE.name,
        (COLLOCATION,),
        lambda data: _logs(data, (COLLOCATION,)),
        lambda: model(),
        _WEIGHED,
        "all friction",
        _rubs("0.16 N·m on the swing-up by DDP, 0.22 on that by energy shaping"),
        truth_files=(DDP, SHAPING),
        may=_SMALL,
    ),
    Case(
        "simple-pendulum-payload",
        "simple pendulum",
        SEMI,
        EFFORTS,
        SOURCE.name,
        (DDP, COLLOCATION),
        lambda data: _logs(data, (DDP, COLLOCATION)),
        lambda: model(point=0.0, coulomb=COULOMB),
        "rod weighed, friction by regression on another recording",
        "the mass at the end",
        (
            Cause(
                ("payload",),
                "",
                POINT,
                "kg",
                0.53,
                0.58,
                WEIGHED,
                "the lab's scales; by the first moment along the recordings 0.57 kg",
            ),
        ),
        truth_files=(SHAPING,),
        may=(*_SMALL, "coulomb_friction"),
    ),
    Case(
        "simple-pendulum-nothing",
        "simple pendulum",
        NOTHING,
        EFFORTS,
        SOURCE.name,
        (DDP, COLLOCATION),
        lambda data: _logs(data, (DDP, COLLOCATION)),
        lambda: model(coulomb=COULOMB),
        f"{_WEIGHED}, friction by regression on another recording",
        "nothing",
        (),
        truth_files=(SHAPING,),
        may=(*_SMALL, "coulomb_friction"),
        note="dry friction is known to 0.05 N·m, so a rest of it may be named",
    ),
)
