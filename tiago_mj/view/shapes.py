"""Visible geometry of a compiled model: triangles of every body, by colour.

MuJoCo's own viewer shows geoms of the groups 0 to 2; so does this. A texture is shown as its mean colour.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Geoms of these groups are seen.
GROUPS: Final = (0, 1, 2)
#: Faces that meet at less than this are one smooth surface [rad].
SMOOTH: Final = 0.6
#: A mesh of more triangles than this is drawn flat, as smoothing it would take seconds.
MOST_SMOOTHED: Final = 20_000
#: Segments of a round shape's circumference.
ROUND: Final = 32


@dataclass(frozen=True)
class Part:
    """Triangles of one body in one colour.

    Attributes:
        body: its index.
        vertices: in the body's frame, (V, 3) [m].
        faces: indices of vertices, (F, 3).
        colour: red, green, blue from 0 to 1.
        opacity: from 0 to 1.
    """

    body: int
    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    colour: tuple[float, float, float]
    opacity: float


@functools.lru_cache(maxsize=2)  # a stage asks again and again, and nobody changes a model that is shown
def parts(model: mujoco.MjModel) -> tuple[Part, ...]:
    """Visible parts of a model in the order of its bodies, without planes, for which a grid stands."""
    by: dict[tuple[int, tuple[float, ...]], list[trimesh.Trimesh]] = {}
    for geom in range(model.ngeom):
        rgba = colour_of(model, geom)
        if int(model.geom_group[geom]) not in GROUPS or rgba[3] == 0:
            continue
        mesh = mesh_of(model, geom)
        if mesh is None:
            continue
        mesh = _smoothed(mesh)
        mesh.apply_transform(_frame(model.geom_pos[geom], model.geom_quat[geom]))
        by.setdefault((int(model.geom_bodyid[geom]), tuple(round(float(v), 3) for v in rgba)), []).append(mesh)
    found = []
    for (body, rgba_), meshes in sorted(by.items(), key=lambda item: item[0][0]):
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
        found.append(
            Part(
                body=body,
                vertices=np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32),
                faces=np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=True)]).astype(np.uint32),
                colour=(rgba_[0], rgba_[1], rgba_[2]),
                opacity=rgba_[3],
            )
        )
    return tuple(found)


def moving(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Bodies that are not fixed to the world, (nbody,)."""
    fixed: NDArray[np.bool_] = (model.body_weldid == 0) & (model.body_mocapid < 0)
    return ~fixed


def extent(model: mujoco.MjModel, positions: Array, bodies: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Corners of the box around bodies' geoms over a motion, (3,), (3,) [m].

    Args:
        model: compiled.
        positions: of the bodies in the world, (T, nbody, 3) [m].
        bodies: which count, (nbody,).
    """
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for part in parts(model):
        if not bodies[part.body]:
            continue
        reach = float(np.abs(part.vertices).max())
        low = np.minimum(low, positions[:, part.body].min(axis=0) - reach)
        high = np.maximum(high, positions[:, part.body].max(axis=0) + reach)
    if not np.isfinite(low).all():
        return np.full(3, -0.5), np.full(3, 0.5)
    return low, high


def colour_of(model: mujoco.MjModel, geom: int) -> Array:
    """Red, green, blue, opacity of a geom, (4,) from 0 to 1; of its material where it has one."""
    material = int(model.geom_matid[geom])
    rgba = np.array(model.geom_rgba[geom], dtype=float)
    if material < 0:
        return rgba
    if np.array_equal(rgba, np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)):  # MuJoCo's default: not given
        rgba = np.array(model.mat_rgba[material], dtype=float)
    textures = model.mat_texid[material]
    for role in (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA):
        if (texture := int(textures[int(role)])) >= 0:
            channels = int(model.tex_nchannel[texture])
            size = int(model.tex_height[texture]) * int(model.tex_width[texture]) * channels
            start = int(model.tex_adr[texture])
            mean = model.tex_data[start : start + size].reshape(-1, channels).mean(axis=0) / 255
            rgba[:3] *= mean[:3] if channels >= 3 else mean[0]
    return rgba


def mesh_of(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """Triangles of a geom in its own frame [m]; None for an invisible one."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), np.array(model.geom_size[geom], dtype=float)
    if kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        return _asset(model, int(model.geom_dataid[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))
    make = _PRIMITIVES.get(kind)
    return None if make is None else make(size)


def _ellipsoid(size: Array) -> trimesh.Trimesh:
    sphere = trimesh.creation.icosphere(subdivisions=3)
    sphere.apply_scale(size)
    return sphere


_PRIMITIVES: Final[Mapping[Any, Callable[[Array], Any]]] = {
    mujoco.mjtGeom.mjGEOM_SPHERE: lambda size: trimesh.creation.icosphere(subdivisions=3, radius=size[0]),
    mujoco.mjtGeom.mjGEOM_CAPSULE: lambda size: trimesh.creation.capsule(
        height=2 * size[1], radius=size[0], count=[ROUND, ROUND // 2]
    ),
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: _ellipsoid,
    mujoco.mjtGeom.mjGEOM_CYLINDER: lambda size: trimesh.creation.cylinder(
        radius=size[0], height=2 * size[1], sections=ROUND
    ),
    mujoco.mjtGeom.mjGEOM_BOX: lambda size: trimesh.creation.box(extents=2 * size),
}


def _asset(model: mujoco.MjModel, index: int) -> trimesh.Trimesh:
    vertices, faces = int(model.mesh_vertadr[index]), int(model.mesh_faceadr[index])
    return trimesh.Trimesh(
        vertices=model.mesh_vert[vertices : vertices + int(model.mesh_vertnum[index])],
        faces=model.mesh_face[faces : faces + int(model.mesh_facenum[index])],
        process=False,
    )


def _height_field(model: mujoco.MjModel, index: int) -> trimesh.Trimesh:
    rows, columns = int(model.hfield_nrow[index]), int(model.hfield_ncol[index])
    start, size = int(model.hfield_adr[index]), model.hfield_size[index]
    x, y = np.meshgrid(np.linspace(-size[0], size[0], columns), np.linspace(-size[1], size[1], rows))
    heights = size[2] * model.hfield_data[start : start + rows * columns].reshape(rows, columns)
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    faces = np.concatenate([np.stack([a, b, d], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return trimesh.Trimesh(vertices=np.stack([x, y, heights], -1).reshape(-1, 3), faces=faces, process=False)


def _smoothed(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """With vertices of its own for every smooth surface, so that edges stay sharp."""
    if len(mesh.faces) > MOST_SMOOTHED:
        apart = np.arange(3 * len(mesh.faces)).reshape(-1, 3)
        return trimesh.Trimesh(mesh.triangles.reshape(-1, 3), apart, process=False)
    return trimesh.graph.smooth_shade(mesh, angle=SMOOTH)


def _frame(position: Array, quaternion: Array) -> Array:
    frame = np.eye(4)
    frame[:3, :3] = trimesh.transformations.quaternion_matrix(quaternion)[:3, :3]
    frame[:3, 3] = position
    return frame
