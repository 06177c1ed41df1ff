"""Twelve small robots, written as plain MJCF (one as URDF) the way a newcomer writes them.

Masses and sizes are those of ordinary hardware; servos are MuJoCo's stock ones. Some angles are in degrees (MuJoCo's
default), some in radians; some joints have no damping at all; time steps are 1 to 5 ms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final


@dataclass(frozen=True)
class UserRobot:
    """A robot and how it is moved.

    Attributes:
        name: of the robot and its files.
        says: what it is, in a line.
        text: MJCF, or URDF.
        interface: what its commands are.
        home: set point in the middle of the motions, by actuator [m, rad].
        swing: how far motions go to either side, by actuator [m, rad].
        tool: body that a payload is put on.
        pace: scales the frequencies of the motions.
        loads: payload over the mass of the tool's body, (least, most). Where gravity does not show it, it is larger.
        urdf: whether ``text`` is URDF.
        same: effects that are another one on this robot: what is level and loaded is only heavier to move.
    """

    name: str
    says: str
    text: str
    interface: str
    home: Mapping[str, float]
    swing: Mapping[str, float]
    tool: str
    pace: float = 1.0
    loads: tuple[float, float] = (0.3, 0.8)
    urdf: bool = False
    same: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write the model; the MJCF's path. A URDF is converted by ``tiago_mj.models.convert``."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.name}.xml"
        if not self.urdf:
            path.write_text(self.text)
            return path
        from tiago_mj.models.convert import convert

        source = folder / f"{self.name}.urdf"
        source.write_text(self.text)
        convert(source, path)
        return path


HINGE = """<mujoco model="hinge">
  <worldbody>
    <light pos="0 0 3"/>
    <body name="arm" pos="0 0 1">
      <joint name="hinge" axis="0 1 0" range="-150 150"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator>
    <position name="hinge" joint="hinge" kp="15" kv="0.8" forcerange="-8 8"/>
  </actuator>
</mujoco>
"""

PENDULUM = """<mujoco model="pendulum">
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <body name="rod" pos="0 0 1">
      <joint name="swing" axis="0 1 0" damping="0.02" armature="0.004"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.01" mass="0.2"/>
      <geom type="cylinder" fromto="0 -0.02 -0.35 0 0.02 -0.35" size="0.05" mass="0.5"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="swing" joint="swing" ctrlrange="-5 5"/>
  </actuator>
</mujoco>
"""

TWO_JOINT = """<mujoco model="two_joint">
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 0.1"/>
    <body name="upper_arm" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" range="-170 170"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1.2"/>
      <body name="forearm" pos="0 0 -0.3">
        <joint name="elbow" axis="0 1 0" range="-150 150"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.025" mass="0.8"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="80" kv="6"/>
    <position name="elbow" joint="elbow" kp="40" kv="2"/>
  </actuator>
</mujoco>
"""

LIFT = """<mujoco model="lift">
  <option timestep="0.004" integrator="implicitfast"/>
  <worldbody>
    <body name="carriage" pos="0 0 0.5">
      <joint name="lift" type="slide" axis="0 0 1" range="-0.3 0.3"/>
      <geom type="box" size="0.1 0.1 0.03" mass="3.5"/>
    </body>
  </worldbody>
  <actuator>
    <position name="lift_servo" joint="lift" kp="4000" kv="250" forcerange="-300 300"/>
  </actuator>
