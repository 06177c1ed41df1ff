"""Surroundings of a converted robot: a light, and a floor below it."""

from __future__ import annotations

from typing import Any, Final

import mujoco
import numpy as np

NAME: Final = "floor"
#: Height of the light over the floor, and the floor's grid [m].
LIGHT_HEIGHT: Final = 4.0
GRID: Final = 0.5


def add(spec: mujoco.MjSpec, pose: Any, *, solid: bool) -> str:
    """Add a light, and a floor at the height of the lowest point of the robot or of what it is fixed to.

    Args:
        spec: the robot.
        pose: (nq,) in which it stands, as ``spec`` compiles now.
        solid: whether things rest on the floor. A robot that is fixed in the world needs none to stand on, and must be
            free to reach below it: for that the floor is only seen.

    Returns:
        What was added, in words.
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    height = min((lowest(model, data, geom) for geom in range(model.ngeom)), default=0.0)
    if not solid:
        height = min(height, 0.0)  # its root stands at the origin, whether that is to be seen or not
    world = spec.worldbody
    taken = {element.name for kind in (spec.geoms, spec.textures, spec.materials) for element in kind}
    name = next(name for name in (NAME, *(f"{NAME}_{i}" for i in range(2, len(taken) + 3))) if name not in taken)
    spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.72, 0.74, 0.77],
        rgb2=[0.64, 0.66, 0.69],
        width=256,
        height=256,
    )
    material = spec.add_material(name=name, texuniform=True, texrepeat=[1 / GRID] * 2)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    floor = world.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1], pos=[0, 0, height], material=name
    )
    if not solid:
        floor.contype = floor.conaffinity = 0
    world.add_light(pos=[1.0, -1.0, height + LIGHT_HEIGHT], dir=[-0.2, 0.2, -1.0], diffuse=[0.6, 0.6, 0.6])
    kind = "that carries it" if solid else "that is only seen"
    return f"a light, and a floor {kind}, at z = {round(height, 3) + 0.0:g} m"


def lowest(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> float:
    """Height of a geom's lowest point in the world [m]."""
    centre, turn = data.geom_xpos[geom][2], data.geom_xmat[geom].reshape(3, 3)[2]
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        return float(centre + (vertices @ turn).min())
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        reach = size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        reach = size[0] + size[1] * abs(turn[2])
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        reach = size[0] * np.hypot(turn[0], turn[1]) + size[1] * abs(turn[2])
    else:  # a box
        reach = np.abs(turn * size).sum()
    return float(centre - reach)
