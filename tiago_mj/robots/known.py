"""What is known of each robot, with its source; the model itself is the user's, from MuJoCo Menagerie."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

#: Gains that somebody chose for a simulator, where the maker publishes none.
GUESSED: Final = "guessed"


@dataclass(frozen=True)
class KnownRobot:
    """A robot.

    Attributes:
        name: on the command line.
        title: its maker's name for it.
        folder, file: of its model in MuJoCo Menagerie.
        joints: joint of every actuator that is commanded, by its name.
        home: position of every joint around which motions are recorded [m, rad], in the order of ``joints``.
        stroke: how far each joint goes to either side of it [m, rad].
        rate_hz: of the commands that its usual driver sends.
        gains: what is known of them, as ``--gains`` says it; None: the user's own controller has them.
        gains_from: source of the gains, or why none are known.
        names: other names of joints, as drivers and data sets have them, by the model's.
        columns: of the maker's own logs, as a map file has them.
        columns_from: which logs these are.
        base: ``fixed`` where the model floats and logs are made with the base held.
        like: what the joints of like parts begin with.
        uncertainty: of numbers of the model, one standard deviation, as a sidecar has it.
        commands: factor from a unit of the joint to that of the actuator's command.
    """

    name: str
    title: str
    folder: str
    file: str
    joints: Mapping[str, str]
    home: tuple[float, ...]
    stroke: tuple[float, ...]
    rate_hz: float
    gains: str | None
    gains_from: str
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    columns: Mapping[str, Any] = field(default_factory=dict)
    columns_from: str = ""
    base: str | None = None
    like: tuple[str, ...] = ()
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    commands: float = 1.0

    @property
    def facts(self) -> dict[str, Any]:
        """What a map file would say of it for all recordings."""
        said = {"gains": self.gains, "base": self.base, "like": list(self.like), "uncertainty": dict(self.uncertainty)}
        return {key: value for key, value in said.items() if value}

    @property
    def map(self) -> dict[str, Any]:
        """Columns of its logs: by other names of its joints, and of its maker's logs; used where they are there."""
        actuators = {joint: actuator for actuator, joint in self.joints.items()}
        found: dict[str, Any] = {}
        for joint, others in self.names.items():
            for other in others:
                kinds = ("position", "velocity", "effort")
                found |= {f"{kind}.{other}": {"kind": kind, "name": joint} for kind in kinds}
                found[f"command.{other}"] = {"kind": "command", "name": actuators[joint]}
        return {**found, **self.columns}


def _numbered(prefix: str, count: int) -> dict[str, str]:
    """Actuators ``prefix1`` … of the joints ``joint1`` …"""
    return {f"{prefix}{k}": f"joint{k}" for k in range(1, count + 1)}


_UR_JOINTS: Final = {
    name: f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
}


def _rtde() -> dict[str, Any]:
    """Columns of a table of the Real-Time Data Exchange: a vector's numbers are called name_0, name_1 …"""
    found: dict[str, Any] = {"timestamp": {"kind": "time", "unit": "s"}}
    for k, (actuator, joint) in enumerate(_UR_JOINTS.items()):
        found[f"target_q_{k}"] = {"kind": "command", "name": actuator, "unit": "rad"}
        found[f"actual_q_{k}"] = {"kind": "position", "name": joint, "unit": "rad"}
        found[f"actual_qd_{k}"] = {"kind": "velocity", "name": joint, "unit": "rad/s"}
    return found


def _universal(name: str, title: str) -> KnownRobot:
    return KnownRobot(
        name=name,
        title=title,
        folder=f"universal_robots_{name}",
        file=f"{name}.xml",
        joints=_UR_JOINTS,
        home=(-math.pi / 2, -math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, 0.0),
        stroke=(0.4, 0.3, 0.4, 0.5, 0.5, 0.6),
        rate_hz=125.0,
        gains=GUESSED,
        gains_from="Universal Robots publishes none; the model's were chosen for the simulator",
        columns=_rtde(),
        columns_from="Real-Time Data Exchange, as its client writes tables: timestamp, target_q_0, actual_q_0 …",
    )


_SO101: Final = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
_LEGS: Final = ("FL", "FR", "RL", "RR")
_GO2: Final = {f"{leg}_{part}": f"{leg}_{part}_joint" for leg in _LEGS for part in ("hip", "thigh", "calf")}
_WIDOWX: Final = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")

