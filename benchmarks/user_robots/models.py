"""Twelve small robots, written as plain MJCF (one as URDF) the way a newcomer writes them, in files.

Masses and sizes are those of ordinary hardware; servos are MuJoCo's stock ones. Some angles are in degrees (MuJoCo's
default), some in radians; some joints have no damping at all; time steps are 1 to 5 ms.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tiago_mj.models.convert import convert

#: Their models: MJCF, one URDF.
ROBOTS: Final = Path(__file__).with_name("robots")


@dataclass(frozen=True)
class UserRobot:
    """A robot and how it is moved.

    Attributes:
        name: of the robot and its file, MJCF or URDF, in ``robots``.
        says: what it is, in a line.
        interface: what its commands are.
        home: set point in the middle of the motions, by actuator [m, rad].
        swing: how far motions go to either side, by actuator [m, rad].
        tool: body that a payload is put on.
        pace: scales the frequencies of the motions.
        loads: payload over the mass of the tool's body, (least, most). Where gravity does not show it, it is larger.
        same: effects that are another one on this robot: what is level and loaded is only heavier to move.
    """

    name: str
    says: str
    interface: str
    home: Mapping[str, float]
    swing: Mapping[str, float]
    tool: str
    pace: float = 1.0
    loads: tuple[float, float] = (0.3, 0.8)
    same: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write the model; the MJCF's path. A URDF is converted by ``tiago_mj.models.convert``."""
        folder.mkdir(parents=True, exist_ok=True)
        (source,) = ROBOTS.glob(f"{self.name}.*")
        copied = Path(shutil.copyfile(source, folder / source.name))
        if copied.suffix == ".urdf":
            convert(copied, copied.with_suffix(".xml"))
        return copied.with_suffix(".xml")


def _six(pattern: str, home: tuple[float, ...], swing: tuple[float, ...]) -> dict[str, dict[str, float]]:
    actuators = [pattern.format(k=k) for k in range(1, 7)]
    return {
        "home": dict(zip(actuators, home, strict=True)),
        "swing": dict(zip(actuators, swing, strict=True)),
    }


_HOME6: Final = (0.0, -0.6, 0.9, 0.0, 0.5, 0.0)
_SWING6: Final = (0.6, 0.4, 0.5, 0.7, 0.6, 0.8)

USER_ROBOTS: Final[Mapping[str, UserRobot]] = {
    one.name: one
    for one in (
        UserRobot("hinge", "a pendulum with a stock position servo", "position", {"hinge": 0.3}, {"hinge": 0.8}, "arm"),
        UserRobot("pendulum", "a pendulum with a motor", "effort", {"swing": 0.2}, {"swing": 0.9}, "rod"),
        UserRobot(
            "two_joint",
            "two hinges in a vertical plane, stock position servos, angles in degrees",
            "position",
            {"shoulder": 0.6, "elbow": 0.5},
            {"shoulder": 0.6, "elbow": 0.8},
            "forearm",
        ),
        UserRobot("lift", "a slide against gravity", "position", {"lift_servo": 0.0}, {"lift_servo": 0.15}, "carriage"),
        UserRobot(
            "scara",
            "four joints, three of them vertical axes",
            "position",
            {"j1": 0.0, "j2": 0.4, "z": -0.06, "j4": 0.0},
            {"j1": 0.5, "j2": 0.6, "z": 0.05, "j4": 0.8},
            "flange",
            loads=(1.0, 3.0),
        ),
        UserRobot(
            "arm6_motor",
            "six joints with motors, under the user's own computed torques",
            "effort",
            **_six("motor{k}", _HOME6, _SWING6),
            tool="hand",
            loads=(0.8, 2.0),
        ),
        UserRobot(
            "arm6_soft",
            "six joints, stock position servos of low gain, no joint damping, degrees",
            "position",
            **_six("joint{k}", _HOME6, _SWING6),
            tool="hand",
            pace=0.7,
            loads=(0.8, 2.0),
        ),
        UserRobot(
            "arm6_stiff",
            "six joints, stock position servos of high gain",
            "position",
            **_six("servo{k}", _HOME6, _SWING6),
            tool="hand",
            loads=(1.0, 3.0),
        ),
        UserRobot(
            "pan_tilt",
            "a camera head under velocity servos, which sinks slowly under gravity",
            "velocity",
            {"pan_drive": 0.0, "tilt_drive": 0.0},
            {"pan_drive": 0.8, "tilt_drive": 0.5},
            "camera",
            loads=(0.5, 1.2),
        ),
        UserRobot(
            "leg",
            "a walker's leg of three joints, servos given by dampratio",
            "position",
            {"hip": 0.0, "thigh": 0.3, "knee": 0.8},
            {"hip": 0.5, "thigh": 0.6, "knee": 0.7},
            "tibia",
            loads=(0.6, 1.5),
        ),
        UserRobot(
            "gripper",
            "two fingers, one driven, coupled by an equality; level, so that a payload shows as inertia alone",
            "position",
            {"right": 0.025},
            {"right": 0.018},
            "left_finger",
            loads=(1.5, 3.0),
            same={"payload": ("armature",)},
        ),
        UserRobot(
            "bench_arm",
            "two hinges, a converted URDF: set points moved by velocities",
            "velocity",
            {"boom_joint": 0.3, "stick_joint": 0.5},
            {"boom_joint": 0.5, "stick_joint": 0.7},
            "stick",
            pace=0.6,
            loads=(0.5, 1.2),
        ),
    )
}
