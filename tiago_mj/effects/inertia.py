"""Inertia of joints: what is felt there, and what reality can lack before the mass matrix is none any more."""

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.now import Now

Array = NDArray[np.float64]

#: Share of a joint's own inertia that may go: nearly all where nothing else moves with the joint; where others do, what
#: all joints of TIAGo may lack at once in any pose (with 0.3 the mass matrix is positive definite in 2000 random
#: poses of 2000, with 0.5 in half of them). Other chains may lack less: two links that hang stretched, of 0.55 and 0.35
#: kg, 26 % (:func:`common_share`).
ALONE: Final = 0.9
IN_A_CHAIN: Final = 0.3
#: Random poses in which a chain's mass matrix is looked at, beside its reference pose and its first keyframe's. The
#: least share of TIAGo's joints is 0.33 in 66 poses and in 2000, of two links 0.265 in either.
POSES: Final = 64
#: Of what leaves the mass matrix singular so much is taken at most.
SHORT_OF_SINGULAR: Final = 0.95
#: And of what its motor has, where nothing else moves with the joint: on the jaw of an SO-101, whose servo is stated to
#: have 0.028 kg·m², a gap of 22 to 26 is left with this, and of 35 to 78 with 0.9.
MOTOR: Final = 0.99


def inertia_at(now: Now) -> Array:
    """Effective inertia of the joints where each simulation stands, of its own masses and inertias, (nsim, njoints)
    [kg, kg·m²]."""
    host, positions = now.host, now.host.state("qpos")
    if now.rebuild:
        return np.stack([_inertia(*one, now.wiring.dof) for one in zip(host.models(), positions, strict=True)])
    poses, which = np.unique(positions, axis=0, return_inverse=True)
    return np.stack([_inertia(host.model, pose, now.wiring.dof) for pose in poses])[which]


def _inertia(model: mujoco.MjModel, pose: Array, dofs: NDArray[np.intp]) -> Array:
    """Inverse of the diagonal of the inverse mass matrix, (n,) [kg, kg·m²], of the joints at these addresses."""
    data, inverse = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    effective: Array = 1 / np.diag(inverse)[dofs]
    return effective


def removable_inertia(model: mujoco.MjModel, dofs: NDArray[np.intp]) -> Array:
    """What may be taken from each joint, (n,) [kg, kg·m²], of hinges and slides at these addresses.

    In a chain all that its motor has (``dof_armature``) and a share of what its bodies have, which leaves the mass
    matrix positive definite where all joints lack it; of a joint alone not quite all of either, so that something is
    left where its bodies get lighter, too.
    """
    alone = np.array([model.dof_parentid[dof] < 0 and dof not in model.dof_parentid for dof in dofs], dtype=bool)
    own, motor = own_inertia(model, dofs), model.dof_armature[dofs]
    if alone.all():
        return ALONE * own + MOTOR * motor
    chain = ~alone
    share = min(IN_A_CHAIN, SHORT_OF_SINGULAR * common_share(model, dofs[chain], own[chain]))
    return np.where(alone, ALONE * own + MOTOR * motor, share * own + motor)


def common_share(model: mujoco.MjModel, dofs: NDArray[np.intp], own: Array) -> float:
    """Share of their own inertia that joints may lack at once, without their motors', before the mass matrix is
    singular in some pose: the least of :data:`POSES` random ones within the joints' ranges, the same at every call.

    Args:
        model: compiled.
        dofs: addresses of hinges and slides, (n,).
        own: their :func:`own_inertia`, (n,) [kg, kg·m²].

    Returns:
        From 0 (nothing but the motors keeps it from being singular) to 1.
    """
    data, matrix = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    root, least = np.sqrt(own), 1.0
    motors = np.zeros(model.nv)
    motors[dofs] = model.dof_armature[dofs]
    for pose in _poses(model):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_fullM(model, data, matrix)
        try:
            # matrix - motors - share · own is singular at the least share that is an eigenvalue of the pair.
            lower = np.linalg.cholesky(matrix - np.diag(motors))
        except np.linalg.LinAlgError:
            return 0.0
        scaled = np.linalg.solve(lower, np.eye(model.nv)[:, dofs] * root)
        least = min(least, 1.0 / max(float(np.linalg.norm(scaled, 2)) ** 2, 1.0))
    return least


def _poses(model: mujoco.MjModel) -> Array:
    """Reference pose, first keyframe and random poses of hinges and slides, (n, nq)."""
    given = [model.qpos0, *model.key_qpos[:1]]
    generator = np.random.default_rng(0)
    poses = np.repeat(model.qpos0[None], POSES, axis=0)
    for joint in range(model.njnt):
        kind = model.jnt_type[joint]
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            continue
        turn = np.pi if kind == mujoco.mjtJoint.mjJNT_HINGE else 0.0
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-turn, turn)
        poses[:, model.jnt_qposadr[joint]] = generator.uniform(low, high, POSES)
    return np.vstack([*given, poses])


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
