"""Still picture of a story, rendered by MuJoCo: the robots as ghosts in one place, the diagnosed part highlighted."""

from __future__ import annotations

import copy
import io
from types import MappingProxyType
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tiago_mj.view import colours, scene
from tiago_mj.view.shapes import GROUPS, colour_of
from tiago_mj.view.stage import Kinematics, measures, well_seen
from tiago_mj.view.story import Story

Array = NDArray[np.float64]

WIDTH, HEIGHT = 900, 540
#: Where nothing is.
PAPER: Final = 246
#: Of the ghosts; of the repaired one little, as it mostly stands where the measured robot is, which is lit.
OPACITY: Final = MappingProxyType({"nominal": 0.45, "repaired": 0.13})
#: Share of the picture that the robots take, its width or its height; taken nearer where they take less than the other.
FILLED: Final = 0.8
LITTLE: Final = 0.7
#: Nor nearer than this share of the distance.
NEAREST: Final = 0.25
#: MuJoCo's vertical field of view [degree].
FIELD: Final = 40.0


def still(story: Story) -> tuple[bytes, int, float] | None:
    """PNG of the moment with the largest nominal error, the exaggeration of differences, and the moment [s]; None where
    OpenGL cannot be started."""
    low, high, away = measures(story)
    size = float(np.linalg.norm(high - low))
    larger = well_seen(size, away)
    row = farthest(story)
    centre, distance = (low + high) / 2, 1.15 * size
    try:
        pixels = _rendered(story, row, larger, centre, distance)
        nearer = framed(pixels, centre, distance)  # the room of the whole motion is more than that of one moment
        if nearer is not None:
            pixels = _rendered(story, row, larger, *nearer)
    except Exception:  # no OpenGL: every library that could bring it fails in its own way
        return None
    out = io.BytesIO()
    Image.fromarray(pixels).convert("P", palette=Image.Palette.ADAPTIVE, colors=192).save(out, "PNG", optimize=True)
    return out.getvalue(), larger, float(story.time[row])


