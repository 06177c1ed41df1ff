"""Hold a goal force with both fingers: the paper's task, on the gripper, on TIAGo, and without load cells."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.envs.choices import Objects, Range, interval, object_choice
from tiago_mj.envs.fixed import Fixed
from tiago_mj.envs.robot_env import FORCE_BOUND, RobotEnv
from tiago_mj.envs.state import State
from tiago_mj.io.quoting import is_one_of, quoted
from tiago_mj.models import names
from tiago_mj.sensing.columns import columns
from tiago_mj.sensing.load_cell import GOAL_NEWTONS

Array = NDArray[np.float64]

FORCE_TYPES: Final = ("raw", "binary", "none")
REWARDS: Final = ("dense", "normalised", "sparse")
#: The fingers' effort limit [N] (2021 URDF): no goal above it can be held.
FINGER_EFFORT: Final = 16.0
#: Farthest from the goal that counts as success: 5 standard deviations of a reading, as in the 2021 code (master).
SUCCESS_DEVIATIONS: Final = 5.0


class HoldForce(RobotEnv):
    """Close on an object and hold a goal force with both fingers.

    ## Description

    A gripper stands open around an object that is nearer to one finger. The agent commands joint velocities and is
    rewarded for every step by how close both load-cell readings are to the goal force (paper, section III).

    ## Action Space

    `Box(-1, 1, (N,), float32)`: each joint's desired velocity over its limit, in the order of `joints`; negative closes
    a finger. With `control="position"` a target over the joint's range instead.

    | joint | unit | limit |
    |---|---|---|
    | torso_lift_joint (TIAGo) | m/s | 0.07 |
    | arm_1_joint … arm_7_joint (TIAGo) | rad/s | 1.95, 1.95, 2.35, 2.35, 1.95, 1.76, 1.76 |
    | gripper_right_finger_joint, gripper_left_finger_joint | m/s | `finger_speed`, 0.08 by default |

    ## Observation Space

    A dictionary (the goal form). `observation`, float64:

    | entries | meaning | unit |
    |---|---|---|
    | 0 … N-1 | joint positions | m, rad |
    | N … 2N-1 | joint velocities | m/s, rad/s |
    | 2N, 2N+1 | force right, left: readings, or 0, 1 if `force_type="binary"`; absent if `"none"` | sensor units |

    `achieved_goal`: the readings right, left (always raw). `desired_goal`: the goal, twice.

    The ids without `Goal` give the paper's flat observation (q, q̇, Δf_right, Δf_left) instead,
    Δf = force − goal, see :class:`tiago_mj.envs.flat.FlatView`.

    ## Rewards

    `dense` (default): −Σ_i |f_i − f_goal| (paper, section III-D). `normalised`: the same over 2 · goal, so that no
    contact costs 1 a step. `sparse`: 0 in success, else −1. Success (`info["is_success"]`): both readings within 5
    standard deviations of the sensor's noise of the goal.

    ## Starting State

    The pre-grasp pose, fingers open at 45 mm, at rest; the object on the table between the fingers.

    ## Episode End

    Never terminates; truncated after 300 steps by the registered time limit.

    ## Arguments

    See :class:`HoldForce.__init__` and, for what every environment shares,
    :class:`tiago_mj.envs.arguments.SimulationArguments`.

    ## Version History

    * v0: first.
    """

    force_type: Fixed[str] = Fixed()
    reward_type: Fixed[str] = Fixed()

    def __init__(
        self,
        *,
        robot: str = "gripper_ta11",
        joints: tuple[str, ...] = names.FINGERS,
        force_type: str = "raw",
        reward_type: str = "dense",
        goal: Range | None = None,
        object: Objects = "cylinder",
        object_width: Range | None = None,
        object_mass: Range | None = None,
        object_stiffness: Range | None = None,
        object_damping: Range | None = None,
        object_offset: Range = 0.005,
        **kwargs: Any,
    ) -> None:
        """Set the task up.

        Args:
            robot, joints: which robot, and what of it is commanded and observed.
            force_type: what is observed of the forces: ``raw``, ``binary`` or ``none``. Without it the
                reward is computed from noise-free readings, as there is no sensor to be noisy.
            reward_type: ``dense``, ``normalised`` or ``sparse``.
            goal: force to hold [sensor units], or (low, high) to draw it at every reset. None: 6.06 N per finger, which
                is the paper's 1.0 with the default sensing.
            object: name(s) in :data:`tiago_mj.models.objects.OBJECTS`, objects, or dictionaries that describe them
                (:data:`tiago_mj.models.objects.KEYS`); several are drawn from.
            object_width, object_mass, object_stiffness, object_damping: [m], [kg], [N/m], [N·s/m], each one number or
                (low, high); None keeps the object's own.
            object_offset: along the grasp axis, positive towards the left finger [m], one number or (low, high).
            **kwargs: of :class:`RobotEnv`.
        """
        for name, value, known in (("force_type", force_type, FORCE_TYPES), ("reward_type", reward_type, REWARDS)):
            if not is_one_of(value, known):
                raise ValueError(f"{name} {quoted(value)} is unknown: use one of {', '.join(known)}")
        self.force_type = force_type
        self.reward_type = reward_type
        choice = object_choice(
            object,
            width=object_width,
            mass=object_mass,
            stiffness=object_stiffness,
            damping=object_damping,
            offset=object_offset,
        )
        super().__init__(robot=robot, joints=joints, item=choice, **kwargs)
        default = round(self.load_cell.units(GOAL_NEWTONS), 12)
        self._goal_choice = interval("goal", default if goal is None else goal, unit="sensor units")
        self._check_reachable(self._goal_choice.low)
        self._check_reachable(self._goal_choice.high)
        self.tolerance = SUCCESS_DEVIATIONS * float(self.load_cell.noises.max())
        self.goal = np.full(2, self._goal_choice.low)

    def _check_reachable(self, goal: float) -> None:
        highest = self.load_cell.units(FINGER_EFFORT)
        if not 0 < goal <= highest:
            raise ValueError(
                f"goal {goal:.6g} is out of range: with this load cell the fingers' {FINGER_EFFORT:g} N are "
                f"{highest:.6g} sensor units; give a goal above 0, at most that"
            )

    def _checked_goal(self, goal: Any) -> Array:
        values = super()._checked_goal(goal)
        for value in values:
            self._check_reachable(float(value))
        return values

    def _draw_goal(self, rng: np.random.Generator, object_place: Array) -> Array:
        return np.full(2, self._goal_choice.draw(rng))

    def _forces(self, state: State) -> Array | None:
        """What the agent sees of the forces, (..., 2), or None."""
        kind = self.force_type
        if kind == "none":
            return None
        return state.force_raw if kind == "raw" else state.force_binary

    def _observation(self, state: State) -> Array:
        forces = self._forces(state)
        seen = (state.position, state.velocity) if forces is None else (state.position, state.velocity, forces)
        return np.concatenate(seen, axis=-1)

    def _observation_bound(self) -> Array:
        joints = self._joint_bound()
        return joints if self.force_type == "none" else np.concatenate([joints, self._goal_bound()])

    def _goal_bound(self) -> Array:
        return np.full(2, self.load_cell.units(FORCE_BOUND))

    def _achieved(self, state: State) -> Array:
        if self.force_type == "none":
            return self.load_cell.sample(state.force_contact, np.zeros(()))
        return state.force_raw

    def _reward_terms(self, achieved: Array, desired: Array) -> dict[str, Array]:
        kind = self.reward_type
        if kind == "sparse":
            return {"success": self._is_success(achieved, desired) - 1.0}
        if kind == "normalised":
            right, left = columns(np.abs(achieved - desired) / (2 * desired))
            return {"force": -(right + left)}
        (right, left), (right_goal, left_goal) = columns(achieved), columns(desired)
        return {"force": -(abs(right - right_goal) + abs(left - left_goal))}

    def _is_success(self, achieved_goal: Array, desired_goal: Array) -> Any:
        (right, left), (right_goal, left_goal) = columns(achieved_goal), columns(desired_goal)
        both = (abs(right - right_goal) < self.tolerance) & (abs(left - left_goal) < self.tolerance)
        return both if isinstance(both, np.ndarray) else bool(both)
