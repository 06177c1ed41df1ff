"""Names of the robot's parts: one place, the order of every array.

Joints, and the actuators named after them, keep their URDF names (shared by the 2021 model and the real robot's
``/joint_states``). Every per-finger array in the package is ordered right, left, as in the paper's observation.
"""

from __future__ import annotations

from typing import Final

TORSO: Final = ("torso_lift_joint",)
ARM: Final = tuple(f"arm_{i}_joint" for i in range(1, 8))
FINGERS: Final = ("gripper_right_finger_joint", "gripper_left_finger_joint")
TIAGO_JOINTS: Final = TORSO + ARM + FINGERS

SIDES: Final = ("right", "left")

#: Per side: the body that carries the pad, the pad's collision geom, the site that encloses it (``touch``), the site
#: of the load cell (its x axis is the measuring axis and points out of the pad's face: a pressed pad reads positive),
#: the sensors.
PAD_BODY: Final = {side: f"{side}_fingertip_link" for side in SIDES}
LOAD_CELL_BODY: Final = {side: f"{side}_load_cell_link" for side in SIDES}
PAD_GEOM: Final = {side: f"{side}_pad" for side in SIDES}
PAD_SITE: Final = {side: f"{side}_pad" for side in SIDES}
LOAD_CELL_SITE: Final = {side: f"{side}_load_cell" for side in SIDES}
TOUCH_SENSOR: Final = {side: f"{side}_touch" for side in SIDES}
FORCE_SENSOR: Final = {side: f"{side}_load_cell_force" for side in SIDES}
CONTACT_SENSOR: Final = {side: f"{side}_contact" for side in SIDES}
AXIS_SENSOR: Final = {side: f"{side}_pad_axis" for side in SIDES}

#: Middle between the pads, at their height: where an object is grasped.
GRASP_SITE: Final = "gripper_grasping_frame"
GRASP_SENSOR: Final = "grasp_position"
GRIPPER_BODY: Final = "gripper_link"

OBJECT_BODY: Final = "object"
OBJECT_JOINT: Final = "object_joint"
OBJECT_GEOM: Final = "object"
TABLE_GEOM: Final = "table"