ROBOTS: Final[tuple[KnownRobot, ...]] = (
    KnownRobot(
        name="so101",
        title="The Robot Studio SO-101, six Feetech STS3215",
        folder="robotstudio_so101",
        file="so101.xml",
        joints={name: name for name in _SO101},
        home=(0.0, 0.0, 0.0, 0.0, 0.0, 0.8),
        stroke=(0.6, 0.5, 0.5, 0.6, 0.8, 0.6),
        rate_hz=50.0,
        gains="kp=±50%,kv=±50%",
        gains_from="Menagerie computes them for P = 16, the servos' setting in LeRobot; another P scales them",
        names=dict(
            zip(
                _SO101,
                (("Rotation",), ("Pitch",), ("Elbow",), ("Wrist_Pitch",), ("Wrist_Roll",), ("Jaw",)),
                strict=True,
            )
        ),
        columns_from="LeRobot data sets are imported: tiago-mj import lerobot FOLDER --model …/so101.xml",
    ),
    _universal("ur5e", "Universal Robots UR5e"),
    _universal("ur10e", "Universal Robots UR10e"),
    KnownRobot(
        name="panda",
        title="Franka Emika Panda",
        folder="franka_emika_panda",
        file="panda.xml",
        joints=_numbered("actuator", 7),
        home=(0.0, 0.0, 0.0, -math.pi / 2, 0.0, math.pi / 2, -math.pi / 4),
        stroke=(0.4, 0.3, 0.4, 0.4, 0.5, 0.5, 0.6),
        rate_hz=100.0,
        gains=GUESSED,
        gains_from="Franka publishes none; the model's were chosen for the simulator",
        names={f"joint{k}": (f"panda_joint{k}", f"fr3_joint{k}") for k in range(1, 8)},
        columns_from="joint names of franka_description: panda_joint1 …",
    ),
    KnownRobot(
        name="go2",
        title="Unitree Go2, its base held and its legs in the air",
        folder="unitree_go2",
        file="go2.xml",
        joints=_GO2,
        home=(0.0, 0.9, -1.8) * 4,
        stroke=(0.3, 0.4, 0.4) * 4,
        rate_hz=200.0,
        gains=None,
        gains_from="they are sent with every command: give yours, --gains kp,kd",
        base="fixed",
        like=_LEGS,
        columns_from="joint names of its URDF: FL_hip_joint …",
    ),
    KnownRobot(
        name="xarm7",
        title="UFACTORY xArm7",
        folder="ufactory_xarm7",
        file="xarm7.xml",
        joints=_numbered("act", 7),
        home=(0.0, -0.247, 0.0, 0.909, 0.0, 1.15644, 0.0),
        stroke=(0.4, 0.3, 0.4, 0.4, 0.5, 0.4, 0.6),
        rate_hz=100.0,
        gains=GUESSED,
        gains_from="UFACTORY publishes none; the model's were chosen for the simulator",
        columns_from="joint names of xarm_ros: joint1 …",
    ),
    KnownRobot(
        name="2f85",
        title="Robotiq 2F-85",
        folder="robotiq_2f85",
        file="2f85.xml",
        joints={"fingers_actuator": "right_driver_joint"},
        home=(0.4,),
        stroke=(0.3,),
        rate_hz=50.0,
        gains=GUESSED,
        gains_from="Robotiq publishes none; the model's were chosen for the simulator",
        names={"right_driver_joint": ("finger_joint", "robotiq_85_left_knuckle_joint")},
        columns_from="joint names of its drivers: finger_joint [rad]; commands as its register, 0 to 255",
        commands=255 / 0.8,
    ),
    KnownRobot(
        name="widowx",
        title="Trossen WidowX 250 6DOF",
        folder="trossen_wx250s",
        file="wx250s.xml",
        joints={name: name for name in _WIDOWX},
        home=(0.0, -0.96, 1.16, 0.0, -0.3, 0.0),
        stroke=(0.5, 0.3, 0.3, 0.5, 0.5, 0.6),
        rate_hz=50.0,
        gains=GUESSED,
        gains_from="Dynamixel registers, not N·m/rad; the model's were chosen for the simulator",
        columns_from="joint names of interbotix_ros_arms: waist …",
    ),
)
BY_NAME: Final[Mapping[str, KnownRobot]] = {robot.name: robot for robot in ROBOTS}


def named(name: str) -> KnownRobot:
    """A robot by its name.

    Raises:
        ValueError: there is none of that name; one line.
    """
    if name not in BY_NAME:
        raise ValueError(
            f"--robot {name}: there is no such robot: there are {', '.join(BY_NAME)}; or give --model FILE"
        )
    return BY_NAME[name]
