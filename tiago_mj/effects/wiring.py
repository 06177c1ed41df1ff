"""Find the parts of a model that the signal chain works on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import mujoco
import numpy as np

from tiago_mj.effects.now import Wiring
from tiago_mj.effects.targets import Targets
from tiago_mj.models import names
from tiago_mj.models.limits import joint_limits

INTERFACES: Final = ("velocity", "position", "effort")


def wire(
    model: mujoco.MjModel,
    *,
    joints: Sequence[str],
    actuators: Sequence[str],
    sensors: Sequence[str] = (),
    interface: str = "velocity",
    velocity_limits: Mapping[str, float] | None = None,
) -> Wiring:
    """Wiring of named joints and actuators of any MJCF.

    Args:
        model: compiled.
        joints: hinges and slides.
        actuators: each on one of the joints.
        sensors: names of the load cells, in the order of their readings.
        interface: what the commands are.
        velocity_limits: by actuator, where they are not the model's.

    Raises:
        ValueError: the model has no such joint or actuator, or an actuator is on none of the joints.
    """
    if interface not in INTERFACES:
        raise ValueError(f"interface {interface!r} is unknown: use one of {', '.join(INTERFACES)}")
    joint_ids = [_find(model, mujoco.mjtObj.mjOBJ_JOINT, name, "joint") for name in joints]
    ids = [_find(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name, "actuator") for name in actuators]
    slides = tuple(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE for j in joint_ids)
    actuated = []
    for name, actuator in zip(actuators, ids, strict=True):
        joint = int(model.actuator_trnid[actuator, 0])
        if joint not in joint_ids:
            raise ValueError(f"actuator {name!r} drives a joint that is not observed: add {model.joint(joint).name!r}")
        actuated.append(joint_ids.index(joint))
    servo = np.array([bool(model.actuator_biasprm[a, 1] < 0) for a in ids], dtype=bool)
    act = np.array([model.actuator_actadr[a] if model.actuator_actnum[a] == 1 else -1 for a in ids], dtype=np.intp)
    velocity = [_velocity_limit(model, a, name, velocity_limits) for a, name in zip(ids, actuators, strict=True)]
    return Wiring(
        targets=Targets(
            command=tuple(actuators),
            joint=tuple(joints),
            sensor=tuple(sensors),
            slides=slides,
            velocity=np.array(velocity),
            effort=np.array([_effort_limit(model, a) for a in ids]),
            actuated=tuple(actuated),
        ),
        actuators=np.array(ids, dtype=np.intp),
        ctrl=np.array([model.actuator_ctrladr[a] for a in ids], dtype=np.intp),
        act=act,
        qpos=np.array([model.jnt_qposadr[j] for j in joint_ids], dtype=np.intp),
        dof=np.array([model.jnt_dofadr[j] for j in joint_ids], dtype=np.intp),
        servo=servo,
        span=_span(model, ids, act, servo),
        interface=interface,
        ideal=False,
        tool=_tool(model, joint_ids),
        grasp_axis=_grasp_axis(model),
        partner=_partners(actuators),
        carrier=_carriers(model, joint_ids),
        **_object(model),
    )


def _span(model: mujoco.MjModel, actuators: Sequence[int], act: np.ndarray, servo: np.ndarray) -> np.ndarray:
    """Limits of the set points, (nactuators, 2) [m, rad]; infinite where there are none."""
    span = np.full((len(actuators), 2), [-np.inf, np.inf])
    for k, actuator in enumerate(actuators):
        if model.actuator_actlimited[actuator] and act[k] >= 0:
            span[k] = model.actuator_actrange[actuator]
        elif act[k] < 0 and servo[k] and model.actuator_ctrllimited[actuator]:
            span[k] = model.actuator_ctrlrange[actuator]
    return span


def _object(model: mujoco.MjModel) -> dict[str, Any]:
    """Where the object between the pads is, and its contacts with them; without one only what contacts there are."""
    pairs = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_PAIR, f"{side}_pad_object") for side in names.SIDES]
    found: dict[str, Any] = {"pairs": tuple(pair for pair in pairs if pair >= 0)}
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.OBJECT_BODY)
    if body >= 0:
        found["object_qpos"] = int(model.joint(names.OBJECT_JOINT).qposadr[0])
        found["object_body"] = body
        found["object_geom"] = model.geom(names.OBJECT_GEOM).id
    return found


def _find(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str, what: str) -> int:
    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        count = model.njnt if what == "joint" else model.nu
        known = ", ".join(filter(None, (mujoco.mj_id2name(model, kind, i) for i in range(count))))
        raise ValueError(f"the model has no {what} {name!r}: it has {known or 'none'}; rename it or give a map file")
    return index


def _velocity_limit(model: mujoco.MjModel, actuator: int, name: str, given: Mapping[str, float] | None) -> float:
    if given and name in given:
        return given[name]
    if model.actuator_actadr[actuator] >= 0 and model.actuator_ctrllimited[actuator]:
        return float(model.actuator_ctrlrange[actuator, 1])  # an integrating servo is commanded by its speed
    limit = joint_limits(model, model.joint(int(model.actuator_trnid[actuator, 0])).name).velocity
    return float(limit) if limit else np.inf


def _effort_limit(model: mujoco.MjModel, actuator: int) -> float:
    if model.actuator_forcelimited[actuator]:
        return float(model.actuator_forcerange[actuator, 1])
    joint = int(model.actuator_trnid[actuator, 0])
    return float(model.jnt_actfrcrange[joint, 1]) if model.jnt_actfrclimited[joint] else np.inf


def _tool(model: mujoco.MjModel, joint_ids: list[int]) -> int:
    """The gripper, or the body of the last joint."""
    gripper = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.GRIPPER_BODY)
    return gripper if gripper >= 0 else int(model.jnt_bodyid[joint_ids[-1]])


def _grasp_axis(model: mujoco.MjModel) -> np.ndarray:
    """From the right to the left finger in the keyframe's pose, horizontal; y where there are no fingers."""
    sites = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, names.PAD_SITE[side]) for side in names.SIDES]
    if min(sites) < 0:
        return np.array([0.0, 1.0, 0.0])
    data = mujoco.MjData(model)
    if model.nkey:
        data.qpos[:] = model.key_qpos[0]
    mujoco.mj_kinematics(model, data)
    across = (data.site_xpos[sites[1]] - data.site_xpos[sites[0]]) * [1, 1, 0]
    return across / np.linalg.norm(across)


