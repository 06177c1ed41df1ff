"""What one control step reads out of the simulation, as arrays over leading batch axes.

The same reader serves one simulation (``qpos`` is (nq,)) and a ``mujoco.Batch`` of them (``qpos`` is (nsim, nq)).
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.host import span
from tiago_mj.models import names

Array = NDArray[np.float64]


class State(NamedTuple):
    """One reading of the robot and its object; ``...`` are batch axes, none for a scalar environment.

    Attributes:
        position: of the robot's joints (..., N) [m, rad], in the order of the environment's ``joints``.
        velocity: of the same (..., N) [m/s, rad/s].
        force_contact: net force of each pad and the object along the load cell's axis (..., 2) [N]; the truth.
        force_raw: load-cell readings (..., 2) [sensor units].
        force_binary: 1.0 where the reading is above its threshold (..., 2).
        grasp_position: middle between the pads, in the world (..., 3) [m].
        object_pose: position [m] and quaternion (..., 7); empty (..., 0) in a scene without an object.
        object_velocity: linear, in the world [m/s], and angular, in the object's frame [rad/s] (..., 6); or empty.
    """

    position: Array
    velocity: Array
    force_contact: Array
    force_raw: Array
    force_binary: Array
    grasp_position: Array
    object_pose: Array
    object_velocity: Array


class StateReader:
    """Finds by name where the model keeps what a :class:`State` holds, once."""

    def __init__(self, model: mujoco.MjModel, joints: tuple[str, ...]) -> None:
        self._qpos = span([int(model.joint(name).qposadr[0]) for name in joints])
        self._qvel = span([int(model.joint(name).dofadr[0]) for name in joints])
        grasp = int(model.sensor(names.GRASP_SENSOR).adr[0])
        self._grasp = slice(grasp, grasp + 3)
        self._object_qpos = self._object_qvel = slice(0, 0)
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, names.OBJECT_JOINT) >= 0:
            free = model.joint(names.OBJECT_JOINT)
            self._object_qpos = slice(int(free.qposadr[0]), int(free.qposadr[0]) + 7)
            self._object_qvel = slice(int(free.dofadr[0]), int(free.dofadr[0]) + 6)

    def read(
        self, qpos: Array, qvel: Array, sensordata: Array, force_contact: Array, force_raw: Array, force_binary: Array
    ) -> State:
        """A state that shares no memory with the simulation."""
        qpos, qvel = qpos.copy(), qvel.copy()
        return State(
            qpos[..., self._qpos],
            qvel[..., self._qvel],
            force_contact,
            force_raw,
            force_binary,
            sensordata[..., self._grasp].copy(),
            qpos[..., self._object_qpos],
            qvel[..., self._object_qvel],
        )