</mujoco>
"""

SCARA = """<mujoco model="scara">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="link1" pos="0 0 0.4">
      <joint name="j1" axis="0 0 1" range="-2.3 2.3" damping="0.5" armature="0.08"/>
      <geom type="box" pos="0.125 0 0" size="0.125 0.05 0.04" mass="3.2" contype="0" conaffinity="0"/>
      <body name="link2" pos="0.25 0 0.06">
        <joint name="j2" axis="0 0 1" range="-2.5 2.5" damping="0.3" armature="0.04"/>
        <geom type="box" pos="0.1 0 0" size="0.1 0.045 0.04" mass="2.4" contype="0" conaffinity="0"/>
        <body name="quill" pos="0.2 0 0">
          <joint name="z" type="slide" axis="0 0 1" range="-0.16 0.04" damping="4"/>
          <geom type="cylinder" size="0.012 0.12" mass="0.7" contype="0" conaffinity="0"/>
          <body name="flange" pos="0 0 -0.12">
            <joint name="j4" axis="0 0 1" range="-3.1 3.1" damping="0.01" armature="0.002"/>
            <geom type="cylinder" pos="0.015 0 -0.02" size="0.035 0.02" mass="0.35" contype="0" conaffinity="0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="j1" joint="j1" kp="600" kv="40" forcerange="-90 90"/>
    <position name="j2" joint="j2" kp="350" kv="18" forcerange="-50 50"/>
    <position name="z" joint="z" kp="3000" kv="100" forcerange="-120 120"/>
    <position name="j4" joint="j4" kp="12" kv="0.4" forcerange="-6 6"/>
  </actuator>
</mujoco>
"""

_ARM6 = """<mujoco model="{name}">
  {compiler}
  <option timestep="{step}" integrator="implicitfast"/>
  <default>
    <geom contype="0" conaffinity="0"/>
    <joint damping="{damping}"/>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="shoulder" pos="0 0 0.15">
      <joint name="joint1" axis="0 0 1" range="{wide}" armature="0.12"/>
      <geom type="cylinder" size="0.06 0.07" mass="3.4"/>
      <body name="upper_arm" pos="0 0 0.07">
        <joint name="joint2" axis="0 1 0" range="{wide}" armature="0.12"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.05" mass="4.2"/>
        <body name="forearm" pos="0.3 0 0">
          <joint name="joint3" axis="0 1 0" range="{wide}" armature="0.08"/>
          <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.04" mass="2.3"/>
          <body name="wrist1" pos="0.25 0 0">
            <joint name="joint4" axis="1 0 0" range="{wide}" armature="0.03"/>
            <geom type="cylinder" fromto="0 0 0 0.08 0 0" size="0.035" mass="0.9"/>
            <body name="wrist2" pos="0.08 0 0">
              <joint name="joint5" axis="0 1 0" range="{wide}" armature="0.03"/>
              <geom type="cylinder" fromto="0 0 0 0.08 0 0" size="0.035" mass="0.9"/>
              <body name="hand" pos="0.08 0 0">
                <joint name="joint6" axis="1 0 0" range="{wide}" armature="0.02"/>
                <geom type="box" pos="0.04 0.01 0" size="0.04 0.04 0.02" mass="0.6"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
{actuators}
  </actuator>
