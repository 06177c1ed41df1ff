"""Servos for the joints: from the additions file, or defaults from the URDF's limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from tiago_mj.models.convert.urdf import Joint

#: Default stiffness: the joint's full effort at this error [m or rad], the order of TIAGo's servos
#: (arm_1: 43 N m at 3000 N m/rad is 0.014 rad; fingers: 16 N at 2000 N/m is 0.008 m).
ERROR_AT_FULL_EFFORT = 0.01

KINDS = ("intvelocity", "position", "velocity", "motor", "none")
SETTINGS = ("type", "kp", "kv", "ctrlrange", "forcerange", "actrange")


@dataclass(frozen=True)
class Servo:
    """A joint's actuator: kind and gains [N/m, N s/m, or per rad]."""

    joint: Joint
    kind: str
    kp: float
    kv: float
    settings: Mapping[str, Any]


def default_gains(joint: Joint, inertia: float) -> tuple[float, float]:
    """Stiffness and damping of a critically damped servo for a joint whose effort limit is known.

    Args:
        joint: with an effort limit [N or N m].
        inertia: diagonal of the mass matrix of this joint at rest [kg or kg m2].
    """
    kp = (joint.effort or 0.0) / ERROR_AT_FULL_EFFORT
    return kp, max(0.0, 2 * math.sqrt(kp * inertia) - joint.damping)


def add(spec: mujoco.MjSpec, servo: Servo) -> None:
    """Add the actuator, named as its joint; ranges are the URDF's limits where the settings give none."""
    joint, settings = servo.joint, servo.settings
    actuator = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    limits: dict[str, tuple[float, float] | None] = {"forcerange": _both(joint.effort)}
    if servo.kind == "intvelocity":
        actuator.set_to_intvelocity(kp=servo.kp, kv=servo.kv)
        limits |= {"ctrlrange": _both(joint.velocity), "actrange": joint.range}
    elif servo.kind == "position":
        actuator.set_to_position(kp=servo.kp, kv=servo.kv)
        limits["ctrlrange"] = joint.range
    elif servo.kind == "velocity":
        actuator.set_to_velocity(kv=servo.kv)
        limits["ctrlrange"] = _both(joint.velocity)
    else:
        actuator.set_to_motor()
        limits["ctrlrange"] = _both(joint.effort)
    for key, default in limits.items():
        value = settings.get(key, default)
        if value is not None:
            setattr(actuator, key, np.asarray(value, dtype=float))


def _both(limit: float | None) -> tuple[float, float] | None:
    return None if limit is None else (-limit, limit)
