"""A robot with a floating base as one whose base is held: legs in the air."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

#: Coordinates of a free joint.
COORDINATES = 7


def with_held_base(path: Path, error: type[ValueError] = ValueError) -> mujoco.MjModel:
    """The model of a file with the free joints of its robots fixed where the file has them.

    A free joint of a body that nothing else is attached to by joints is an object's, and stays.

    Args:
        path: of an MJCF file that compiles.
        error: that is raised.

    Raises:
        error: nothing floats; one line.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    model = spec.compile()
    floating = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE and _moves(model, j)]
    if not floating:
        raise error(f"{path.name}: its base does not float: leave out --fix-base (or base: fixed)")
    gone = [model.jnt_qposadr[j] + k for j in floating for k in range(COORDINATES)]
    kept = [k for k in range(model.nq) if k not in gone]
    speeds = [model.jnt_dofadr[j] + k for j in floating for k in range(COORDINATES - 1)]
    moving = [k for k in range(model.nv) if k not in speeds]
    roots = {model.body(int(model.jnt_bodyid[j])).id for j in floating}
    held = [(key.name, key.time, np.array(key.qpos), np.array(key.qvel), np.array(key.ctrl)) for key in spec.keys]
    for key in list(spec.keys):  # of another number of coordinates: MuJoCo compares them as a joint goes
        spec.delete(key)
    for joint in [joint for body in spec.bodies if body.id in roots for joint in body.joints]:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
    for name, time, qpos, qvel, ctrl in held:
        key = spec.add_key(name=name, time=time, ctrl=ctrl)
        if len(qpos) == model.nq:
            key.qpos = qpos[kept]
        if len(qvel) == model.nv:
            key.qvel = qvel[moving]
    for body in spec.bodies:
        body.simple = 0  # its centre of mass may be moved
    return spec.compile()


def _moves(model: mujoco.MjModel, joint: int) -> bool:
    """Whether bodies with joints of their own are attached to the body of a joint."""
    body = int(model.jnt_bodyid[joint])
    own = [b for b in range(model.nbody) if model.body_rootid[b] == model.body_rootid[body] and b != body]
    return any(model.body_jntnum[b] for b in own)
