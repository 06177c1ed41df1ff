"""The box, cylinder, capsule or sphere that fits a mesh best, by least squares over its convex hull's surface.

Collision with a primitive is several times faster than with a mesh, and MuJoCo would take the mesh's convex hull
anyway.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation

from tiago_mj.models.convert.shapes import Primitive, quaternion

Array = NDArray[np.float64]

KINDS = ("sphere", "capsule", "box", "cylinder")
SAMPLES = 400
#: Flat meshes have no hull: they get boxes at least this thick.
SMALLEST_THICKNESS = 1e-3  # m
#: A kind later in KINDS must fit better than an earlier one by this factor: earlier ones collide faster.
PREFERENCE = 0.95


@dataclass(frozen=True)
class Fit:
    """A fitted primitive; RMS distance of the hull's surface from its own [m]; its volume over the hull's."""

    primitive: Primitive
    rms_distance: float
    volume_ratio: float


def box_distance(points: Array, size: Array) -> Array:
    """Signed distance [m] of points (n, 3) from a box of half sizes (3,)."""
    return _outside(np.abs(points) - size)


def cylinder_distance(points: Array, size: Array) -> Array:
    """Signed distance [m] of points (n, 3) from a cylinder along z; size: radius, half length."""
    return _outside(np.stack([np.hypot(points[:, 0], points[:, 1]) - size[0], np.abs(points[:, 2]) - size[1]], axis=1))


def capsule_distance(points: Array, size: Array) -> Array:
    """Signed distance [m] of points (n, 3) from a capsule along z; size: radius, half length."""
    beyond = points[:, 2] - np.clip(points[:, 2], -size[1], size[1])
    return np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2 + beyond**2) - size[0]


def sphere_distance(points: Array, size: Array) -> Array:
    """Signed distance [m] of points (n, 3) from a sphere; size: radius."""
    return np.linalg.norm(points, axis=1) - size[0]


DISTANCES: dict[str, Callable[[Array, Array], Array]] = {
    "box": box_distance,
    "cylinder": cylinder_distance,
    "capsule": capsule_distance,
    "sphere": sphere_distance,
}


def _outside(beyond: Array) -> Array:
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    inside: Array = np.minimum(beyond.max(axis=1), 0.0)
    return outside + inside


def fit(mesh: Any, kinds: Sequence[str] = KINDS) -> Fit:
    """Fit each kind and return the best.

    Args:
        mesh: ``trimesh.Trimesh`` [m].
        kinds: of ``box``, ``cylinder``, ``capsule``, ``sphere``.

    Raises:
        ValueError: an unknown kind.
    """
    unknown = set(kinds) - set(DISTANCES)
    if unknown or not kinds:
        raise ValueError(f"unknown primitive {sorted(unknown)}: use some of {', '.join(KINDS)}")
    with np.errstate(invalid="ignore"):  # a flat mesh has no volume to divide by
        to_box, extents = trimesh.bounds.oriented_bounds(mesh, ordered=False)
    from_box = np.linalg.inv(to_box)
    turn, middle = Rotation.from_matrix(from_box[:3, :3]), from_box[:3, 3]
    if extents.min() < SMALLEST_THICKNESS:
        half = np.maximum(extents, SMALLEST_THICKNESS) / 2
        return Fit(_primitive("box", half, middle, turn), 0.0, float("inf"))
    try:
        hull = mesh.convex_hull
    except QhullError:
        half = np.maximum(extents, SMALLEST_THICKNESS) / 2
        return Fit(_primitive("box", half, middle, turn), 0.0, float("inf"))
    points, _ = trimesh.sample.sample_surface(hull, SAMPLES, seed=0)
    points = np.asarray(points, dtype=float)
    best: Fit | None = None
    for kind in sorted(kinds, key=KINDS.index):
        primitive, rms = _fit_kind(kind, points, extents / 2, middle, turn)
        if best is None or rms < PREFERENCE * best.rms_distance:
            best = Fit(primitive, rms, primitive.volume() / float(hull.volume))
    assert best is not None  # kinds is not empty
    return best


def _fit_kind(kind: str, points: Array, half: Array, middle: Array, turn: Rotation) -> tuple[Primitive, float]:
    """Least squares from one start per axis of the bounding box (boxes and spheres need one start only)."""
    distance, scale = DISTANCES[kind], float(half.max())
    solutions = []
    for axis in range(3 if kind in ("cylinder", "capsule") else 1):
        # The start frame: the bounding box's, with its axis number `axis` moved to z.
        order = [(axis + 1) % 3, (axis + 2) % 3, axis]
        frame = Rotation.from_matrix(turn.as_matrix()[:, order])
        size = _start_size(kind, half[order])
        local = frame.inv().apply(points - middle)

        def residual(x: Array, local: Array = local, count: int = len(size)) -> Array:
            moved = Rotation.from_rotvec(x[3:6]).inv().apply(local - x[:3] * scale)
            return distance(moved, np.abs(x[6 : 6 + count]) * scale) / scale

        start = np.concatenate([np.zeros(6), size / scale])
        found = least_squares(
            residual, start, x_scale=np.concatenate([np.full(6, 0.1), np.full(len(size), 0.1)]), max_nfev=80
        )
        place = middle + frame.apply(found.x[:3] * scale)
        turned = frame * Rotation.from_rotvec(found.x[3:6])
        rms = float(np.sqrt(np.mean(found.fun**2)) * scale)
        solutions.append((rms, _primitive(kind, np.abs(found.x[6:]) * scale, place, turned)))
    rms, primitive = min(solutions, key=lambda solution: solution[0])
    return primitive, rms


def _start_size(kind: str, half: Array) -> Array:
    radius = float(np.mean(half[:2]))
    if kind == "box":
        return half.copy()
    if kind == "sphere":
        return np.array([float(np.mean(half))])
    return np.array([radius, max(half[2] - (radius if kind == "capsule" else 0.0), 0.05 * radius)])


def _primitive(kind: str, size: Array, place: Array, turn: Rotation) -> Primitive:
    """The fitted primitive, rounded to six digits: a fit is good to tenths of a millimetre."""
    quat = quaternion(Rotation.identity() if kind == "sphere" else turn)
    rounded = tuple(float(np.round(value, 6)) for value in quat)
    return Primitive(
        kind,
        tuple(max(float(np.round(v, 6)), 1e-6) for v in size),
        tuple(float(np.round(v, 6)) for v in place),
        rounded,
    )
