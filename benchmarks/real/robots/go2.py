"""A Unitree Go2 held in the air with its base fixed (iit-DLSLab): commanded and measured angles of its legs, 200 Hz.

One leg is diagnosed, the three others, which are built alike, gave the truth by regression. The links are Unitree's
as the simulators have them; the gains of 20 N·m/rad and 1.5 N·m·s/rad are the collection's configuration, so that every
torque here is in units of that stiffness: a value of a configuration is no truth, and forces are known no better.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from benchmarks.real import signals
from benchmarks.real.declare import COMMANDS, NOTHING, REGRESSION, SEMI, WHOLE, Case, Cause, File, Source
from benchmarks.real.logs import Array, Log, log

SOURCE: Final = Source(
    "go2",
    "iit-DLSLab/sim2real-robot-identification",
    "06739ea0424fa8b2e141df0942ecdaf27a5c8600",
    "BSD-3-Clause",
    (
        File(
            "go2/traj_0.pt",
            "datasets/go2/traj_0.pt",
            "f22b1625f331b724e84ebdae5b0679168307364ad93a1d9c3d9cf1620f38efb0",
        ),
    ),
)
FILES: Final = tuple(file.place for file in SOURCE.files)
#: The same numbers as a table, where somebody has made one.
TABLE: Final = "go2/in_air.csv"
LEGS: Final = ("FL", "FR", "RL", "RR")
PARTS: Final = ("hip", "thigh", "calf")
JOINTS: Final = tuple(f"{leg}_{part}_joint" for leg in LEGS for part in PARTS)
LEG: Final = "FL"
OWN: Final = tuple(f"{LEG}_{part}_joint" for part in PARTS)
#: Of the collection's configuration [N·m/rad], [N·m·s/rad]; of the rotors, as simulators have them [kg·m²].
STIFFNESS, DAMPING, ARMATURE = 20.0, 1.5, 0.01
#: Dry friction at that stiffness, by regression on the other legs [N·m].
COULOMB: Final = (0.19, 0.19, 0.8)
#: Of the front left leg: place in the link before [m], centre [m], quaternion, mass [kg], principal moments [kg·m²].
LINKS: Final = (
    ((0.1934, 0.0465, 0.0), (-0.0054, 0.00194, -0.000105), (0.497014, 0.499245, 0.505462, 0.498237), 0.678,
     (0.00088403, 0.000596003, 0.000479967)),
    ((0.0, 0.0955, 0.0), (-0.00374, -0.0223, -0.0327), (0.829533, 0.0847635, -0.0200632, 0.551623), 1.152,
     (0.00594973, 0.00584149, 0.000878787)),
    ((0.0, 0.0, -0.213), (0.00629595, -0.000622121, -0.141417), (0.710672, 0.00154099, -0.00450087, 0.703508), 0.241352,
     (0.0014901, 0.00146356, 5.31397e-05)),
)  # fmt: skip


def _read(data: Path) -> tuple[Array, Array, Array]:
    """Time [s], commanded and measured angles [rad], (T, 12)."""
    if (data / FILES[0]).exists():
        # A file of PyTorch is a zip archive; its three tensors lie in it as plain numbers. Nothing is unpickled.
        with zipfile.ZipFile(data / FILES[0]) as archive:
            time, measured, wanted = (
                np.frombuffer(archive.read(f"traj_0/data/{k}"), dtype="<f4").astype(np.float64) for k in range(3)
            )
        return time - time[0], wanted.reshape(len(time), -1), measured.reshape(len(time), -1)
    raw = np.genfromtxt(data / TABLE, delimiter=",", names=True, deletechars="")
    wanted, measured = (
        np.stack([raw[f"{kind}.{joint}"] for joint in JOINTS], axis=1) for kind in ("command", "position")
    )
    return np.asarray(raw["time"]), wanted, measured


def _logs(data: Path) -> list[Log]:
    time, wanted, measured = _read(data)
    columns = [JOINTS.index(joint) for joint in OWN]
    command, position = (
        {joint: values[:, k] for joint, k in zip(OWN, columns, strict=True)} for values in (wanted, measured)
    )
    return [
        log(
            f"go2-{LEG}",
            time,
            command=command,
            position=position,
            interface="position",
            rate_hz=200,
            initial={
                "position": {joint: float(values[0]) for joint, values in position.items()},
                "set_point": {joint: float(values[0]) for joint, values in command.items()},
            },
        )
    ]


def model(leg: str = LEG, *, gain: float = 1.0, rubs: bool = False) -> str:
    """One leg on a base that does not move.

    Args:
        leg: of :data:`LEGS`; they mirror the front left one.
        gain: share of the configured gains.
        rubs: with the friction that the other legs have.
    """
    side, end = (1 if leg[1] == "L" else -1), (1 if leg[0] == "F" else -1)
    bodies = ""
    for k, (place, centre, quaternion, mass, moments) in enumerate(LINKS):
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, np.array(quaternion) / np.linalg.norm(quaternion))
        axes = turn.reshape(3, 3)
        mirror = np.array([end if k == 0 else 1, side, 1])  # only the hip differs between front and rear
        tensor = axes @ np.diag(moments) @ axes.T * np.outer(mirror, mirror)
        told = " ".join(f"{tensor[i, j]:.6g}" for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        at = np.array(place) * np.array([end, side, 1])
        rub = f' frictionloss="{COULOMB[k]}"' if rubs else ""
        bodies += (
            f'\n    <body name="{leg}_{PARTS[k]}" pos="{_words(at)}">'
            f'<joint name="{leg}_{PARTS[k]}_joint" axis="{"1 0 0" if k == 0 else "0 1 0"}" armature="{ARMATURE}"{rub}/>'
            f'<inertial pos="{_words(np.array(centre) * mirror)}" mass="{mass}" fullinertia="{told}"/>'
        )
    servos = "".join(
        f'\n    <position name="{leg}_{part}_joint" joint="{leg}_{part}_joint" kp="{gain * STIFFNESS:g}" '
        f'kv="{gain * DAMPING:g}"/>'
        for part in PARTS
    )
    return f"""<mujoco model="go2_leg">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>{bodies}{"</body>" * len(LINKS)}
  </worldbody>
  <actuator>{servos}
  </actuator>
