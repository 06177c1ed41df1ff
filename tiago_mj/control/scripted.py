"""Scripted experts for the reach, push and pick-and-place tasks: what can be done there without learning.

Each is a short plan in Cartesian space over one resolved-rate controller. The plan says where the grasp point should
go; the controller turns that into joint velocities within every joint's speed and soft position limits. They know the
robot's kinematics and see what the agent sees.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Final

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tiago_mj.envs.pick_and_place import PickAndPlace
from tiago_mj.envs.position_goal import PositionGoal
from tiago_mj.envs.push import Push
from tiago_mj.envs.reach import Reach
from tiago_mj.models import names, scene
from tiago_mj.models.limits import joint_limits

Array = NDArray[np.float64]

#: Grasp point's speed over its distance from where it should be, and the same for rotations [1/s]. The servos lag by
#: about 40 ms and a command by one period of 40 ms: taken as one lag of 80 ms, the loop's damping ratio is
#: 1 / (2 √(5 · 0.08)) = 0.8, which overshoots by 2 %.
GAIN: Final = 5.0
#: Fastest that the grasp point is asked to move [m/s].
SPEED: Final = 0.4
#: How far off [m] is as bad as an orientation that is one radian off: about the hand's length.
ROTATION_WEIGHT: Final = 0.2
#: How wrong a speed of the grasp point [m/s] is as bad as one joint at full speed: a fifth of the smallest singular
#: value at the start of the tasks, so that it is felt close to singular poses only.
DAMPING: Final = 0.03
#: Part of the distance to a joint's soft limit that it may go in one control period: it slows down before it stops.
BRAKE: Final = 0.3


class ResolvedRates:
    """Joint velocities that move the grasp point as asked and keep the hand's orientation.

    Damped least squares in units of every joint's speed limit, so that a joint is used as much as it can do (the slow
    torso little), with bounds (lsq_linear), and a weak pull back to the pose at the start where that costs nothing.

    Args:
        core: the environment, for the model, the limits, the rate and the pose at the start.
        rotation_weight: see :data:`ROTATION_WEIGHT`.
    """

    def __init__(self, core: PositionGoal, rotation_weight: float = ROTATION_WEIGHT) -> None:
        self._model, self._data = core.model, mujoco.MjData(core.model)
        self._site = core.model.site(names.GRASP_SITE).id
        arm = [name for name in core.joints if name not in names.FINGERS]
        self._columns = [core.joints.index(name) for name in arm]
        self._dof = [int(core.model.joint(name).dofadr[0]) for name in arm]
        self._speed = core.velocity_limit[self._columns]
        limits = [joint_limits(core.model, name) for name in arm]
        self._low = np.array([limit.soft_lower for limit in limits], dtype=np.float64)
        self._high = np.array([limit.soft_upper for limit in limits], dtype=np.float64)
        self._dt = core.dt
        self._weight = rotation_weight
        self._qpos = core.initial_qpos.copy()
        self._addresses = [int(core.model.joint(name).qposadr[0]) for name in core.joints]
        self._posture = self._qpos[self._addresses][self._columns]
        self._turn(self._qpos[self._addresses])
        self._upright = np.array(self._data.site_xmat[self._site]).reshape(3, 3)

    def _turn(self, joints: Array) -> None:
        """Put the kinematics at joint positions, all of the environment's."""
        self._data.qpos[:] = self._qpos
        self._data.qpos[self._addresses] = joints
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)

    def __call__(self, joints: Array, velocity: Array) -> Array:
        """Actions of the torso and the arm, (8,) within [-1, 1].

        Args:
            joints: positions of all of the environment's joints [m, rad].
            velocity: of the grasp point, in the world, (3,) [m/s].
        """
        self._turn(joints)
        jacobian = np.zeros((6, self._model.nv))
        mujoco.mj_jacSite(self._model, self._data, jacobian[:3], jacobian[3:], self._site)
        jacobian = jacobian[:, self._dof] * self._speed
        jacobian[3:] *= self._weight
        now = np.array(self._data.site_xmat[self._site]).reshape(3, 3)
        twist = np.concatenate([velocity, self._weight * GAIN * _rotation(now, self._upright)])
        q = joints[self._columns]
        reach = BRAKE / (self._dt * self._speed)
        low = np.clip((self._low - q) * reach, -1.0, -1e-6)
        high = np.clip((self._high - q) * reach, 1e-6, 1.0)
        home = np.clip((self._posture - q) / self._speed, -1.0, 1.0)
        matrix = np.vstack([jacobian, DAMPING * np.eye(len(q))])
        found = lsq_linear(matrix, np.concatenate([twist, DAMPING * home]), (low, high), method="bvls").x
        return np.clip(found, -1.0, 1.0)  # on its bounds but for rounding


