"""Robots in a viser scene: bodies as frames that move, with their triangles below them."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.view import colours
from tiago_mj.view.shapes import Part, moving, parts

Array = NDArray[np.float64]
Paint = Callable[[Part], tuple[colours.Colour, float]]

#: Below the table's top a floor would hide nothing: the grid lies this much under what it carries [m].
UNDER: Final = 0.001


@dataclass
class Drawn:
    """One robot in a viser scene.

    Attributes:
        root: frame above all of it; moving it moves the robot.
        frames: by body.
        fixed: below this is what never moves.
        meshes: what is seen, with its opacity.
    """

    root: Any
    frames: dict[int, Any]
    fixed: Any
    meshes: list[tuple[Any, float]]
    _last: dict[int, bytes] = field(default_factory=dict)

    def pose(self, positions: Array, quaternions: Array) -> None:
        """Move its bodies.

        Args:
            positions: of all bodies of the model, (nbody, 3) [m].
            quaternions: w first, (nbody, 4).
        """
        for body, frame in self.frames.items():
            key = positions[body].tobytes() + quaternions[body].tobytes()
            if self._last.get(body) != key:  # what rests is not sent again
                self._last[body] = key
                frame.position, frame.wxyz = positions[body], quaternions[body]


def draw(
    scene: Any,
    name: str,
    model: mujoco.MjModel,
    *,
    paint: Paint | None = None,
    shadows: bool = True,
    without: Collection[int] = (),
) -> Drawn:
    """Put a robot into a scene.

    Args:
        scene: of a ``viser.ViserServer``.
        name: of its root, such as ``/measured``.
        model: compiled.
        paint: colour and opacity of a part; its own where None.
        shadows: whether it casts them.
        without: bodies that are left out.
    """
    root = scene.add_frame(name, show_axes=False)
    fixed = scene.add_frame(f"{name}/fixed", show_axes=False)
    moves = moving(model)
    frames: dict[int, Any] = {}
    meshes: list[tuple[Any, float]] = []
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    for number, part in enumerate(parts(model)):
        if part.body in without:
            continue
        place = f"{name}/{part.body}" if moves[part.body] else f"{name}/fixed/{part.body}"
        if part.body not in frames:
            frame = scene.add_frame(
                place, show_axes=False, position=data.xpos[part.body].copy(), wxyz=data.xquat[part.body].copy()
            )
            frames[part.body] = frame
        colour, opacity = (part.colour, part.opacity) if paint is None else paint(part)
        mesh = scene.add_mesh_simple(
            f"{place}/{number}",
            part.vertices,
            part.faces,
            color=tuple(round(255 * channel) for channel in colour),
            opacity=None if opacity >= 1 else opacity,
            cast_shadow=shadows and opacity >= 1,
            receive_shadow=opacity >= 1,
        )
        meshes.append((mesh, opacity))
    return Drawn(root, {body: frame for body, frame in frames.items() if moves[body]}, fixed, meshes)


def furnish(server: Any, model: mujoco.MjModel, low: Array, high: Array) -> None:
    """Add floor and light, and place the camera so that a box is in view.

    Args:
        server: a ``viser.ViserServer``.
        model: whose floor, where it has one, says how high the grid lies.
        low, high: corners of the box, (3,) [m].
    """
    scene = server.scene
    size = float(np.linalg.norm(high - low))
    floor = floor_of(model)
    cell = 10.0 ** np.floor(np.log10(max(size, 1e-3)))  # 0.1 m for a hand, 1 m for a robot
    cell = cell / 2 if size / cell < 3 else cell
    scene.set_up_direction("+z")
    scene.add_grid(
        "/floor",
        width=40 * cell,
        height=40 * cell,
        cell_size=cell,
        section_size=5 * cell,
        cell_color=(206, 211, 217),
        section_color=(160, 168, 178),
        position=(0.0, 0.0, (min(float(low[2]), 0.0) if floor is None else floor) - UNDER),
        fade_distance=40 * cell,
        shadow_opacity=0.18,
    )
    scene.configure_environment_map(None)  # a picture that the browser would have to decode before anything is seen
    scene.configure_default_lights(enabled=False)
    scene.add_light_ambient("/light/all", color=(255, 255, 255), intensity=0.9)
    scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(190, 194, 200), intensity=1.1)
    centre = (low + high) / 2
    scene.add_light_directional(
        "/light/sun", color=(255, 252, 245), intensity=1.7, cast_shadow=True, wxyz=_down(), position=centre + size
    )
    camera = server.initial_camera
    camera.look_at = tuple(centre)
    away = DISTANCE * size * np.array(VIEW) / np.linalg.norm(VIEW)
    camera.position = tuple(centre + away)

    def step_back(client: Any) -> None:
        """Where panels leave little width the camera stands farther off, so that all of the box is in view."""
        # Where it may stand without a hand: where a browser's camera is before it hears of ours, or was told to be.
        waiting = [] if np.allclose(client.camera.position, centre + away) else [np.array(client.camera.position)]
        for _ in range(LOOKS):
            time.sleep(PAUSE)
            at = client.camera.position
            if any(np.allclose(at, one, atol=0.01 * size) for one in waiting):
                continue
            if not np.allclose(at, centre + away, atol=0.01 * size):
                return  # a hand has moved it, or an address
            narrow = float(client.camera.aspect)
            if 0 < narrow < 1:
                stepped = centre + away / max(narrow, NARROWEST)
                waiting.append(stepped)
                client.camera.position = stepped
                client.camera.look_at = tuple(centre)  # which moves with the position

    server.on_client_connect(step_back)
    camera.fov = FIELD
    camera.near = max(size / 200, 1e-3)


#: From where the camera looks, and its vertical field of view [rad].
VIEW: Final = (0.75, -0.95, 0.62)
FIELD: Final = 0.75
#: How far it stands from the middle of what it looks at, in sizes of that; and the width over height of a window down
#: to which it steps back.
DISTANCE: Final = 1.0
NARROWEST: Final = 0.4
#: A browser is asked so often, with pauses of so many seconds, whether its panels leave little width.
LOOKS: Final = 12
PAUSE: Final = 0.5


def _down() -> tuple[float, float, float, float]:
    """The sun's frame: it shines along its -z, from above, a little from the side."""
    quaternion = np.zeros(4)
    mujoco.mju_euler2Quat(quaternion, np.array([0.45, 0.35, 0.0]), "xyz")
    w, x, y, z = (float(v) for v in quaternion)
    return w, x, y, z


def floor_of(model: mujoco.MjModel) -> float | None:
    """Height of the first horizontal plane of the world body [m]; None where there is none."""
    for geom in range(model.ngeom):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE and int(model.geom_bodyid[geom]) == 0:
            return float(model.geom_pos[geom, 2])
    return None