</mujoco>
"""
_ARM6_LIMITS: Final = (150, 150, 100, 28, 28, 28)
_RADIAN: Final = {"compiler": '<compiler angle="radian"/>', "wide": "-3 3"}
_DEGREE: Final = {"compiler": "", "wide": "-170 170"}


def _arm6(name: str, step: float, damping: float, angles: Mapping[str, str], actuator: str, numbers: list) -> str:
    lines = []
    for k, (limit, gains) in enumerate(zip(_ARM6_LIMITS, numbers, strict=True), start=1):
        lines.append("    " + actuator.format(k=k, limit=limit, **dict(zip(("kp", "kv"), gains, strict=False))))
    return _ARM6.format(name=name, step=step, damping=damping, actuators="\n".join(lines), **angles)


_POSITION: Final = '<position name="joint{k}" joint="joint{k}" kp="{kp}" kv="{kv}" forcerange="-{limit} {limit}"/>'
_STOCK: Final = '<position name="servo{k}" joint="joint{k}" kp="{kp}" kv="{kv}" forcerange="-{limit} {limit}"/>'
_MOTOR: Final = '<motor name="motor{k}" joint="joint{k}" ctrlrange="-{limit} {limit}"/>'

ARM6_MOTOR = _arm6("arm6_motor", 0.002, 0.5, _RADIAN, _MOTOR, [()] * 6)
ARM6_SOFT = _arm6(
    "arm6_soft", 0.002, 0.0, _DEGREE, _POSITION, [(300, 40), (400, 50), (250, 25), (60, 4), (60, 4), (30, 2)]
)
ARM6_STIFF = _arm6(
    "arm6_stiff", 0.001, 1.0, _RADIAN, _STOCK, [(4000, 250), (5000, 320), (3000, 160), (800, 30), (800, 30), (500, 16)]
)

PAN_TILT = """<mujoco model="pan_tilt">
  <compiler angle="degree"/>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <body name="pan_link" pos="0 0 0.3">
      <joint name="pan" axis="0 0 1" range="-170 170" damping="0.05" armature="0.01"/>
      <geom type="box" size="0.05 0.08 0.04" mass="0.9"/>
      <body name="camera" pos="0 0 0.08">
        <joint name="tilt" axis="0 1 0" range="-90 90" damping="0.05" armature="0.01"/>
        <geom type="box" pos="0.02 0 0" size="0.08 0.05 0.03" mass="0.7" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <velocity name="pan_drive" joint="pan" kv="1.5" forcerange="-6 6"/>
    <velocity name="tilt_drive" joint="tilt" kv="3" forcerange="-6 6"/>
  </actuator>
</mujoco>
"""

LEG = """<mujoco model="leg">
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <worldbody>
    <body name="coxa" pos="0 0 0.4">
      <joint name="hip" axis="0 0 1" range="-1 1" armature="0.002"/>
      <geom type="capsule" fromto="0 0 0 0.06 0 0" size="0.02" mass="0.12"/>
      <body name="femur" pos="0.06 0 0">
        <joint name="thigh" axis="0 1 0" range="-1.6 1.6" armature="0.002"/>
        <geom type="capsule" fromto="0 0 0 0.12 0 0" size="0.015" mass="0.15"/>
        <body name="tibia" pos="0.12 0 0">
          <joint name="knee" axis="0 1 0" range="-0.5 2.4" armature="0.002"/>
          <geom type="capsule" fromto="0 0 0 0.14 0 0" size="0.01" mass="0.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="hip" joint="hip" kp="6" dampratio="0.8"/>
    <position name="thigh" joint="thigh" kp="8" dampratio="0.8"/>
    <position name="knee" joint="knee" kp="5" dampratio="1"/>
  </actuator>
</mujoco>
"""

GRIPPER = """<mujoco model="gripper">
  <option timestep="0.002"/>
  <worldbody>
    <body name="palm" pos="0 0 0.3">
      <geom type="box" size="0.03 0.08 0.02" mass="0.5"/>
      <body name="right_finger" pos="0 0 -0.02">
        <joint name="right" type="slide" axis="0 1 0" range="0 0.05" damping="8"/>
        <geom type="box" pos="0 0.01 -0.05" size="0.01 0.006 0.05" mass="0.15" contype="0" conaffinity="0"/>
      </body>
      <body name="left_finger" pos="0 0 -0.02">
        <joint name="left" type="slide" axis="0 -1 0" range="0 0.05" damping="8"/>
        <geom type="box" pos="0 -0.01 -0.05" size="0.01 0.006 0.05" mass="0.15" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="left" joint2="right" polycoef="0 1 0 0 0"/>
  </equality>
  <actuator>
    <position name="right" joint="right" kp="400" kv="8" ctrlrange="0 0.05" forcerange="-40 40"/>
  </actuator>