def _rotation(now: Array, wanted: Array) -> Array:
    """The rotation that leads from one orientation to another, (3,) [rad], in the world."""
    quaternion, vector = np.zeros(4), np.zeros(3)
    mujoco.mju_mat2Quat(quaternion, (wanted @ now.T).ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


class Scripted(ABC):
    """The expert of one of the three tasks; :meth:`for_env` makes it.

    They remember nothing within an episode. One instance serves one environment; where the object is drawn, call
    :meth:`reset` after every reset of it.
    """

    #: Of the hand's orientation at the start, see :class:`ResolvedRates`.
    ROTATION_WEIGHT = ROTATION_WEIGHT

    def __init__(self, core: Any) -> None:
        self._rates = ResolvedRates(core, self.ROTATION_WEIGHT)
        self._joints = len(core.joints)
        self._arm = [core.joints.index(name) for name in core.joints if name not in names.FINGERS]
        self._fingers = [core.joints.index(name) for name in names.FINGERS]
        self.reset()

    @staticmethod
    def for_env(env: gymnasium.Env[Any, Any]) -> Scripted:
        """The expert of an environment's task.

        Raises:
            ValueError: the environment is none of the three tasks, or is commanded by position.
        """
        core: Any = env.unwrapped
        expert = EXPERTS.get(type(core))
        if expert is None:
            raise ValueError(
                "there are experts for TIAGoReach, TIAGoPush and TIAGoPickAndPlace only, such as tiago_mj/TIAGoReach-v0"
            )
        if core.control != "velocity":
            raise ValueError("the experts command velocities: make the environment with control='velocity'")
        return expert(core)

    @abstractmethod
    def reset(self) -> None:
        """Look at what this episode has that observations do not show."""

    def __call__(self, observation: dict[str, Array], info: dict[str, Any]) -> NDArray[np.float32]:
        """The action, (10,) float32 within [-1, 1].

        Args:
            observation: of the goal environment.
            info: unused; the same call serves other controllers.
        """
        seen = observation["observation"]
        hand = seen[2 * self._joints : 2 * self._joints + 3]
        velocity, fingers = self._plan(hand, seen, observation["desired_goal"])
        action = np.zeros(self._joints, dtype=np.float32)
        action[self._arm] = self._rates(seen[: self._joints], _limited(velocity))
        action[self._fingers] = fingers
        return action

    @abstractmethod
    def _plan(self, hand: Array, seen: Array, goal: Array) -> tuple[Array, float]:
        """Velocity of the grasp point (3,) [m/s], and the fingers' action."""


class ReachExpert(Scripted):
    """Straight to the goal, the hand's orientation kept where that is easy."""

    ROTATION_WEIGHT = 0.1

    def reset(self) -> None:
        """There is nothing."""

    def _plan(self, hand: Array, seen: Array, goal: Array) -> tuple[Array, float]:
        return GAIN * (goal - hand), 0.0


class _TableExpert(Scripted):
    """What pushing and picking share: the sizes of fingertips and object, the heights to work at, the way there.

    Nothing is remembered within an episode: what to do next follows from what is seen, and one thing goes over into
    the next by a ramp. So a network that sees the same can imitate it (tiago_mj.learn.dagger).
    """

    #: Height of the fingertips over the table while they work, and over the object while they travel [m].
    LOW, OVER = 0.01, 0.025
    #: Horizontal distance at which the hand is down; twice as far off it is up [m].
    NEAR = 0.015

    def __init__(self, core: Any) -> None:
        self._model = core.model
        self._tip = _fingertips(core.model, core.initial_qpos)
        super().__init__(core)

    def reset(self) -> None:
        """Look at the object of this episode."""
        size = self._model.geom_aabb[self._model.geom(names.OBJECT_GEOM).id, 3:]
        self._half_width, self._half_height = float(size[0]), float(size[2])
        self._work = scene.TABLE_TOP + self.LOW + self._tip[2]

    def _object(self, seen: Array) -> Array:
        first = 2 * self._joints + 3
        return seen[first : first + 3]

    def _approach(self, hand: Array, place: Array, work: float) -> Array:
        """Velocity towards a place on the table (2,), high enough to clear the object, and down to ``work`` there."""
        away = _ramp(float(np.linalg.norm(place - hand[:2])), self.NEAR, 2 * self.NEAR)
        clear = work - self.LOW + 2 * self._half_height
        velocity = GAIN * (np.append(place, work + away * (clear + self.OVER - work)) - hand)
        velocity[:2] *= max(1.0 - away, _ramp(hand[2], clear - 0.01, clear + 0.005))  # first up
        return _limited(velocity)


class PushExpert(_TableExpert):
    """Over to the side of the object that is away from the goal, down, and push; again when the object slips away."""

    #: Free space between fingertips and object where the hand goes down [m].
    GAP = 0.015
    #: Fastest push [m/s]: the object slides no farther than v² / 2 µg = 2 mm by itself.
    PUSH = 0.2
    #: Distance from the goal at which the hand rests; twice as far off it goes at full speed [m].
    CLOSE = 0.02

    def _plan(self, hand: Array, seen: Array, goal: Array) -> tuple[Array, float]:
        place, wide = self._object(seen)[:2], self._half_width
        left = goal[:2] - place
        distance = float(np.linalg.norm(left))
        ahead = left / max(distance, 1e-9)
        across = np.array([-ahead[1], ahead[0]])
        behind, beside = float((place - hand[:2]) @ ahead), float((place - hand[:2]) @ across)
        # Whether the hand is in the lane behind the object, and down: there it pushes.
        lane = _ramp(behind, wide / 2, wide) * (1.0 - _ramp(abs(beside), 0.7 * wide, 1.3 * wide))
        lane *= 1.0 - _ramp(hand[2], self._work + 0.008, self._work + 0.02)
        speed = min(self.PUSH, GAIN * distance)
        push = np.append(speed * ahead + GAIN * beside * across, GAIN * (self._work - hand[2]))
        # Far enough that fingertips and object clear each other whichever way the object is turned.
        clear = self._tip[:2] @ np.abs(ahead) + np.sqrt(2) * wide + self.GAP
        velocity = lane * push + (1.0 - lane) * self._approach(hand, place - clear * ahead, self._work)
        return velocity * _ramp(distance, self.CLOSE, 2 * self.CLOSE), 0.0


class PickAndPlaceExpert(_TableExpert):
    """Over the object with open fingers, down, close around it, and carry it to the goal once they stand on it."""

    #: Fingers slower than STANDS stand, and faster than CLOSES they close [m/s]: a quarter and three quarters of the
    #: finger speed that environments have by default. Fingers that are GRIPS and more wider than the object have not
    #: reached it [m].
    STANDS, CLOSES, GRIPS = 0.02, 0.06, 0.001

    def _plan(self, hand: Array, seen: Array, goal: Array) -> tuple[Array, float]:
        place = self._object(seen)
        # As high over the bottom of the object as over the table, or in its middle where the fingertips reach that.
        work = float(place[2]) + max(self.LOW + self._tip[2] - self._half_height, 0.0)
        away = float(np.linalg.norm(place[:2] - hand[:2]))
        around = 1.0 - _ramp(away, self.NEAR, 1.5 * self.NEAR)
        around *= 1.0 - _ramp(abs(hand[2] - work), 0.008, 0.016)
        joints, speeds = seen[: self._joints], seen[self._joints : 2 * self._joints]
        held = around * (1.0 - _ramp(float(joints[self._fingers].mean()) - self._half_width, 0.0, self.GRIPS))
        held *= 1.0 - _ramp(float(np.abs(speeds[self._fingers]).max()), self.STANDS, self.CLOSES)
        over = self._approach(hand, place[:2], work)
        return held * _limited(GAIN * (goal - place)) + (1.0 - held) * over, 1.0 - 2.0 * around


def _ramp(value: float, low: float, high: float) -> float:
    """0 below ``low``, 1 above ``high``, linear in between."""
    return min(max((value - low) / (high - low), 0.0), 1.0)


def _limited(velocity: Array) -> Array:
    """A velocity (3,) [m/s], at most :data:`SPEED` fast."""
    return velocity * min(1.0, SPEED / max(float(np.linalg.norm(velocity)), 1e-9))


def _fingertips(model: mujoco.MjModel, qpos: Array) -> Array:
    """Half sizes of the box around both closed fingertips about the grasp point, along the world's axes, (3,) [m]."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    for finger in names.FINGERS:
        data.joint(finger).qpos = 0.0
    mujoco.mj_kinematics(model, data)
    bodies = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, names.LOAD_CELL_BODY[side]) for side in names.SIDES]
    bodies += [model.body(names.PAD_BODY[side]).id for side in names.SIDES]
    geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] in bodies and model.geom_conaffinity[geom]]
    grasp = data.site(names.GRASP_SITE).xpos
    half = [np.abs(data.geom_xmat[geom].reshape(3, 3)) @ model.geom_aabb[geom, 3:] for geom in geoms]
    low = np.min([data.geom_xpos[geom] - grasp - size for geom, size in zip(geoms, half, strict=True)], axis=0)
    high = np.max([data.geom_xpos[geom] - grasp + size for geom, size in zip(geoms, half, strict=True)], axis=0)
    return np.array([max(-low[0], high[0]), max(-low[1], high[1]), -low[2]])


EXPERTS: Final[dict[type, type[Scripted]]] = {
    Reach: ReachExpert,
    Push: PushExpert,
    PickAndPlace: PickAndPlaceExpert,
}
