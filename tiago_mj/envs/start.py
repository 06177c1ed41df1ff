"""How an episode begins: the object that is drawn, its place, and what follows from both."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.models import names, scene
from tiago_mj.models.objects import GraspObject

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Start:
    """What is drawn at the start of an episode, the goal apart.

    Attributes:
        item: the object.
        offset: of the object along the grasp axis [m].
        place: where the object's axis meets the table, (2,) [m].
    """

    item: GraspObject
    offset: float
    place: Array


@dataclass(frozen=True)
class GraspFrame:
    """The grasp in a pose of the robot, on the table plane.

    Attributes:
        middle: between the pads, (2,) [m].
        towards_left: unit vector from the right to the left pad, (2,).
        orientation: quaternion of an object whose sides face the pads, (4,).
    """

    middle: Array
    towards_left: Array
    orientation: Array


def grasp_frame(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> GraspFrame:
    """The frame at a configuration ``qpos``, (nq,), which is left in ``data``."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    right, left = (data.site(names.PAD_SITE[side]).xpos for side in names.SIDES)
    across = (left - right)[:2]
    yaw = math.atan2(across[1], across[0])
    return GraspFrame(
        middle=np.array(data.site(names.GRASP_SITE).xpos[:2]),
        towards_left=across / np.linalg.norm(across),
        orientation=np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]),
    )


def put_object(qpos: Array, address: int, item: GraspObject, place: Array, orientation: Array) -> None:
    """Stand an object on the table, in a configuration ``qpos``, (nq,), whose free joint begins at ``address``."""
    qpos[address : address + 2] = place
    qpos[address + 2] = scene.TABLE_TOP + item.half_extents()[2]
    qpos[address + 3 : address + 7] = orientation


def contact_of(item: GraspObject | None) -> tuple[float, float, int] | None:
    """Stiffness [N/m], damping [N·s/m] and contact points of one pad with an object; None without one."""
    return None if item is None else (item.stiffness, item.damping, scene.CONTACT_POINTS[item.shape])
