"""Grasp an object, and bring it to a goal on or above the table: the counterpart of Fetch's pick-and-place task."""

from __future__ import annotations

from typing import Final

import numpy as np

from tiago_mj.envs.position_goal import Array, ObjectToGoal

#: Share of the goals that are above the table, as in the Fetch task.
IN_THE_AIR: Final = 0.5


class PickAndPlace(ObjectToGoal):
    """Grasp a cube and bring it to a goal on the table or in the air.

    ## Description

    The hand points down at the table with open fingers, above the middle of the region in which a cube and a goal are
    drawn. Half of the goals are above the table, so that the cube has to be grasped.

    ## Action Space

    `Box(-1, 1, (10,), float32)`: each joint's desired velocity over its limit. With `control="position"` a target over
    the joint's range instead. Negative closes a finger.

    | entry | joint | unit | limit |
    |---|---|---|---|
    | 0 | torso_lift_joint | m/s | 0.07 |
    | 1 … 7 | arm_1_joint … arm_7_joint | rad/s | 1.95, 1.95, 2.35, 2.35, 1.95, 1.76, 1.76 |
    | 8, 9 | gripper_right_finger_joint, gripper_left_finger_joint | m/s | `finger_speed`, 0.08 by default |

    ## Observation Space

    Dictionary. `observation`, float64:

    | entries | meaning | unit |
    |---|---|---|
    | 0 … 9 | joint positions | m, rad |
    | 10 … 19 | joint velocities | m/s, rad/s |
    | 20 … 22 | grasp point, in the world | m |
    | 23 … 25 | middle of the object, in the world | m |
    | 26 … 28 | middle of the object less grasp point | m |
    | 29 … 31 | object's roll, pitch, yaw | rad |
    | 32 … 34 | object's linear velocity, in the world | m/s |
    | 35 … 37 | object's angular velocity, in its own frame | rad/s |
    | 38, 39 | with load cells: readings right, left, or 0 and 1 with `force_type="binary"` | sensor units |

    `achieved_goal`: the middle of the object. `desired_goal`: the goal; both (3,), in the world [m].

    ## Rewards

    `sparse` (default): 0 in success, else −1. `dense`: −distance to the goal [m]. Success (`info["is_success"]`): the
    object within `distance_threshold` of the goal.

    ## Starting State

    The hand above the table, pointing down, its grasp point at about (0.65, 0, 0.70) m; fingers open at 45 mm, at rest.
    The object stands on the table, uniform in x 0.55 to 0.75, y −0.15 to 0.15 m. The goal is uniform in x 0.53 to 0.77,
    y −0.17 to 0.17 m, at least 0.1 m from the object; half of the goals are at the height of an object on the table,
    the others uniform up to 0.2 m above it. `reset(options={"goal": (x, y, z)})` sets it.

    ## Episode End

    Never terminates; truncated after 100 steps (4 s) by the registered time limit.

    ## Arguments

    See :class:`tiago_mj.envs.position_goal.ObjectToGoal` and, for what every environment shares,
    :class:`tiago_mj.envs.arguments.SimulationArguments`; here `control_hz` is 25 and `force_source` is `touch` by
    default.

    ## Version History

    * v0: first.
    """

    LIFT = 0.2

    def _any_goal(self, rng: np.random.Generator, height: float) -> Array:
        goal = super()._any_goal(rng, height)
        if rng.uniform() < IN_THE_AIR:
            goal[2] += rng.uniform(0.0, self.LIFT)
        return goal