</mujoco>
"""


def _words(values: Array) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def leg(data: Path, name: str) -> dict[str, float]:
    """What the errors of a leg's servos follow: the torque that its links need, speed, and direction.

    The commands are shifted by the whole rows that explain most. Error = torque / stiffness + ...
    """
    time, wanted, measured = _read(data)
    columns = [JOINTS.index(f"{name}_{part}_joint") for part in PARTS]
    motion = signals.motion(time, measured[:, columns], wanted[:, columns], rate=200.0, cutoff=10.0)
    built = mujoco.MjModel.from_xml_string(model(name))
    built.dof_armature[:] = 0.0
    needed = signals.needed(built, motion)
    out: dict[str, float] = {}
    for k, part in enumerate(PARTS):
        best: tuple[int, signals.Fit] | None = None
        for late in range(8):
            rows = slice(late, None)
            error = motion.beside[: len(needed) - late, k] - motion.position[rows, k]
            speed = motion.velocity[rows, k]
            found = signals.fit(
                {
                    "compliance": needed[rows, k],
                    "lag": speed,
                    "dead": signals.turning(speed),
                    "offset": np.ones_like(speed),
                },
                error,
            )
            if best is None or found.explained > best[1].explained:
                best = late, found
        assert best is not None
        out |= {
            f"{part}.stiffness": 1 / best[1]["compliance"],
            f"{part}.coulomb at 20": best[1]["dead"] * STIFFNESS,
            f"{part}.lag": best[1]["lag"],
            f"{part}.delay": best[0] / 200.0,
            f"{part}.explained": best[1].explained,
        }
    return out


def regress(data: Path) -> dict[str, float]:
    """Of the legs that no case has."""
    return {f"{name} {key}": value for name in LEGS[1:] for key, value in leg(data, name).items()}


_OURS: Final = "our regression on the three other legs, at the configured stiffness of 20 N·m/rad"
_RANGES: Final = ((0.13, 0.23), (0.13, 0.26), (0.45, 1.25))
_RUBS: Final = tuple(
    Cause(("coulomb_friction",), joint, COULOMB[k], "N·m", *_RANGES[k], REGRESSION, _OURS)
    for k, joint in enumerate(OWN)
)
#: The servos are 10 to 20 ms late, which their damping hides; zeros are some mrad off.
_SMALL: Final = (
    "command_delay",
    "command_lag",
    "viscous_friction",
    "armature",
    "encoder_bias",
    "asymmetric_friction",
    "gravity_tilt",
)
_NOMINAL: Final = "Unitree's links; gains by the collection's configuration"
_PARTS: Final = f"diagnosed: the joints of {LEG}; regression: those of {', '.join(LEGS[1:])}"

CASES: Final = (
    Case(
        "go2-friction",
        "Go2",
        WHOLE,
        COMMANDS,
        SOURCE.name,
        FILES,
        _logs,
        model,
        _NOMINAL,
        "all friction",
        _RUBS,
        truth_files=FILES,
        may=(*_SMALL, "servo_stiffness"),
        parts=_PARTS,
        note="a few rows of delay and damping look alike here and may be named",
    ),
    Case(
        "go2-gain",
        "Go2",
        SEMI,
        COMMANDS,
        SOURCE.name,
        FILES,
        _logs,
        lambda: model(gain=0.5, rubs=True),
        f"{_NOMINAL}; dry friction by regression on the other legs",
        "half of both gains",
        tuple(
            Cause(
                ("servo_stiffness",),
                joint,
                1.75,
                "–",
                1.4,
                2.1,
                REGRESSION,
                "stiffness of hips and thighs of the three other legs, 14 to 18 N·m/rad against the torque that their "
                "links need, configured 20; the model has 10",
                ("torque_constant",),
            )
            for joint in OWN[:2]
        ),
        truth_files=FILES,
        may=(*_SMALL, "coulomb_friction", "servo_stiffness"),
        parts=_PARTS,
        note="the calf carries too little for its stiffness to show; naming it is allowed",
    ),
    Case(
        "go2-nothing",
        "Go2",
        NOTHING,
        COMMANDS,
        SOURCE.name,
        FILES,
        _logs,
        lambda: model(rubs=True),
        f"{_NOMINAL}; dry friction by regression on the other legs",
        "nothing but some ms of delay",
        (),
        truth_files=FILES,
        may=(*_SMALL, "coulomb_friction", "servo_stiffness"),
        parts=_PARTS,
    ),
)
