"""Bring the fingers to a position: no object, no forces."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.envs.choices import Range, interval
from tiago_mj.envs.fixed import Fixed
from tiago_mj.envs.robot_env import RobotEnv
from tiago_mj.envs.state import State
from tiago_mj.io.quoting import is_number, is_one_of, quoted
from tiago_mj.models import names
from tiago_mj.sensing.columns import columns

Array = NDArray[np.float64]

REWARDS: Final = ("dense", "sparse")
#: The fingers' travel [m] (2021 URDF).
TRAVEL: Final = 0.045


class GripperClose(RobotEnv):
    """Bring both fingers of the open gripper to a goal position.

    ## Description

    The simplest task of the family (the 2021 project's GripperCloseEnv): nothing between the fingers, nothing to feel.

    ## Action Space

    `Box(-1, 1, (2,), float32)`: desired velocity of the right and left finger over `finger_speed`.

    ## Observation Space

    Dictionary. `observation`, float64:

    | entries | meaning | unit |
    |---|---|---|
    | 0, 1 | finger positions right, left | m |
    | 2, 3 | finger velocities | m/s |
    | 4, 5 | finger positions again; of the flat id the distance to the goal | m |

    `achieved_goal`: positions right, left [m]. `desired_goal`: the goal, twice [m].

    ## Rewards

    `dense` (default): −Σ_i |q_i − q_goal| / 0.045 m. `sparse`: 0 in success, else −1. Success: both within `tolerance`.

    ## Starting State

    Fingers open at 45 mm, at rest.

    ## Episode End

    Never terminates; truncated after 300 steps by the registered time limit.

    ## Arguments

    See :class:`GripperClose.__init__` and :class:`tiago_mj.envs.arguments.SimulationArguments`.

    ## Version History

    * v0: first.
    """

    reward_type: Fixed[str] = Fixed()

    def __init__(
        self,
        *,
        goal: Range = 0.0,
        reward_type: str = "dense",
        tolerance: float = 0.001,
        robot: str = "gripper_ta11",
        **kwargs: Any,
    ) -> None:
        """Set the task up.

        Args:
            goal: finger position, 0 (closed) to 0.045 [m], or (low, high) to draw it at every reset.
            reward_type: ``dense`` or ``sparse``.
            tolerance: distance that counts as success [m].
            robot: ``gripper_ta11``.
            **kwargs: of :class:`RobotEnv`.
        """
        if not is_one_of(reward_type, REWARDS):
            raise ValueError(f"reward_type {quoted(reward_type)} is unknown: use one of {', '.join(REWARDS)}")
        if not (is_number(tolerance) and tolerance > 0):
            raise ValueError(f"tolerance is {quoted(tolerance)}: give a distance above 0 [m]")
        self.reward_type = reward_type
        self.tolerance = tolerance
        self._goal_choice = interval("goal", goal, unit="m")
        for bound in (self._goal_choice.low, self._goal_choice.high):
            self._check_reachable(bound)
        super().__init__(robot=robot, joints=names.FINGERS, item=None, **kwargs)
        self.goal = np.full(2, self._goal_choice.low)

    @staticmethod
    def _check_reachable(goal: float) -> None:
        if not 0 <= goal <= TRAVEL:
            raise ValueError(f"goal {goal:.6g} m is out of range: the fingers move from 0 to {TRAVEL} m")

    def _checked_goal(self, goal: Any) -> Array:
        values = super()._checked_goal(goal)
        for value in values:
            self._check_reachable(float(value))
        return values

    def _draw_goal(self, rng: np.random.Generator, object_place: Array) -> Array:
        return np.full(2, self._goal_choice.draw(rng))

    def _observation(self, state: State) -> Array:
        return np.concatenate([state.position, state.velocity, state.position], axis=-1)

    def _observation_bound(self) -> Array:
        return np.concatenate([self._joint_bound(), self._goal_bound()])

    def _goal_bound(self) -> Array:
        return self._joint_bound()[:2]

    def _achieved(self, state: State) -> Array:
        return state.position

    def _reward_terms(self, achieved: Array, desired: Array) -> dict[str, Array]:
        if self.reward_type == "sparse":
            return {"success": self._is_success(achieved, desired) - 1.0}
        (right, left), (right_goal, left_goal) = columns(achieved), columns(desired)
        return {"distance": -(abs(right - right_goal) + abs(left - left_goal)) / TRAVEL}

    def _is_success(self, achieved_goal: Array, desired_goal: Array) -> Any:
        (right, left), (right_goal, left_goal) = columns(achieved_goal), columns(desired_goal)
        both = (abs(right - right_goal) < self.tolerance) & (abs(left - left_goal) < self.tolerance)
        return both if isinstance(both, np.ndarray) else bool(both)
