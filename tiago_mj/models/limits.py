"""Joint limits of a converted robot, as its URDF gave them.

MJCF has places for the range and the effort (``range``, ``actuatorfrcrange``). The velocity limit and the soft
limits, which it has no place for, are kept in the joint's ``user`` field: velocity, soft lower, soft upper; 0 means
"none given".
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True)
class JointLimits:
    """Limits of one joint [m, m/s, N, or rad, rad/s, N m]; None where the URDF gives none."""

    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None
    soft_lower: float | None
    soft_upper: float | None


def user_field(velocity: float | None, soft: tuple[float, float] | None) -> list[float]:
    """The joint's ``user`` numbers, as :func:`joint_limits` reads them."""
    return [velocity or 0.0, *(soft or (0.0, 0.0))]


def joint_limits(model: mujoco.MjModel, name: str) -> JointLimits:
    """Limits of the joint ``name``.

    Raises:
        ValueError: the model has no such joint.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    if index < 0:
        raise ValueError(f"no joint {name!r}; there are {', '.join(model.joint(i).name for i in range(model.njnt))}")
    user = np.zeros(3)
    user[: min(3, model.nuser_jnt)] = model.jnt_user[index][:3]
    lower, upper = model.jnt_range[index] if model.jnt_limited[index] else (None, None)
    soft = (None, None) if user[1] == user[2] else (float(user[1]), float(user[2]))
    return JointLimits(
        lower=None if lower is None else float(lower),
        upper=None if upper is None else float(upper),
        velocity=float(user[0]) or None,
        effort=float(model.jnt_actfrcrange[index][1]) if model.jnt_actfrclimited[index] else None,
        soft_lower=soft[0],
        soft_upper=soft[1],
    )


def servo_ranges(model: mujoco.MjModel) -> dict[str, tuple[float, float]]:
    """Lowest and highest set point that a position servo takes [m, rad], by joint; of servos in the joint's own
    direction and unit that state one (``ctrlrange``)."""
    found = {}
    for k in range(model.nu):
        joint, stiffness = int(model.actuator_trnid[k, 0]), -float(model.actuator_biasprm[k, 1])
        low, high = (float(end) for end in model.actuator_ctrlrange[k])
        of_joint = int(model.actuator_trntype[k]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        integrates = int(model.actuator_dyntype[k]) == int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
        plain = stiffness > 0 and np.isclose(model.actuator_gainprm[k, 0], stiffness) and model.actuator_gear[k, 0] == 1
        if of_joint and plain and not integrates and model.actuator_ctrllimited[k] and low < high:
            found[model.joint(joint).name] = (low, high)
    return found
