"""How much inertia reality can lack: what may be taken from a joint before the mass matrix is none any more."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Share of a joint's own inertia that may go: nearly all where nothing else moves with the joint; where others do, what
#: all joints of TIAGo may lack at once in any pose (with 0.3 the mass matrix is positive definite in 2000 random
#: poses of 2000, with 0.5 in half of them).
ALONE: Final = 0.9
IN_A_CHAIN: Final = 0.3
#: And of what its motor has, where nothing else moves with the joint: on the jaw of an SO-101, whose servo is stated to
#: have 0.028 kg·m², a gap of 22 to 26 is left with this, and of 35 to 78 with 0.9.
MOTOR: Final = 0.99


def removable_inertia(model: mujoco.MjModel, dofs: NDArray[np.intp]) -> Array:
    """What may be taken from each joint, (n,) [kg, kg·m²], of hinges and slides at these addresses.

    In a chain all that its motor has (``dof_armature``) and a share of what its bodies have; of a joint alone not quite
    all of either, so that something is left where its bodies get lighter, too.
    """
    alone = [model.dof_parentid[dof] < 0 and dof not in model.dof_parentid for dof in dofs]
    own, motor = own_inertia(model, dofs), model.dof_armature[dofs]
    return np.where(alone, ALONE * own + MOTOR * motor, IN_A_CHAIN * own + motor)


def own_inertia(model: mujoco.MjModel, dofs: NDArray[np.intp]) -> Array:
    """Mass on a sliding joint, inertia about a hinge's axis, of the bodies that are rigidly on it.

    Args:
        model: compiled.
        dofs: addresses of hinges and slides, (n,).

    Returns:
        (n,) [kg, kg·m²]; less than the diagonal of the mass matrix where other joints follow.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    own = np.zeros(len(dofs))
    for k, dof in enumerate(dofs):
        joint, body = model.dof_jntid[dof], model.dof_bodyid[dof]
        on_it = model.body_weldid == model.body_weldid[body]
        mass, axis = model.body_mass[on_it], data.xaxis[joint]
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            own[k] = mass.sum()
            continue
        arms = np.cross(axis, data.xipos[on_it] - data.xanchor[joint])
        turned = data.ximat[on_it].reshape(-1, 3, 3).transpose(0, 2, 1) @ axis  # the axis in each inertial frame
        own[k] = (mass * np.square(arms).sum(axis=1)).sum() + (model.body_inertia[on_it] * np.square(turned)).sum()
    return own
