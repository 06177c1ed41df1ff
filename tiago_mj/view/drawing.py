"""Frames of a film, drawn after the motion is over: in several processes, with the forces and the goal in the scene.

A snapshot holds what a frame needs, so that frames do not depend on one another and the simulation never waits for
OpenGL. Without a GPU a frame costs 30 to 150 ms, most of it shadows and antialiasing: shadow maps are a quarter as wide
as MuJoCo's default, and two samples a pixel smooth the edges.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from tiago_mj.models import names
from tiago_mj.models.scene import GOAL_SITE
from tiago_mj.view import colours
from tiago_mj.view.pad_forces import PadForce, pad_forces

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

#: Width of a shadow map [texel], and samples a pixel.
SHADOWS: Final = 1024
SAMPLES: Final = 2
#: Length and radius of an arrow [m/N, m], and how far behind the pad it begins [m]: outside of the finger, where it is
#: seen. Below so much [N] none is drawn.
ARROW_LENGTH: Final = 0.008
ARROW_RADIUS: Final = 0.0025
ARROW_OFFSET: Final = 0.03
MIN_DRAWN_FORCE: Final = 0.05
COLOURS: Final = {"right": (*colours.rgb(colours.RIGHT), 1.0), "left": (*colours.rgb(colours.LEFT), 1.0)}
GOAL: Final = (*colours.rgb(colours.GOAL), 0.45)
#: Opacity of a ghost, and how far in front of the robot it is drawn [m], to be seen where both are in one place.
GHOST: Final = 0.5
IN_FRONT: Final = 0.0015
#: Frames that one process draws at once, and from how many on several processes are worth their start.
FRAMES_PER_TASK: Final = 12
MIN_PARALLEL_FRAMES: Final = 40


@dataclass(frozen=True)
class Camera:
    """A free camera: [m], [degree]. ``follows``: it looks at the middle between the pads, wherever that goes."""

    lookat: tuple[float, float, float]
    distance: float
    azimuth: float
    elevation: float
    follows: bool = False


#: Between the fingers, from before and above, so that both pads are seen; beside a whole robot's hand, which holds; and
#: over the table, where the hand goes to a place or takes the object there.
AT_THE_PADS: Final = Camera((0.665, 0.0, 0.605), 0.36, 170, -40)
AT_THE_HAND: Final = Camera((0.65, 0.0, 0.65), 0.48, 150, -35, follows=True)
OVER_THE_TABLE: Final = Camera((0.58, 0.0, 0.66), 1.25, 135, -28)


@dataclass(frozen=True)
class Ghost:
    """A second robot, transparent: where it stands, (nq,), and its colour as hexadecimal digits."""

    qpos: Array
    colour: str


@dataclass(frozen=True)
class Snapshot:
    """What one frame shows.

    Attributes:
        qpos: (nq,).
        mocap: positions and quaternions, (nmocap, 7).
        forces: on the pads.
        hand: middle between the pads, (3,) [m]; None where the robot has none.
        goal: place of the goal where the task draws one, (3,) [m]; or None.
        caption: a line of text; empty for none.
        ghost: a second robot in the same place, what its joints move; None: there is none.
    """

    qpos: Array
    mocap: Array
    forces: tuple[PadForce, ...]
    hand: Array | None
    goal: Array | None
    caption: str = ""
    ghost: Ghost | None = None


def snapshot(core: Any, caption: str = "") -> Snapshot:
    """Snapshot of the present state of an environment."""
    model, data = core.model, core.data
    pads = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name) for name in names.PAD_SITE.values()]
    return Snapshot(
        data.qpos.copy(),
        np.concatenate([data.mocap_pos, data.mocap_quat], axis=1),
        tuple(pad_forces(core)),
        data.site_xpos[pads].mean(axis=0) if min(pads) >= 0 else None,
        np.array(core.goal, dtype=np.float64) if _goal_site(model) >= 0 else None,
        caption,
    )


def camera_of(core: Any) -> Camera:
    """Camera for an environment: at the pads of a gripper, at the hand of a whole robot that holds something, over the
    table where the goal is a place."""
    if _goal_site(core.model) >= 0:
        return OVER_THE_TABLE
    return AT_THE_PADS if len(core.joints) == len(names.SIDES) else AT_THE_HAND


def _goal_site(model: mujoco.MjModel) -> int:
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, GOAL_SITE))


def draw(
    model: mujoco.MjModel,
    snapshots: Sequence[Snapshot],
    *,
    size: tuple[int, int] = (480, 480),
    camera: Camera = AT_THE_PADS,
    processes: int | None = 1,
    done: Callable[[int], None] = lambda frames: None,
) -> list[Frame]:
    """Draw snapshots, each (height, width, 3).

    Args:
        model: of the environment.
        snapshots: in their order.
        size: width and height of a frame [pixel].
        camera: where it is seen from.
        processes: that draw; None: as many as there are processors, where there is enough to draw. They are spawned, so
            that a script needs its ``if __name__ == "__main__"``.
        done: told how many frames are drawn.
    """
    count = processes or (os.cpu_count() or 1)
    if count == 1 or len(snapshots) < MIN_PARALLEL_FRAMES:
        return list(_drawn(model, snapshots, size, camera, done))
    portions = {
        first: snapshots[first : first + FRAMES_PER_TASK] for first in range(0, len(snapshots), FRAMES_PER_TASK)
    }
    frames: dict[int, list[Frame]] = {}
    try:
        with ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
            asked = {pool.submit(_portion, model, portion, size, camera): first for first, portion in portions.items()}
            for future in as_completed(asked):
                frames[asked[future]] = future.result()
                done(sum(len(some) for some in frames.values()))
    except Exception:  # no room for processes, or no OpenGL in them: this one does it
        return list(_drawn(model, snapshots, size, camera, done))
    return [frame for first in portions for frame in frames[first]]


def _portion(
    model: mujoco.MjModel, snapshots: Sequence[Snapshot], size: tuple[int, int], camera: Camera
) -> list[Frame]:
    return list(_drawn(model, snapshots, size, camera, lambda frames: None))


def _drawn(
    model: mujoco.MjModel,
    snapshots: Sequence[Snapshot],
    size: tuple[int, int],
    camera: Camera,
    done: Callable[[int], None],
) -> Iterator[Frame]:
    """Frames of snapshots in order, drawn by one renderer."""
    width, height = size
    quality, offscreen = model.vis.quality, model.vis.global_
    before = quality.shadowsize, quality.offsamples, offscreen.offwidth, offscreen.offheight
    quality.shadowsize, quality.offsamples = SHADOWS, SAMPLES
    offscreen.offwidth, offscreen.offheight = max(width, before[2]), max(height, before[3])
    data = mujoco.MjData(model)
    try:
        with mujoco.Renderer(model, height, width) as renderer:
            for k, one in enumerate(snapshots):
                data.qpos[:] = one.qpos
                data.mocap_pos[:], data.mocap_quat[:] = one.mocap[:, :3], one.mocap[:, 3:]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_camlight(model, data)
                _place_goal(model, data, one)
                renderer.update_scene(data, _camera(camera, one))
                if one.ghost is not None:
                    _add_ghost(model, renderer.scene, one.ghost)
                for force in one.forces:
                    _arrows(renderer.scene, force)
                frame = np.asarray(renderer.render(), dtype=np.uint8)
                yield captioned(frame, one.caption) if one.caption else frame
                done(k + 1)
    finally:
        quality.shadowsize, quality.offsamples, offscreen.offwidth, offscreen.offheight = before


def _place_goal(model: mujoco.MjModel, data: mujoco.MjData, one: Snapshot) -> None:
    if one.goal is not None:
        data.site_xpos[_goal_site(model)] = one.goal


def _camera(camera: Camera, one: Snapshot) -> mujoco.MjvCamera:
    out = mujoco.MjvCamera()
    out.lookat[:] = camera.lookat
    if camera.follows and one.hand is not None:
        out.lookat[:] = one.hand
    out.distance, out.azimuth, out.elevation = camera.distance, camera.azimuth, camera.elevation
    return out


def _add_ghost(model: mujoco.MjModel, scene: mujoco.MjvScene, ghost: Ghost) -> None:
    """Draw what the joints of a second robot move, transparent."""
    data = mujoco.MjData(model)
    data.qpos[:] = ghost.qpos
    mujoco.mj_kinematics(model, data)
    moved = jointed(model)
    nearer = -IN_FRONT * np.array(scene.camera[0].forward)
    first, dynamic = scene.ngeom, int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
    mujoco.mjv_addGeoms(model, data, mujoco.MjvOption(), mujoco.MjvPerturb(), dynamic, scene)
    for k in range(first, scene.ngeom):
        geom = scene.geoms[k]
        own = geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and moved[model.geom_bodyid[geom.objid]]
        geom.matid = -1
        geom.rgba[:] = (*colours.rgb(ghost.colour), GHOST if own else 0.0)
        geom.pos[:] += nearer


def jointed(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Whether a hinge or a slide moves a body, (nbody,)."""
    free = int(mujoco.mjtJoint.mjJNT_FREE)
    found = np.zeros(model.nbody, dtype=bool)
    for body in range(1, model.nbody):
        own = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        found[body] = found[model.body_parentid[body]] or any(model.jnt_type[joint] != free for joint in own)
    return found


