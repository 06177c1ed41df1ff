"""Command interfaces of the actuators of a model, and the joints that they drive."""

from __future__ import annotations

import mujoco

_ON_A_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_SIMPLE_BIAS = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))


def actuator_interface(model: mujoco.MjModel, actuator: int) -> str:
    """Command interface of one actuator, from its bias: a position servo has a stiffness, a velocity servo only a
    damping."""
    stiffness, damping = -model.actuator_biasprm[actuator, 1], -model.actuator_biasprm[actuator, 2]
    if stiffness > 0:
        return "velocity" if model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_INTEGRATOR else "position"
    return "velocity" if damping > 0 else "effort"


def replayed_interfaces(model: mujoco.MjModel, actuator: int) -> tuple[str, ...]:
    """The interfaces by which one actuator can be commanded in a simulation, its own first.

    A servo with a stiffness takes positions, and velocities as what moves its set point. Empty where the bias does not
    tell: muscles, plugins, MuJoCo's own motors and controllers.
    """
    simple = (
        model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and int(model.actuator_biastype[actuator]) in _SIMPLE_BIAS
        and model.actuator_plugin[actuator] < 0
    )
    if not simple:
        return ()
    own = actuator_interface(model, actuator)
    if model.actuator_biasprm[actuator, 1] < 0:
        return ("velocity", "position") if own == "velocity" else ("position", "velocity")
    return (own,)


def driven_joint(model: mujoco.MjModel, actuator: int) -> str | None:
    """Name of the joint that an actuator drives; None where it drives a tendon, a site or a body."""
    if int(model.actuator_trntype[actuator]) not in _ON_A_JOINT:
        return None
    return str(model.joint(int(model.actuator_trnid[actuator, 0])).name)