def _partners(actuators: Sequence[str]) -> np.ndarray:
    """Fingers are each other's partner; any other joint's is the one before it in the chain, the first one's the
    next."""
    partner = np.array([max(k - 1, 0) for k in range(len(actuators))], dtype=np.intp)
    if len(actuators) > 1:
        partner[0] = 1
    for name in names.FINGERS:
        other = names.FINGERS[1 - names.FINGERS.index(name)]
        if name in actuators and other in actuators:
            partner[list(actuators).index(name)] = list(actuators).index(other)
    return partner


def _carriers(model: mujoco.MjModel, joint_ids: Sequence[int]) -> np.ndarray:
    """Index of the next of the joints towards the base, (njoints,); -1 where there is none, or where one of the two
    slides and the other turns."""
    carriers = np.full(len(joint_ids), -1, dtype=np.intp)
    for k, joint in enumerate(joint_ids):
        dof = int(model.dof_parentid[model.jnt_dofadr[joint]])
        while dof >= 0 and int(model.dof_jntid[dof]) not in joint_ids:
            dof = int(model.dof_parentid[dof])
        if dof >= 0 and model.jnt_type[model.dof_jntid[dof]] == model.jnt_type[joint]:
            carriers[k] = joint_ids.index(int(model.dof_jntid[dof]))
    return carriers
