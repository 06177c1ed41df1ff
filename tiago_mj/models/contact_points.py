"""Quantities of a MuJoCo contact between two geoms: their inverse weight, and how many contact points share the
load."""

from __future__ import annotations

from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Penetration [m] and tilt [rad] at which contact points are counted: deep enough that every point of a 30 mm pad
#: tilted by 0.1 degree touches (30 mm · 0.1° = 0.05 mm), and shallow beside any object.
_COUNT_PENETRATION: Final = 1e-3
_COUNT_TILT: Final = np.radians(0.1)


def shared_contact_points(
    model: mujoco.MjModel, geom1: str | int, geom2: str | int, qpos: ArrayLike | None = None
) -> int:
    """How many contact points share the load when two geoms are pressed together, by MuJoCo's own collider.

    The two are brought together along their shortest connection at the pose ``qpos``, 1 mm deep, and tilted by ±0.1°
    about both tangents. Found with MuJoCo 4.0 (``multiccd`` on, its default) for a box pad of 29.5 × 29.5 mm,
    from 1 µm to 5 mm of penetration:

    ==================  ==============================================================================
    upright cylinder    2 at every depth, also tilted by 3°; (1 where the option ``multiccd`` is off)
    box                 4 when flat; 2 or 3 while tilted and not yet pressed flat
    sphere, ellipsoid   1
    capsule             1 when exactly parallel to the pad, 2 as soon as it tilts: **ambiguous**
    ==================  ==============================================================================

    The total stiffness holds when all points are in contact (a flat pad, any split of the load between them: the forces
    add up to K times the mean approach). A tilted box that stands on m of its n points has m/n of it, as an edge of a
    real pad is softer than its face.

    Args:
        model: compiled model in which the two geoms can collide (an explicit pair, or contype and conaffinity).
        geom1: name or id, for instance the pad.
        geom2: name or id, for instance the object.
        qpos: (nq,) pose at which they face each other; the model's ``qpos0`` if None.

    Raises:
        ValueError: an unknown geom, geoms that do not collide, overlap at ``qpos``, or whose number of points depends
            on a tilt of 0.1° (give ``contact_points`` yourself then).
    """
    first, second = geom_id(model, geom1), geom_id(model, geom2)
    where = f"geoms {geom1!r} and {geom2!r}"
    counts = _counted(model, first, second, qpos, where)
    if counts == {0}:
        raise ValueError(f"{where} do not collide: declare a contact pair for them, or mend contype and conaffinity")
    if len(counts) > 1:
        found = " or ".join(map(str, sorted(counts)))
        raise ValueError(
            f"{where} touch at {found} points, depending on a tilt of 0.1°: choose another shape (a cylinder for a "
            "capsule) or give contact_points"
        )
    return int(counts.pop())


def _counted(model: mujoco.MjModel, first: int, second: int, qpos: ArrayLike | None, where: str) -> set[int]:
    """Numbers of contact points of two geoms pressed together, flat and with each of the four tilts."""
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    line = np.zeros(6)
    gap = mujoco.mj_geomDistance(model, data, first, second, 10.0, line)
    direction = line[3:] - line[:3]
    if gap <= 0.0 or not np.any(direction):
        raise ValueError(f"{where} overlap at this pose: give a qpos at which they face each other with a gap")
    direction /= np.linalg.norm(direction)
    tangents = np.linalg.svd(direction[None])[2][1:]
    home = data.geom_xpos[second] - (gap + _COUNT_PENETRATION) * direction
    orientation = data.geom_xmat[second].reshape(3, 3).copy()
    counts = set()
    for a, b in ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        data.geom_xpos[second] = home
        data.geom_xmat[second] = (_rotation(_COUNT_TILT * (a * tangents[0] + b * tangents[1])) @ orientation).ravel()
        mujoco.mj_collision(model, data)
        counts.add(sum({c.geom1, c.geom2} == {first, second} for c in data.contact))
    return counts


def inverse_weight(model: mujoco.MjModel, geom1: str | int, geom2: str | int) -> float:
    """Â [1/kg] that MuJoCo uses for a contact of two geoms: the sum of their bodies' translational ``body_invweight0``.

    It is not the sum of 1/mass: for a finger on one slide it is a third of that (MuJoCo averages over the three
    directions), and it includes the armature. After a change of masses call ``mujoco.mj_setConst`` first.

    Raises:
        ValueError: an unknown geom, or two geoms that are both fixed to the world (Â = 0: no contact force exists).
    """
    bodies = [model.geom_bodyid[geom_id(model, geom)] for geom in (geom1, geom2)]
    total = float(model.body_invweight0[bodies, 0].sum())
    if total <= 0.0:
        raise ValueError(
            f"geoms {geom1!r} and {geom2!r} are both fixed to the world: MuJoCo computes no contact for them"
        )
    return total


def geom_id(model: mujoco.MjModel, geom: str | int) -> int:
    """Index of a geom given by name or id; ValueError if there is none."""
    return lookup(model, mujoco.mjtObj.mjOBJ_GEOM, geom, model.ngeom, "geom")


def lookup(model: mujoco.MjModel, kind: Any, item: str | int, count: int, what: str) -> int:
    """Index of a named element (or a checked index); ValueError that lists what the model has."""
    index = mujoco.mj_name2id(model, kind, item) if isinstance(item, str) else int(item)
    if not 0 <= index < count:
        known = [mujoco.mj_id2name(model, kind, i) or f"#{i}" for i in range(count)]
        raise ValueError(f"no {what} {item!r} in the model: it has {', '.join(known) or 'none'}")
    return int(index)


def _rotation(vector: Array) -> Array:
    """Rotation matrix (3, 3) of a rotation vector [rad]."""
    angle = float(np.linalg.norm(vector))
    quaternion, matrix = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quaternion, vector / angle if angle else np.array([1.0, 0.0, 0.0]), angle)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def pair_contact_points(model: mujoco.MjModel, pair: str | int, qpos: ArrayLike | None = None) -> int:
    """How many contact points share the load of an explicit ``<contact><pair>``, by MuJoCo's own collider.

    Args:
        model: compiled.
        pair: name or id.
        qpos: (nq,) pose at which its two geoms face each other; the model's ``qpos0`` if None.

    Raises:
        ValueError: an unknown pair, or what :func:`shared_contact_points` refuses.
    """
    index = pair_index(model, pair)
    return shared_contact_points(model, int(model.pair_geom1[index]), int(model.pair_geom2[index]), qpos)


def pair_index(model: mujoco.MjModel, pair: str | int) -> int:
    """Index of an explicit ``<contact><pair>``, by its name or id."""
    return lookup(model, mujoco.mjtObj.mjOBJ_PAIR, pair, model.npair, "contact pair")
