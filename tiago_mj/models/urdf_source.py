"""The URDF sources, written from one table of numbers (``models/sources/numbers.yaml``).

The three robots share most of their links; the table holds each number once, and the URDF files are what other tools
read.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

Table = Mapping[str, Any]

HEADER = (
    " Written from numbers.yaml by python -m tiago_mj.models.build; where each number comes from: ../PROVENANCE.md "
)
_ANGLES = {"pi": math.pi, "-pi": -math.pi, "pi/2": math.pi / 2, "-pi/2": -math.pi / 2}


def read_table(path: Path) -> Table:
    """The table of numbers, as YAML gives it."""
    with path.open(encoding="utf-8") as file:
        table: Table = yaml.safe_load(file)
    return table


def robot_names(table: Table) -> tuple[str, ...]:
    """Names of the robots that the table describes."""
    return tuple(table["robots"])


def urdf_text(table: Table, robot: str) -> str:
    """The URDF of one robot.

    Raises:
        ValueError: the table has no such robot.
    """
    if robot not in table["robots"]:
        raise ValueError(f"no robot {robot!r} in the table; there are {', '.join(robot_names(table))}")
    root = ET.Element("robot", name=robot)
    root.append(ET.Comment(HEADER))
    for name, color in table["colors"].items():
        material = ET.SubElement(root, "material", name=name)
        ET.SubElement(material, "color", rgba=_numbers(color))
    for part in (_part(table, name) for name in table["robots"][robot]):
        for name, link in part.get("links", {}).items():
            _add_link(root, name, link)
        for name, joint in part.get("joints", {}).items():
            _add_joint(root, name, joint)
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _part(table: Table, name: str) -> dict[str, Any]:
    part: dict[str, Any] = table["parts"][name]
    return _turned(table["parts"][part["turned"]]) if "turned" in part else part


def _turned(right: Mapping[str, Any]) -> dict[str, Any]:
    """The left finger's element: the right one rotated by half a turn about the gripper's z axis."""
    left = copy.deepcopy(dict(right))
    finger = left["links"]["gripper_right_finger_link"]
    finger["com"] = _turn(finger["com"])
    ixx, iyy, izz, ixy, ixz, iyz = finger["inertia"]
    finger["inertia"] = [ixx, iyy, izz, ixy, -ixz, -iyz]
    for shape in [*finger.get("collision", ()), *finger.get("visual", ())]:
        shape["pos"] = _turn(shape.get("pos", [0, 0, 0]))
    for joint in left["joints"].values():
        if joint["parent"] == "gripper_link":
            joint["axis"] = _turn(joint["axis"])
        elif joint["parent"] == "gripper_right_finger_link":
            joint["xyz"], joint["rpy"] = _turn(joint["xyz"]), [0, 0, "pi"]
    text = yaml.safe_dump(left, sort_keys=False).replace("right", "left")
    turned: dict[str, Any] = yaml.safe_load(text)
    return turned


def _turn(vector: list[float]) -> list[float]:
    return [-vector[0] + 0.0, -vector[1] + 0.0, vector[2]]  # + 0.0: no minus zero


def _add_link(root: ET.Element, name: str, link: Mapping[str, Any]) -> None:
    element = ET.SubElement(root, "link", name=name)
    if "mass" in link:
        inertial = ET.SubElement(element, "inertial")
        ET.SubElement(inertial, "origin", xyz=_numbers(link["com"]), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=_number(link["mass"]))
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        ET.SubElement(inertial, "inertia", {k: _number(v) for k, v in zip(keys, link["inertia"], strict=True)})
    for kind in ("visual", "collision"):
        for shape in link.get(kind, ()):
            _add_shape(ET.SubElement(element, kind), shape)


def _add_shape(element: ET.Element, shape: Mapping[str, Any]) -> None:
    if "name" in shape:
        element.set("name", shape["name"])
    size, position, rotation = _placed(shape)
    ET.SubElement(element, "origin", xyz=_numbers(position), rpy=_numbers(_rpy(rotation)))
    geometry = ET.SubElement(element, "geometry")
    if "box" in shape:
        ET.SubElement(geometry, "box", size=_numbers(2 * size))
    elif "sphere" in shape:
        ET.SubElement(geometry, "sphere", radius=_number(size[0]))
    else:
        caps = 2 * size[0] if "capsule" in shape else 0.0
        ET.SubElement(geometry, "cylinder", radius=_number(size[0]), length=_number(2 * size[1] + caps))
    if "color" in shape:
        ET.SubElement(element, "material", name=shape["color"])


def _placed(shape: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray, Rotation]:
    """Size (half sizes; radius and half length), position and rotation of a shape."""
    size = next(shape[kind] for kind in ("box", "cylinder", "capsule", "sphere") if kind in shape)
    if isinstance(size, Mapping):
        start, end = np.array(size["from"], dtype=float), np.array(size["to"], dtype=float)
        along = end - start
        length = float(np.linalg.norm(along))
        rotation, _ = Rotation.align_vectors([along / length], [[0.0, 0.0, 1.0]])
        return np.array([size["radius"], length / 2]), (start + end) / 2, rotation
    rotation = Rotation.from_euler("XYZ", shape.get("euler", (0, 0, 0)))
    return np.array(size, dtype=float), np.array(shape.get("pos", (0, 0, 0)), dtype=float), rotation


def _add_joint(root: ET.Element, name: str, joint: Mapping[str, Any]) -> None:
    element = ET.SubElement(root, "joint", name=name, type=joint["type"])
    rpy = [_ANGLES[angle] if isinstance(angle, str) else angle for angle in joint.get("rpy", (0, 0, 0))]
    ET.SubElement(element, "origin", xyz=_numbers(joint["xyz"]), rpy=_numbers(rpy))
    ET.SubElement(element, "parent", link=joint["parent"])
    ET.SubElement(element, "child", link=joint["child"])
    if joint["type"] == "fixed":
        return
    (lower, upper), (soft_lower, soft_upper) = joint["range"], joint["soft"]
    ET.SubElement(element, "axis", xyz=_numbers(joint["axis"]))
    limit = {"lower": lower, "upper": upper, "velocity": joint["velocity"], "effort": joint["effort"]}
    ET.SubElement(element, "limit", {k: _number(v) for k, v in limit.items()})
    ET.SubElement(element, "dynamics", damping=_number(joint["damping"]), friction=_number(joint["friction"]))
    soft = {"soft_lower_limit": soft_lower, "soft_upper_limit": soft_upper, "k_velocity": 0}
    ET.SubElement(element, "safety_controller", {k: _number(v) for k, v in soft.items()})


def _rpy(rotation: Rotation) -> np.ndarray:
    matrix = rotation.as_matrix()
    pitch = math.atan2(-matrix[2, 0], math.hypot(matrix[0, 0], matrix[1, 0]))
    if abs(matrix[2, 0]) > 1 - 1e-12:  # roll and yaw turn about the same axis: all of it is given to yaw
        angles = np.array([0.0, pitch, math.atan2(-matrix[0, 1], matrix[1, 1])])
    else:
        angles = np.array([math.atan2(matrix[2, 1], matrix[2, 2]), pitch, math.atan2(matrix[1, 0], matrix[0, 0])])
    return np.where(np.abs(angles) < 1e-12, 0.0, angles)


def _numbers(values: Any) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    text = f"{float(value) + 0.0:.16g}"
    # Shortest text that means the same to 12 digits, so that 2 * 0.0145 is written 0.029.
    short = f"{float(value) + 0.0:.12g}"
    return short if abs(float(short) - float(value)) <= 1e-15 + 1e-14 * abs(float(value)) else text
