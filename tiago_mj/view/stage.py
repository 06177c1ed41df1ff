"""The robots of a story on one stage: as ghosts in one place or side by side, differences drawn to scale or larger."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.view import colours, scene
from tiago_mj.view.shapes import Part, extent, moving, parts
from tiago_mj.view.story import Motion, Story

Array = NDArray[np.float64]

#: How many times larger differences may be drawn.
LARGER: Final = (1, 2, 5, 10, 20, 50)
#: The largest difference is drawn at up to this share of the robot's size.
WELL_SEEN: Final = 0.08
#: Rows that are looked at to know how large the robots and their differences are.
LOOKED_AT: Final = 60


class Kinematics:
    """Poses of the bodies in rows of a story, by forward kinematics.

    Args:
        story: whose model and motions.
    """

    def __init__(self, story: Story) -> None:
        self._story, self._data = story, mujoco.MjData(story.model)
        self._scalar = np.array(story.joints, dtype=int)
        self._measured = story.motions[0].qpos

    def __call__(self, motion: Motion, row: int, larger: float = 1.0) -> tuple[Array, Array]:
        """Positions (nbody, 3) [m] and quaternions (nbody, 4) in one row of a motion.

        Args:
            motion: of one robot.
            row: of the story's time.
            larger: how many times larger than measured its joints' differences from the measured robot are drawn.
        """
        qpos = motion.qpos[row].copy()
        joints = self._scalar
        qpos[joints] += (larger - 1) * (qpos[joints] - self._measured[row, joints])
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._story.model, self._data)
        return self._data.xpos.copy(), self._data.xquat.copy()


class Stage:
    """A story in a viser scene.

    Args:
        server: a ``viser.ViserServer``.
        story: what is shown.

    Attributes:
        larger: how many times larger than measured differences are drawn.
        row: that is shown.
    """

    def __init__(self, server: Any, story: Story, *, beside: bool = False) -> None:
        self.server, self.story = server, story
        self.row, self.beside = 0, beside
        self._stand = Kinematics(story)
        self.low, self.high, away = measures(story)
        self.larger = well_seen(float(np.linalg.norm(self.high - self.low)), away)
        self._shown = {motion.role: True for motion in story.motions}
        with server.atomic():
            self._robots = {motion.role: self._draw(motion.role) for motion in story.motions}
            self._label = self._name_lit()
            scene.furnish(server, story.model, *self._seen())
            self.arrange(beside)
        self.show(0)

    def show(self, row: int) -> None:
        """Draw the robots as in a row."""
        self.row = row
        with self.server.atomic():
            for motion in self.story.motions:
                positions, quaternions = self._stand(motion, row, self.larger)
                self._robots[motion.role].pose(positions, quaternions)
                if motion.role == "measured" and self._label is not None:
                    self._label.position = self._over_lit(positions)

    def arrange(self, beside: bool) -> None:
        """Put the robots side by side, or as ghosts in one place."""
        self.beside = beside
        for number, motion in enumerate(self.story.motions):
            robot = self._robots[motion.role]
            robot.root.position = tuple(number * self._aside()) if beside else (0.0, 0.0, 0.0)
            robot.fixed.visible = beside or number == 0
            for mesh, opacity in robot.meshes:  # side by side nothing is behind a ghost
                mesh.opacity = None if beside or opacity >= 1 else opacity

    def hide(self, role: str, hidden: bool) -> None:
        """Hide a robot, or show it again."""
        self._shown[role] = not hidden
        self._robots[role].root.visible = not hidden

    def _draw(self, role: str) -> scene.Drawn:
        first = role == self.story.motions[0].role
        without = self.story.unmeasured if role == "measured" and len(self.story.motions) > 1 else frozenset()
        look = colours.LOOKS[role]
        tint = colours.rgb(look.colour)
        moves = moving(self.story.model)

        def paint(part: Part) -> tuple[colours.Colour, float]:
            if first:
                plain = colours.grey(part.colour)
                if part.body == 0:  # a table, say, is no part of the robot
                    plain = colours.mixed(plain, (1.0, 1.0, 1.0), 0.6)
                if part.body in self.story.lit:
                    return colours.mixed(plain, colours.rgb(colours.LIT), 0.72), part.opacity
                return plain, part.opacity
            if not moves[part.body]:
                return colours.mixed(colours.grey(part.colour), tint, 0.15), part.opacity
            return colours.mixed(tint, (1.0, 1.0, 1.0), 0.12), look.opacity * part.opacity

        return scene.draw(self.server.scene, f"/{role}", self.story.model, paint=paint, shadows=first, without=without)

    def _name_lit(self) -> Any:
        if not self.story.where or not self.story.lit:
            return None
        return self.server.scene.add_label(
            "/lit", self.story.where, anchor="bottom-center", font_screen_scale=1.0, depth_test=False
        )

    def _over_lit(self, positions: Array) -> tuple[float, ...]:
        lit = [body for body in self.story.lit if np.isfinite(positions[body]).all()]
        place = positions[lit].mean(axis=0)
        place[2] = positions[lit][:, 2].max() + 0.12 * float(np.linalg.norm(self.high - self.low))
        return tuple(float(v) for v in place)

    def _aside(self) -> Array:
        """Offset from one robot to the next when side by side, (3,) [m]."""
        wide = 1.2 * max(float(np.linalg.norm((self.high - self.low)[:2])), _width_of_fixed(self.story.model))
        towards = np.array(scene.VIEW)
        across = np.array([-towards[1], towards[0], 0.0])
        return wide * across / np.linalg.norm(across)

    def _seen(self) -> tuple[Array, Array]:
        """Box that the camera looks at."""
        if not self.beside:
            return self.low, self.high
        last = (len(self.story.motions) - 1) * self._aside()
        return np.minimum(self.low, self.low + last), np.maximum(self.high, self.high + last)


def measures(story: Story) -> tuple[Array, Array, float]:
    """Corners of the box around the robots, (3,), (3,) [m], and the largest distance of a body of a
    simulated robot from where it is measured [m]."""
    stand = Kinematics(story)
    rows = np.unique(np.linspace(0, len(story.time) - 1, LOOKED_AT).astype(int))
    moves = moving(story.model)
    poses = {motion.role: [stand(motion, row) for row in rows] for motion in story.motions}
    at = {role: np.array([positions for positions, _ in of]) for role, of in poses.items()}
    own = np.arange(story.model.nbody) > 0  # what is the world's own, a table say, may be larger than all of it
    low, high = extent(story.model, np.concatenate(list(at.values())), own if own.any() else ~own)
    compared = moves.copy()
    compared[list(story.unmeasured)] = False
    ends = {role: _corners(story, of, compared) for role, of in poses.items()}
    away = [
        float(np.linalg.norm(there - ends["measured"], axis=-1).max(initial=0.0))
        for role, there in ends.items()
        if role != "measured"
    ]
    return low, high, max(away, default=0.0)


def _corners(story: Story, poses: Sequence[tuple[Array, Array]], bodies: NDArray[np.bool_]) -> Array:
    """Corners of boxes around the parts of bodies, row by row, (T, n, 3) [m]: a body that only turns moves them."""
    found = []
    for part in parts(story.model):
        if not bodies[part.body]:
            continue
        low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
        corners = np.array([np.where(choice, high, low) for choice in np.ndindex(2, 2, 2)])
        quaternion = np.array([q[part.body] for _, q in poses])[:, None]
        axis = np.broadcast_to(quaternion[..., 1:], (len(poses), 8, 3))
        twice = 2 * np.cross(axis, np.broadcast_to(corners, axis.shape))
        turned = corners + quaternion[..., :1] * twice + np.cross(axis, twice)
        found.append(turned + np.array([p[part.body] for p, _ in poses])[:, None])
    return np.concatenate(found, axis=1) if found else np.zeros((len(poses), 0, 3))


def well_seen(size: float, away: float) -> int:
    """Factor by which differences are exaggerated, so that the largest is well visible."""
    if not away > 0:
        return 1
    return max((k for k in LARGER if k * away <= WELL_SEEN * size), default=1)


def _width_of_fixed(model: mujoco.MjModel) -> float:
    """Horizontal size of the fixed bodies [m]; 0 where none is visible."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    moves = moving(model)
    corners = [
        part.vertices @ data.xmat[part.body].reshape(3, 3).T + data.xpos[part.body]
        for part in parts(model)
        if not moves[part.body]
    ]
    return float(np.linalg.norm(np.ptp(np.concatenate(corners)[:, :2], axis=0))) if corners else 0.0
