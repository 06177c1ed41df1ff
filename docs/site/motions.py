"""Short motions to show effects on: the fingers in the air or at an object, a hinge that lifts, a wrist that rolls, an
elbow that is held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.envs.flat import core_of
from tiago_mj.gap import apply

Array = NDArray[np.float64]

#: Rate of the commands [Hz] and length [s] of every motion.
RATE, SECONDS = 240, 2.5
ENVIRONMENT: Final = "tiago_mj/GripperTactile-v0"
SEED: Final = 3
#: The object of each motion of the fingers: too narrow to be touched, in the middle, or nearer to the left finger,
#: which then pushes it over the table.
OBJECTS: Final = MappingProxyType(
    {
        "air": {"object_width": 0.028, "object_offset": 0.0},
        "grasp": {"object_offset": 0.0},
        "push": {"object_offset": 0.008},
    }
)
#: A link of 0.3 m and 0.5 kg on a horizontal hinge, with a position servo.
HINGE: Final = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="link">
      <joint name="hinge" axis="0 -1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
      <body name="tool" pos="0.3 0 0"><geom type="sphere" size="0.03" mass="0.05"/></body>
    </body>
  </worldbody>
  <actuator>
    <position name="hinge" joint="hinge" kp="60" kv="4" ctrlrange="-1.5 1.5" forcerange="-20 20"/>
  </actuator>
</mujoco>
"""
#: A forearm on such a hinge that carries a hand, which rolls about the forearm's length.
WRIST: Final = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="forearm">
      <joint name="pitch" axis="0 -1 0" damping="0.1" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.5"/>
      <body name="hand" pos="0.2 0 0">
        <joint name="roll" axis="1 0 0" damping="0.1" armature="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.02" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="pitch" joint="pitch" kp="60" kv="4" ctrlrange="-1.5 1.5" forcerange="-20 20"/>
    <position name="roll" joint="roll" kp="20" kv="1" ctrlrange="-1.5 1.5" forcerange="-20 20"/>
  </actuator>
</mujoco>
"""
#: Two links on horizontal hinges: an upper arm that is lifted, and a forearm that is held.
ELBOW: Final = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper_arm" pos="0 0 0.4">
      <joint name="shoulder" axis="0 -1 0" damping="0.5" armature="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2"/>
      <body name="forearm" pos="0.3 0 0">
        <joint name="elbow" axis="0 -1 0" damping="0.2" armature="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.025" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="400" kv="20" ctrlrange="-1.5 1.5" forcerange="-80 80"/>
    <position name="elbow" joint="elbow" kp="80" kv="4" ctrlrange="-1.5 1.5" forcerange="-40 40"/>
  </actuator>
</mujoco>
"""
#: Models of the motions that are not the fingers'; their last joint is measured.
ARMS: Final = MappingProxyType({"hinge": HINGE, "wrist": WRIST, "elbow": ELBOW})


@dataclass(frozen=True)
class Recorded:
    """What was measured in a motion.

    Attributes:
        time: (T,) [s].
        channels: (T,) each, by name: ``position`` [mm, mrad], ``velocity`` [mm/s, mrad/s] and, of the fingers,
            ``force`` [sensor units]; of the left finger, of a hinge and of an arm's last joint.
    """

    time: Array
    channels: Mapping[str, Array]


def _set_point(corners: list[tuple[float, float]], wave: tuple[float, float, float] | None = None) -> Array:
    """Straight lines between (time, value), and a sine of (start [s], amplitude, frequency [Hz]) on them."""
    time = np.arange(round(RATE * SECONDS) + 1) / RATE
    path = np.interp(time, *zip(*corners, strict=True))
    if wave is not None:
        start, size, frequency = wave
        path += np.where((time >= start) & (time < start + 2 / frequency), size, 0) * np.sin(
            2 * np.pi * frequency * (time - start)
        )
    return path


@cache
def commands() -> Mapping[str, Array]:
    """Set points of each motion: of a finger [m], of the hinge and of the joints of wrist and elbow [rad]."""
    air = [(0, 0.045), (0.1, 0.045), (0.6, 0.033), (0.9, 0.033), (1.4, 0.042), (2.5, 0.042)]
    grasp = [(0, 0.045), (0.6, 0.021), (0.9, 0.0155), (2.1, 0.0155), (2.4, 0.024)]
    hinge = [(0, 0.0), (0.2, 0.0), (0.8, 0.6), (1.1, 0.6), (1.7, -0.2), (2.0, 0.2), (2.5, 0.2)]
    roll = [(0, 0.0), (0.4, 0.0), (1.0, 1.0), (1.4, 1.0), (2.2, -0.4), (2.5, -0.4)]
    return {
        "air": _set_point(air, (1.5, 2e-3, 2.5)),
        "grasp": _set_point(grasp, (1.3, 8e-4, 2.5)),
        "hinge": _set_point(hinge),
        "wrist": np.column_stack([_set_point(hinge), _set_point(roll)]),
        "elbow": np.column_stack([_set_point(hinge), _set_point([(0, 0.0), (2.5, 0.0)])]),
    }


def play(motion: str, effects: Any) -> Recorded:
    """Play a motion with effects, and measure.

    Args:
        motion: ``air``, ``grasp``, ``push``, ``hinge``, ``wrist`` or ``elbow``.
        effects: in any form that environments take; None: the nominal simulator.
    """
    return _arm(motion, effects) if motion in ARMS else _fingers(motion, effects)


def _fingers(motion: str, effects: Any) -> Recorded:
    steps = round(RATE * SECONDS)
    env = gymnasium.make(
        ENVIRONMENT,
        control="position",
        finger_speed=0.5,
        effects=effects,
        max_episode_steps=steps,
        visual=False,
        **OBJECTS[motion],
    )
    core = core_of(env)
    env.reset(seed=SEED)
    rows = [_seen(core)]
    for goal in commands()["air" if motion == "air" else "grasp"][1:]:
        env.step(np.full(2, 2 * goal / 0.045 - 1, dtype=np.float32))
        rows.append(_seen(core))
    env.close()
    position, velocity, force = np.array(rows).T
    channels = {"position": 1e3 * position, "velocity": 1e3 * velocity, "force": force}
    return Recorded(np.arange(steps + 1) / RATE, channels)


def _seen(core: Any) -> tuple[float, float, float]:
    return float(core.state.position[1]), float(core.state.velocity[1]), float(core.state.force_raw[1])


def _arm(motion: str, effects: Any) -> Recorded:
    robot = apply(mujoco.MjModel.from_xml_string(ARMS[motion]), effects or [], rate_hz=RATE)
    rows = []
    for goal in commands()[motion]:
        rows.append((robot.position[-1], robot.velocity[-1]))
        robot.step(np.atleast_1d(goal))
    position, velocity = 1e3 * np.array(rows).T
    return Recorded(np.arange(len(rows)) / RATE, {"position": position, "velocity": velocity})