def _arrows(scene: mujoco.MjvScene, force: PadForce) -> None:
    """Draw the force on a pad as an arrow away from the pad, and the goal's as a pale, wider one."""
    if force.goal is not None:
        _arrow(scene, force, force.goal, 2 * ARROW_RADIUS, GOAL)
    if force.newtons > MIN_DRAWN_FORCE:
        _arrow(scene, force, force.newtons, ARROW_RADIUS, COLOURS[force.side])


def _arrow(
    scene: mujoco.MjvScene, force: PadForce, newtons: float, radius: float, colour: tuple[float, float, float, float]
) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom, mujoco.mjtGeom.mjGEOM_ARROW, np.zeros(3), np.zeros(3), np.zeros(9), np.array(colour, dtype=np.float32)
    )
    tail = force.place + ARROW_OFFSET * force.outwards
    tip = tail + ARROW_LENGTH * newtons * force.outwards
    mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_ARROW, radius, tail, tip)
    scene.ngeom += 1


def captioned(frame: Frame, text: str) -> Frame:
    """The frame with a line of text in its upper left corner."""

    image = Image.fromarray(frame)
    size = max(12, frame.shape[0] // 26)
    margin = size // 2
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(size)
    draw.rectangle((0, 0, frame.shape[1], size + 2 * margin), fill=(20, 24, 30))
    draw.text((margin, margin - 1), text, fill=(240, 242, 245), font=font)
    return np.asarray(image)
