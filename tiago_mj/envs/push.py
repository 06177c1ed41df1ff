"""Push an object across the table: the counterpart of Fetch's push task."""

from __future__ import annotations

from types import MappingProxyType

from tiago_mj.envs.position_goal import ABOVE_TABLE, CLOSED, ObjectToGoal


class Push(ObjectToGoal):
    """Push a cube to a goal on the table with closed fingers.

    ## Description

    The hand points down at the table, above the middle of the region in which a cube and a goal are drawn. The fingers
    stay closed, as in the Fetch task, so the cube can only be pushed.

    ## Action Space

    `Box(-1, 1, (10,), float32)`: each joint's desired velocity over its limit. With `control="position"` a target over
    the joint's range instead. The fingers' entries have no effect.

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

    The hand above the table, pointing down, its grasp point at about (0.65, 0, 0.70) m; fingers closed, at rest. The
    object stands on the table, uniform in x 0.55 to 0.75, y −0.15 to 0.15 m; the goal, at the object's height, is
    uniform in x 0.53 to 0.77, y −0.17 to 0.17 m, at least 0.1 m from the object.
    `reset(options={"goal": (x, y, z)})` sets it.

    ## Episode End

    Never terminates; truncated after 100 steps (4 s) by the registered time limit.

    ## Arguments

    See :class:`tiago_mj.envs.position_goal.ObjectToGoal` and, for what every environment shares,
    :class:`tiago_mj.envs.arguments.SimulationArguments`; here `control_hz` is 25 and `force_source` is `touch` by
    default:
    a push presses on the sides of the fingertips, and has no component along the load cells' axis.

    ## Version History

    * v0: first.
    """

    START = MappingProxyType({**ABOVE_TABLE, **CLOSED})
    FINGERS_HELD = True
