"""Bring the hand to a point in space: the counterpart of Fetch's reach task."""

from __future__ import annotations

from typing import Any

import numpy as np

from tiago_mj.envs.choices import Region
from tiago_mj.envs.position_goal import CLOSED, THRESHOLD, Array, PositionGoal
from tiago_mj.envs.state import State

#: 0.15 m to all sides of the pre-grasp pose's grasp point and 0.3 m up; its floor, 0.105 m over the table, leaves room
#: for the forearm: 1000 of 1000 drawn goals are reached without coming closer to the table than at the start
#: (docs/tasks.md).
GOAL_REGION = Region((0.57, -0.07, 0.65), (0.87, 0.23, 0.9))


class Reach(PositionGoal):
    """Bring the point between TIAGo's fingers to a goal in the space above the table.

    ## Description

    The arm is at its pre-grasp pose beside the table, the fingers closed. A goal is drawn around the hand. What is held
    against it is the grasp point, in the middle between the fingers' pads, whatever the hand's orientation.

    ## Action Space

    `Box(-1, 1, (10,), float32)`: each joint's desired velocity over its limit. With `control="position"` a target over
    the joint's range instead. The fingers' entries have no effect: they stay closed, as in the Fetch task.

    | entry | joint | unit | limit |
    |---|---|---|---|
    | 0 | torso_lift_joint | m/s | 0.07 |
    | 1 … 7 | arm_1_joint … arm_7_joint | rad/s | 1.95, 1.95, 2.35, 2.35, 1.95, 1.76, 1.76 |
    | 8, 9 | gripper_right_finger_joint, gripper_left_finger_joint | m/s | (no effect) |

    ## Observation Space

    Dictionary. `observation`, float64:

    | entries | meaning | unit |
    |---|---|---|
    | 0 … 9 | joint positions | m, rad |
    | 10 … 19 | joint velocities | m/s, rad/s |
    | 20 … 22 | grasp point, in the world | m |
    | 23, 24 | with load cells: readings right, left, or 0 and 1 with `force_type="binary"` | sensor units |

    `achieved_goal`: the grasp point. `desired_goal`: the goal; both (3,), in the world [m].

    ## Rewards

    `sparse` (default): 0 in success, else −1. `dense`: −distance to the goal [m]. Success (`info["is_success"]`):
    within `distance_threshold` of the goal.

    ## Starting State

    The pre-grasp pose with closed fingers, at rest. The goal is uniform in x 0.57 to 0.87, y −0.07 to 0.23,
    z 0.65 to 0.90 m; `reset(options={"goal": (x, y, z)})` sets it, within the same bounds.

    ## Episode End

    Never terminates; truncated after 50 steps (2 s, as the Fetch task) by the registered time limit.

    ## Arguments

    See :class:`Reach.__init__` and, for what every environment shares,
    :class:`tiago_mj.envs.arguments.SimulationArguments`; here `control_hz` is 25 and `force_source` is `touch` by
    default,
    so that the cells feel the table.

    ## Version History

    * v0: first.
    """

    START = CLOSED
    FINGERS_HELD = True

    def __init__(
        self,
        *,
        robot: str = "tiago_pal_gripper",
        force_type: str = "none",
        reward_type: str = "sparse",
        distance_threshold: float = THRESHOLD,
        **kwargs: Any,
    ) -> None:
        """Set the task up.

        Args:
            robot: ``tiago_pal_gripper`` or ``tiago_ta11``.
            force_type: what is observed of the forces: ``none``, ``raw`` or ``binary``.
            reward_type: ``sparse`` or ``dense``.
            distance_threshold: distance from the goal that counts as success [m].
            **kwargs: of :class:`RobotEnv`, but ``joints``, ``item`` and ``load_cells``.
        """
        super().__init__(
            workspace=GOAL_REGION,
            item=None,
            robot=robot,
            force_type=force_type,
            reward_type=reward_type,
            distance_threshold=distance_threshold,
            **kwargs,
        )

    def _draw_goal(self, rng: np.random.Generator, object_place: Array) -> Array:
        return self.workspace.draw(rng)

    def _achieved(self, state: State) -> Array:
        return state.grasp_position
