"""What the counterparts of gymnasium-robotics' Fetch tasks share: TIAGo at the table, and a goal that is a position."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.envs.choices import ObjectChoice, Objects, Range, Region, object_choice
from tiago_mj.envs.fixed import Fixed
from tiago_mj.envs.robot_env import FORCE_BOUND, VELOCITY_BOUND, WORLD_BOUND, RobotEnv
from tiago_mj.envs.start import Start
from tiago_mj.envs.state import State
from tiago_mj.io.quoting import is_number, is_one_of, quoted
from tiago_mj.models import names, scene
from tiago_mj.models.objects import GraspObject
from tiago_mj.sensing.columns import columns, joined

Array = NDArray[np.float64]

FORCE_TYPES: Final = ("none", "raw", "binary")
REWARDS: Final = ("sparse", "dense")
ROBOTS: Final = ("tiago_pal_gripper", "tiago_ta11")
#: Rate of the actions [Hz]: the real robot's (llach/learning_fc 3dd34c2), and that of the Fetch tasks.
CONTROL_HZ: Final = 25.0
#: Distance from the goal that counts as success [m], as in the Fetch tasks.
THRESHOLD: Final = 0.05
#: Largest spin that an object can have in the observation space [rad/s]: a cube that slips out of a grasp turns fast.
SPIN_BOUND: Final = 1000.0
#: A wooden cube of 50 mm, 700 kg/m³. The stiffness of its contact is that of the other hard objects.
CUBE: Final = GraspObject(shape="box", width=0.05, height=0.05, mass=0.0875)

#: Hand above the middle of the table's near half, pointing straight down, closing along y: grasp point of the TA11 hand
#: at (0.65, 0, 0.70) m, fingertips 0.13 m above the table. From inverse kinematics on the model, the one of many
#: solutions from which the whole of :data:`TABLE_REGION` is reached without a change of arm configuration and farthest
#: from the soft limits (docs/tasks.md has the margins).
ABOVE_TABLE: Final[Mapping[str, float]] = MappingProxyType(
    dict(zip(names.TIAGO_JOINTS, (0.3, 1.884, 0.585, 0.669, 1.647, -0.771, 0.804, -0.719, 0.045, 0.045), strict=True))
)
#: Fingers that do not take part are closed, as in the Fetch tasks.
CLOSED: Final[Mapping[str, float]] = MappingProxyType(dict.fromkeys(names.FINGERS, 0.0))
#: Where objects start, and where goals lie: x and y around the hand of :data:`ABOVE_TABLE` [m].
OBJECT_REGION: Final = ((0.55, -0.15), (0.75, 0.15))
TABLE_REGION: Final = ((0.53, -0.17), (0.77, 0.17))
#: A drawn goal is at least this far from the object [m]: twice the threshold, so that doing nothing never succeeds.
NOT_THERE_YET: Final = 0.1
#: Highest object [m]: the standard fingers start 0.12 m above the table.
TALLEST: Final = 0.1
#: How far from the height of an object on the table a given goal may be where only goals on the table are possible [m].
TABLE_SLACK: Final = 0.02


class PositionGoal(RobotEnv):
    """TIAGo is to bring something to a place: its own hand, or an object.

    A task names its ``workspace`` and overrides ``_achieved``, ``_draw_goal`` and, with an object, more.
    """

    force_type: Fixed[str] = Fixed()
    reward_type: Fixed[str] = Fixed()

    GOAL_RADIUS = 0.02
    OVERVIEW: Mapping[str, Any] = MappingProxyType(
        {"lookat": np.array([0.5, 0.0, 0.68]), "distance": 1.5, "azimuth": 125, "elevation": -20}
    )

    def __init__(
        self,
        *,
        workspace: Region,
        item: ObjectChoice | None,
        robot: str,
        force_type: str,
        reward_type: str,
        distance_threshold: float,
        control_hz: float = CONTROL_HZ,
        force_source: str = "touch",
        **kwargs: Any,
    ) -> None:
        for name, value, known in (
            ("robot", robot, ROBOTS),
            ("force_type", force_type, FORCE_TYPES),
            ("reward_type", reward_type, REWARDS),
        ):
            if not is_one_of(value, known):
                raise ValueError(f"{name} {quoted(value)} is unknown: use one of {', '.join(known)}")
        if not (is_number(distance_threshold) and distance_threshold > 0):
            raise ValueError(f"distance_threshold is {quoted(distance_threshold)}: give a distance above 0 [m]")
        self.workspace = workspace
        self.force_type = force_type
        self.reward_type = reward_type
        self.distance_threshold = distance_threshold
        super().__init__(
            robot=robot,
            joints=names.TIAGO_JOINTS,
            item=item,
            control_hz=control_hz,
            force_source=force_source,
            load_cells=force_type != "none",
            **kwargs,
        )
        self.goal = np.add(workspace.low, workspace.high) / 2

    def _seen(self, state: State) -> list[Array]:
        """Parts of the observation between the joints and the forces, each (..., n)."""
        return [state.grasp_position]

    def _seen_bound(self) -> list[Array]:
        """Largest magnitudes of :meth:`_seen`."""
        return [np.full(3, WORLD_BOUND)]

    def _observation(self, state: State) -> Array:
        parts = [state.position, state.velocity, *self._seen(state)]
        if self.force_type != "none":
            parts.append(state.force_raw if self.force_type == "raw" else state.force_binary)
        return np.concatenate(parts, axis=-1)

    def _observation_bound(self) -> Array:
        parts = [self._joint_bound(), *self._seen_bound()]
        if self.force_type != "none":
            # An arm presses with some 500 N, and the load cell's curve may be bent: x + x² (force_nonlinearity).
            reading = self.load_cell.units(FORCE_BOUND)
            parts.append(np.full(2, reading + reading**2))
        return np.concatenate(parts)

    def _goal_bound(self) -> Array:
        return np.full(3, WORLD_BOUND)

    def _checked_goal(self, goal: Any) -> Array:
        values = super()._checked_goal(goal)
        if values not in self.workspace:
            raise ValueError(f"goal {values.tolist()} is outside the workspace: give {self.workspace}")
        return values

    def _reward_terms(self, achieved: Array, desired: Array) -> dict[str, Array]:
        if self.reward_type == "sparse":
            return {"success": self._is_success(achieved, desired) - 1.0}
        return {"distance": -distance(achieved, desired)}

    def _is_success(self, achieved_goal: Array, desired_goal: Array) -> Any:
        within = distance(achieved_goal, desired_goal) < self.distance_threshold
        return within if isinstance(within, np.ndarray) else bool(within)

    def _render_callback(self) -> None:
        site = self.model.site(scene.GOAL_SITE).id
        # The world's site, moved where it is drawn: the simulation's state is not touched.
        self.model.site_pos[site] = self.data.site_xpos[site] = self.goal


class ObjectToGoal(PositionGoal):
    """TIAGo is to bring an object on the table to a goal; its hand starts above the table.

    Args:
        robot: ``tiago_pal_gripper`` or ``tiago_ta11``.
        force_type: what is observed of the forces: ``none``, ``raw`` or ``binary``.
        reward_type: ``sparse`` or ``dense``.
        distance_threshold: distance from the goal that counts as success [m].
        object: name(s) in :data:`tiago_mj.models.objects.OBJECTS` or objects, at most 0.1 m high; several are drawn
            from. A wooden cube of 50 mm by default.
        object_width, object_mass, object_stiffness, object_damping: [m], [kg], [N/m], [N·s/m], each one number or
            (low, high); None keeps the object's own.
        **kwargs: of :class:`RobotEnv`, but ``joints``, ``item`` and ``load_cells``.
    """

    START = ABOVE_TABLE
    #: Highest goal above the height of an object on the table [m].
    LIFT = 0.0

    def __init__(
        self,
        *,
        robot: str = "tiago_pal_gripper",
        force_type: str = "none",
        reward_type: str = "sparse",
        distance_threshold: float = THRESHOLD,
        object: Objects = CUBE,
        object_width: Range | None = None,
        object_mass: Range | None = None,
        object_stiffness: Range | None = None,
        object_damping: Range | None = None,
        **kwargs: Any,
    ) -> None:
        common = {
            "robot": robot,
            "force_type": force_type,
            "reward_type": reward_type,
            "distance_threshold": distance_threshold,
            **kwargs,
        }
        choice = object_choice(
            object, width=object_width, mass=object_mass, stiffness=object_stiffness, damping=object_damping
        )
        heights = [kind.height for kind in choice.kinds]
        if max(heights) > TALLEST:
            raise ValueError(f"an object {max(heights):.4g} m high meets the hand: give one at most {TALLEST} m high")
        low, high = TABLE_REGION
        self._place = np.add(*OBJECT_REGION) / 2
        super().__init__(
            item=choice,
            workspace=Region(
                (*low, scene.TABLE_TOP + min(heights) / 2 - TABLE_SLACK),
                (*high, scene.TABLE_TOP + max(heights) / 2 + max(self.LIFT, TABLE_SLACK)),
            ),
            **common,
        )

    def _draw_start(self, rng: np.random.Generator) -> Start | None:
        self._place = rng.uniform(*OBJECT_REGION)
        return super()._draw_start(rng)

    def _grasp_frame(self) -> None:
        super()._grasp_frame()
        self._object_orientation = np.array([1.0, 0.0, 0.0, 0.0])  # a box's sides along the world's axes

    def _object_position(self, offset: float) -> Array:
        return self._place

    def _draw_goal(self, rng: np.random.Generator, object_place: Array) -> Array:
        goal = object_place
        while np.linalg.norm(goal - object_place) < NOT_THERE_YET:
            goal = self._any_goal(rng, float(object_place[2]))
        return goal

    def _any_goal(self, rng: np.random.Generator, height: float) -> Array:
        """Any goal, (3,) [m], with an object whose middle is at ``height`` [m] when it stands on the table."""
        return np.append(rng.uniform(*TABLE_REGION), height)

    def _achieved(self, state: State) -> Array:
        return state.object_pose[..., :3]

    def _seen(self, state: State) -> list[Array]:
        place = state.object_pose[..., :3]
        return [
            state.grasp_position,
            place,
            place - state.grasp_position,
            roll_pitch_yaw(state.object_pose[..., 3:]),
            state.object_velocity,
        ]

    def _seen_bound(self) -> list[Array]:
        world = np.full(3, WORLD_BOUND)
        return [world, world, 2 * world, np.full(3, np.pi), np.full(3, VELOCITY_BOUND), np.full(3, SPIN_BOUND)]


def distance(place: Array, other: Array) -> Any:
    """Between places (..., 3) [m], (...)."""
    x, y, z = (one - there for one, there in zip(columns(place), columns(other), strict=True))
    return np.sqrt(x * x + y * y + z * z)


def roll_pitch_yaw(quaternion: Array) -> Array:
    """Rotations about the world's x, then y, then z axis that make the orientation, (..., 3) [rad]."""
    w, x, y, z = columns(quaternion)
    return joined(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.minimum(np.maximum(2 * (w * y - z * x), -1.0), 1.0)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ]
    )
