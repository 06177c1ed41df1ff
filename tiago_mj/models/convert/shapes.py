"""Shapes in MuJoCo's terms: half sizes, position, quaternion; and poses from URDF's."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tiago_mj.models.convert.urdf import Pose, Shape

Array = NDArray[np.float64]

GEOM_TYPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "mesh": mujoco.mjtGeom.mjGEOM_MESH,
}


@dataclass(frozen=True)
class Primitive:
    """A box (half sizes), cylinder or capsule (radius, half length; along z) or sphere (radius) in a link [m]."""

    kind: str
    size: tuple[float, ...]
    pos: tuple[float, ...] = (0.0, 0.0, 0.0)
    quat: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)

    def volume(self) -> float:
        """Volume [m3]."""
        if self.kind == "box":
            return float(8 * np.prod(self.size))
        ball = 4 / 3 * np.pi * self.size[0] ** 3
        if self.kind == "sphere":
            return float(ball)
        barrel = 2 * np.pi * self.size[0] ** 2 * self.size[1]
        return float(barrel + (ball if self.kind == "capsule" else 0.0))


def rotation(pose: Pose) -> Rotation:
    """Rotation of a URDF pose: roll, pitch, yaw about fixed axes."""
    return Rotation.from_euler("xyz", pose.rpy)


def quaternion(turn: Rotation) -> tuple[float, ...]:
    """Unit quaternion w x y z, w >= 0; rounding noise is cleared so that right angles read as such."""
    x, y, z, w = turn.as_quat(canonical=True)
    return tuple(float(np.round(value, 15)) + 0.0 for value in (w, x, y, z))


def from_urdf(shape: Shape, *, capsule: bool = False) -> Primitive:
    """A primitive URDF shape; ``capsule`` makes a capsule of a cylinder, with the same overall length.

    A cylinder that is shorter than it is wide stays a cylinder.
    """
    place = tuple(shape.pose.xyz), quaternion(rotation(shape.pose))
    if shape.kind == "box":
        return Primitive("box", tuple(side / 2 for side in shape.size), *place)
    if shape.kind == "sphere":
        return Primitive("sphere", shape.size, *place)
    radius, length = shape.size
    if shape.kind == "capsule":  # URDF's capsule: the length is that of the cylindrical part
        return Primitive("capsule", (radius, length / 2), *place)
    if capsule and length > 2 * radius:
        return Primitive("capsule", (radius, float(np.round(length / 2 - radius, 12))), *place)
    return Primitive("cylinder", (radius, length / 2), *place)


def moved(primitive: Primitive, pose: Pose) -> Primitive:
    """A primitive given in the frame ``pose``, transformed to the parent frame."""
    turn = rotation(pose)
    own = Rotation.from_quat([*primitive.quat[1:], primitive.quat[0]])
    place = np.array(pose.xyz) + turn.apply(primitive.pos)
    quat = tuple(float(np.round(value, 9)) for value in quaternion(turn * own))
    return Primitive(primitive.kind, primitive.size, tuple(float(np.round(value, 9)) for value in place), quat)