</mujoco>
"""

BENCH_ARM = """<?xml version="1.0"?>
<robot name="bench_arm">
  <link name="base">
    <inertial><mass value="2.0"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="boom">
    <inertial><origin xyz="0 0 0.18"/><mass value="1.4"/>
      <inertia ixx="0.016" iyy="0.016" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.18"/><geometry><cylinder radius="0.03" length="0.36"/></geometry></visual>
  </link>
  <link name="stick">
    <inertial><origin xyz="0 0 0.14"/><mass value="0.9"/>
      <inertia ixx="0.007" iyy="0.007" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.14"/><geometry><cylinder radius="0.025" length="0.28"/></geometry></visual>
  </link>
  <joint name="boom_joint" type="revolute">
    <parent link="base"/><child link="boom"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>
    <limit lower="-2.2" upper="2.2" effort="30" velocity="3.0"/><dynamics damping="0.4"/>
  </joint>
  <joint name="stick_joint" type="revolute">
    <parent link="boom"/><child link="stick"/><origin xyz="0 0 0.36"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="15" velocity="4.0"/><dynamics damping="0.2"/>
  </joint>
</robot>
"""


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
        UserRobot(
            "hinge", "a pendulum with a stock position servo", HINGE, "position", {"hinge": 0.3}, {"hinge": 0.8}, "arm"
        ),
        UserRobot("pendulum", "a pendulum with a motor", PENDULUM, "effort", {"swing": 0.2}, {"swing": 0.9}, "rod"),
        UserRobot(
            "two_joint",
            "two hinges in a vertical plane, stock position servos, angles in degrees",
            TWO_JOINT,
            "position",
            {"shoulder": 0.6, "elbow": 0.5},
            {"shoulder": 0.6, "elbow": 0.8},
            "forearm",
        ),
        UserRobot(
            "lift", "a slide against gravity", LIFT, "position", {"lift_servo": 0.0}, {"lift_servo": 0.15}, "carriage"
        ),
        UserRobot(
            "scara",
            "four joints, three of them vertical axes",
            SCARA,
            "position",
            {"j1": 0.0, "j2": 0.4, "z": -0.06, "j4": 0.0},
            {"j1": 0.5, "j2": 0.6, "z": 0.05, "j4": 0.8},
            "flange",
            loads=(1.0, 3.0),
        ),
        UserRobot(
            "arm6_motor",
            "six joints with motors, under the user's own computed torques",
            ARM6_MOTOR,
            "effort",
            **_six("motor{k}", _HOME6, _SWING6),
            tool="hand",
            loads=(0.8, 2.0),
        ),
        UserRobot(
            "arm6_soft",
            "six joints, stock position servos of low gain, no joint damping, degrees",
            ARM6_SOFT,
            "position",
            **_six("joint{k}", _HOME6, _SWING6),
            tool="hand",
            pace=0.7,
            loads=(0.8, 2.0),
        ),
        UserRobot(
            "arm6_stiff",
            "six joints, stock position servos of high gain",
            ARM6_STIFF,
            "position",
            **_six("servo{k}", _HOME6, _SWING6),
            tool="hand",
            loads=(1.0, 3.0),
        ),
        UserRobot(
            "pan_tilt",
            "a camera head under velocity servos, which sinks slowly under gravity",
            PAN_TILT,
            "velocity",
            {"pan_drive": 0.0, "tilt_drive": 0.0},
            {"pan_drive": 0.8, "tilt_drive": 0.5},
            "camera",
            loads=(0.5, 1.2),
        ),
        UserRobot(
            "leg",
            "a walker's leg of three joints, servos given by dampratio",
            LEG,
            "position",
            {"hip": 0.0, "thigh": 0.3, "knee": 0.8},
            {"hip": 0.5, "thigh": 0.6, "knee": 0.7},
            "tibia",
            loads=(0.6, 1.5),
        ),
        UserRobot(
            "gripper",
            "two fingers, one driven, coupled by an equality; level, so that a payload shows as inertia alone",
            GRIPPER,
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
            BENCH_ARM,
            "velocity",
            {"boom_joint": 0.3, "stick_joint": 0.5},
            {"boom_joint": 0.5, "stick_joint": 0.7},
            "stick",
            pace=0.6,
            loads=(0.5, 1.2),
            urdf=True,
        ),
    )
}