def framed(pixels: Array, centre: Array, distance: float) -> tuple[Array, float] | None:
    """Point and distance for the camera that make the robots fill the picture; None where they fill it, or are not
    whole in it.

    Args:
        pixels: as it is now, (HEIGHT, WIDTH, 3).
        centre: looked at, (3,) [m].
        distance: from there [m].
    """
    rows, columns = np.nonzero((pixels != PAPER).any(axis=-1))
    if not len(rows):
        return None
    top, bottom, left, right = rows.min(), rows.max(), columns.min(), columns.max()
    share = max((bottom - top) / HEIGHT, (right - left) / WIDTH)
    if share >= LITTLE or share <= 0 or min(top, left) == 0 or bottom == HEIGHT - 1 or right == WIDTH - 1:
        return None
    towards = -np.array(scene.VIEW) / np.linalg.norm(scene.VIEW)
    across = np.cross(towards, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    up = np.cross(across, towards)
    metres = 2 * distance * np.tan(np.radians(FIELD) / 2) / HEIGHT  # a pixel at that distance
    aside, above = (left + right - WIDTH) / 2 * metres, (HEIGHT - top - bottom) / 2 * metres
    return centre + aside * across + above * up, distance * max(share / FILLED, NEAREST)


def farthest(story: Story) -> int:
    """Row with the largest distance between nominal and measured joint positions; the middle row without a
    simulator."""
    nominal = next((motion for motion in story.motions if motion.role == "nominal"), None)
    if nominal is None or not story.joints:
        return len(story.time) // 2
    joints = list(story.joints)
    away = np.abs(nominal.qpos[:, joints] - story.motions[0].qpos[:, joints])
    name = story.channels[0] if story.channels else ""
    if name.startswith("position.") and name in story.signals.nominal:
        away = np.abs(story.signals.nominal[name] - story.signals.measured[name])[:, None]
        if name in story.signals.repaired:  # where the repair does most
            away = away - np.abs(story.signals.repaired[name] - story.signals.measured[name])[:, None]
    return int(np.argmax(np.nan_to_num(away).max(axis=1)))


def _rendered(story: Story, row: int, larger: int, centre: Array, distance: float) -> Array:
    stand = Kinematics(story)
    model = copy.copy(story.model)
    model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH, HEIGHT
    model.vis.global_.fovy = FIELD
    model.vis.map.znear = 0.005
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:], model.vis.headlight.specular[:] = 0.5, 0.65, 0.1
    model.light_active[:] = 0
    _paint(model, story)
    option = mujoco.MjvOption()
    option.geomgroup[:] = [group in GROUPS for group in range(len(option.geomgroup))]
    option.sitegroup[:] = 0
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    view = np.array(scene.VIEW)
    camera.lookat[:] = centre
    camera.distance = distance
    camera.azimuth = float(np.degrees(np.arctan2(-view[1], -view[0])))
    camera.elevation = float(np.degrees(np.arctan2(-view[2], np.linalg.norm(view[:2]))))
    renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    try:
        data = _at(model, stand(story.motions[0], row))
        renderer.update_scene(data, camera, option)
        drawn = renderer.scene
        for flag in (
            mujoco.mjtRndFlag.mjRND_SHADOW,
            mujoco.mjtRndFlag.mjRND_REFLECTION,
            mujoco.mjtRndFlag.mjRND_SKYBOX,
        ):
            drawn.flags[flag] = 0
        hidden = story.unmeasured if len(story.motions) > 1 else frozenset()
        for k in range(drawn.ngeom):
            geom = drawn.geoms[k]
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and int(model.geom_bodyid[geom.objid]) in hidden:
                geom.rgba[3] = 0.0
        for motion in story.motions[1:]:
            first = drawn.ngeom
            ghost = _at(model, stand(motion, row, larger))
            dynamic = int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
            mujoco.mjv_addGeoms(model, ghost, option, mujoco.MjvPerturb(), dynamic, drawn)
            look = colours.LOOKS[motion.role]
            for k in range(first, drawn.ngeom):
                drawn.geoms[k].matid = -1
                drawn.geoms[k].rgba[:] = (*colours.rgb(look.colour), OPACITY[motion.role])
        pixels = renderer.render()
        return np.where((pixels == 0).all(axis=-1, keepdims=True), np.uint8(PAPER), pixels)
    finally:
        renderer.close()


def _paint(model: mujoco.MjModel, story: Story) -> None:
    """The measured robot in greys, what is guilty lit."""
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        rgba = colour_of(model, geom)
        plain = colours.grey((float(rgba[0]), float(rgba[1]), float(rgba[2])))
        if body == 0 and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            model.geom_matid[geom], model.geom_rgba[geom] = -1, (0.0, 0.0, 0.0, 0.0)
            continue
        if body == 0:
            plain = colours.mixed(plain, (1.0, 1.0, 1.0), 0.6)
        if body in story.lit:
            plain = colours.mixed(plain, colours.rgb(colours.LIT), 0.8)
        model.geom_matid[geom] = -1
        model.geom_rgba[geom] = (*plain, rgba[3])


def _at(model: mujoco.MjModel, poses: tuple[Array, Array]) -> Any:
    """MuJoCo's data with bodies and geoms at given poses."""
    data = mujoco.MjData(model)
    data.xpos[:], data.xquat[:] = poses
    rotation, frame = np.zeros(9), np.zeros(4)
    for body in range(model.nbody):
        mujoco.mju_quat2Mat(data.xmat[body], data.xquat[body])
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        mujoco.mju_mulQuat(frame, data.xquat[body], model.geom_quat[geom])
        mujoco.mju_quat2Mat(rotation, frame)
        data.geom_xmat[geom] = rotation
        data.geom_xpos[geom] = data.xpos[body] + data.xmat[body].reshape(3, 3) @ model.geom_pos[geom]
    # Lights and cameras of the model stand as they do at the reference pose.
    reference = mujoco.MjData(model)
    mujoco.mj_kinematics(model, reference)
    mujoco.mj_comPos(model, reference)
    mujoco.mj_camlight(model, reference)
    data.light_xpos[:], data.light_xdir[:] = reference.light_xpos, reference.light_xdir
    return data
