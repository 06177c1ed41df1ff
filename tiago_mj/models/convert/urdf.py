"""A URDF as plain data: read, with every fault named by file, line and element.

Nothing is repaired here and no mesh is opened; :mod:`~tiago_mj.models.convert.tree` checks how the links hang together.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from tiago_mj.models.bounded import BODIES
from tiago_mj.models.convert import xml_lines
from tiago_mj.models.convert.errors import ConversionError

Array = NDArray[np.float64]
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
SHAPES = ("box", "cylinder", "sphere", "capsule", "mesh")


@dataclass(frozen=True)
class Pose:
    """Position [m] and fixed-axis roll, pitch, yaw [rad], as URDF writes them."""

    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Inertial:
    """Mass [kg] and inertia [kg m2] (3, 3) about the centre of mass, in the frame ``pose`` of the link."""

    pose: Pose
    mass: float
    inertia: Array


@dataclass(frozen=True)
class Shape:
    """A visual or collision shape. ``size`` as URDF gives it: full box sizes; radius and length; radius; mesh scale."""

    name: str | None
    kind: str
    size: tuple[float, ...]
    pose: Pose
    mesh: str | None = None
    rgba: tuple[float, ...] | None = None
    where: str = ""


@dataclass(frozen=True)
class Link:
    """A link with its shapes; ``inertial`` is None where the file gives none."""

    name: str
    inertial: Inertial | None
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]
    where: str


@dataclass(frozen=True)
class Mimic:
    """This joint = multiplier * the other joint + offset."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint. Limits are None where the file gives none [m or rad; per s; N or N m]."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: tuple[float, ...]
    where: str
    range: tuple[float, float] | None = None
    velocity: float | None = None
    effort: float | None = None
    damping: float = 0.0
    friction: float = 0.0
    soft: tuple[float, float] | None = None
    mimic: Mimic | None = None


@dataclass(frozen=True)
class Urdf:
    """A robot: links and joints by name, in the order of the file."""

    name: str
    path: Path
    links: dict[str, Link]
    joints: dict[str, Joint]
    ignored: dict[str, int]  # other elements of the robot, by tag: how many


def read(path: Path) -> Urdf:
    """Read a URDF file.

    Raises:
        ConversionError: one line that names the file, the line, the element and the mend.
    """
    root, lines = xml_lines.parse(path)
    return _Reader(path, lines).robot(root)


class _Reader:
    """Reads elements; knows the file and the lines so that every fault can be located."""

    def __init__(self, path: Path, lines: xml_lines.Lines) -> None:
        self.path, self.lines = path, lines
        self.colors: dict[str, tuple[float, ...]] = {}

    def where(self, element: ET.Element, owner: str = "") -> str:
        name = element.get("name")
        tag = f'<{element.tag} name="{name}">' if name else f"<{element.tag}>"
        return f"{self.path}:{self.lines[element]}: {tag}{' of ' + owner if owner else ''}"

    def robot(self, root: ET.Element) -> Urdf:
        if root.tag != "robot":
            what = f"the root element is <{root.tag}>, not <robot>"
            mend = "run xacro on it first" if "xacro" in root.tag else "give a URDF file"
            raise ConversionError(f"{self.path}:{self.lines[root]}", what, mend)
        for element in root.iter():
            if "xacro" in element.tag:
                raise ConversionError(self.where(element), "is a xacro element", "run xacro on the file first")
        for material in root.iter("material"):
            color = material.find("color")
            if color is not None and material.get("name"):
                self.colors.setdefault(material.get("name", ""), self.vector(color, "rgba", 4, "material"))
        links: dict[str, Link] = {}
        if (count := len(root.findall("link"))) > BODIES:
            raise ConversionError(str(self.path), f"has {count} links", f"give a robot of {BODIES} links at most")
        for element in root.findall("link"):
            link = self.link(element)
            if link.name in links:
                raise ConversionError(link.where, "a second link of this name", "rename one of them")
            links[link.name] = link
        joints: dict[str, Joint] = {}
        for element in root.findall("joint"):
            joint = self.joint(element)
            if joint.name in joints:
                raise ConversionError(joint.where, "a second joint of this name", "rename one of them")
            joints[joint.name] = joint
        if not links:
            raise ConversionError(f"{self.path}", "has no <link>", "give a URDF with at least one link")
        ignored = Counter(element.tag for element in root if element.tag not in ("link", "joint", "material"))
        return Urdf(root.get("name") or self.path.stem, self.path, links, joints, dict(ignored))

    def link(self, element: ET.Element) -> Link:
        name = self.text(element, "name")
        inertial = element.find("inertial")
        return Link(
            name=name,
            inertial=None if inertial is None else self.inertial(inertial, f'link "{name}"'),
            visuals=tuple(self.shape(v, f'link "{name}"') for v in element.findall("visual")),
            collisions=tuple(self.shape(c, f'link "{name}"') for c in element.findall("collision")),
            where=self.where(element),
        )

    def inertial(self, element: ET.Element, owner: str) -> Inertial:
        mass = self.number(self.child(element, "mass", owner), "value", owner)
        if mass < 0:
            raise ConversionError(
                self.where(element, owner), f"negative mass {mass:g} kg", "give a mass of zero or more"
            )
        tensor = element.find("inertia")
        if tensor is None and mass > 0:
            what = f"has a mass of {mass:g} kg and no <inertia>"
            raise ConversionError(self.where(element, owner), what, "add <inertia ixx= iyy= izz= ixy= ixz= iyz=>")
        if tensor is None:
            return Inertial(self.pose(element, owner), 0.0, np.zeros((3, 3)))
        xx, yy, zz = (self.number(tensor, key, owner) for key in ("ixx", "iyy", "izz"))
        xy, xz, yz = (self.number(tensor, key, owner, 0.0) for key in ("ixy", "ixz", "iyz"))
        return Inertial(self.pose(element, owner), mass, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))

    def shape(self, element: ET.Element, owner: str) -> Shape:
        geometry = self.child(element, "geometry", owner)
        found = [child for child in geometry if child.tag in SHAPES]
        if len(found) != 1:
            what = f"holds {len(found)} shapes where one is needed"
            raise ConversionError(self.where(geometry, owner), what, f"give one of {', '.join(SHAPES)}")
        (body,) = found
        mesh = None
        if body.tag == "box":
            size = self.vector(body, "size", 3, owner)
        elif body.tag == "sphere":
            size = (self.number(body, "radius", owner),)
        elif body.tag == "mesh":
            mesh = self.text(body, "filename", owner)
            size = self.vector(body, "scale", 3, owner, (1.0, 1.0, 1.0))
        else:
            size = (self.number(body, "radius", owner), self.number(body, "length", owner))
        if (body.tag != "mesh" and min(size) <= 0) or 0 in size:
            what = f"has a size that is not positive ({' '.join(f'{s:g}' for s in size)})"
            raise ConversionError(self.where(body, owner), what, "give sizes above zero")
        name = element.get("name")
        return Shape(
            name, body.tag, size, self.pose(element, owner), mesh, self.color(element), self.where(body, owner)
        )

    def color(self, element: ET.Element) -> tuple[float, ...] | None:
        material = element.find("material")
        if material is None:
            return None
        color = material.find("color")
        return self.colors.get(material.get("name", "")) if color is None else self.vector(color, "rgba", 4, "material")

    def joint(self, element: ET.Element) -> Joint:
        name, kind = self.text(element, "name"), self.text(element, "type")
        owner, where = f'joint "{name}"', self.where(element)
        if kind not in JOINT_TYPES:
            raise ConversionError(where, f'type "{kind}" does not exist', f"use one of {', '.join(JOINT_TYPES)}")
        axis_element = element.find("axis")
        axis = (1.0, 0.0, 0.0) if axis_element is None else self.vector(axis_element, "xyz", 3, owner)
        if kind in ("revolute", "continuous", "prismatic") and math.hypot(*axis) < 1e-9:
            raise ConversionError(where, "has a zero axis", 'give a direction, such as <axis xyz="0 0 1"/>')
        return Joint(
            name=name,
            kind=kind,
            parent=self.text(self.child(element, "parent", owner), "link", owner),
            child=self.text(self.child(element, "child", owner), "link", owner),
            pose=self.pose(element, owner),
            axis=axis,
            where=where,
            **self.limits(element, kind, owner),
        )

    def limits(self, element: ET.Element, kind: str, owner: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        limit = element.find("limit")
        if limit is None and kind in ("revolute", "prismatic"):
            what = f"is {kind} and has no <limit>"
            raise ConversionError(
                self.where(element), what, 'add <limit lower= upper= effort= velocity=> or type "continuous"'
            )
        if limit is not None:
            if kind in ("revolute", "prismatic"):
                low, high = self.number(limit, "lower", owner, 0.0), self.number(limit, "upper", owner, 0.0)
                if low > high:
                    what = f"lower limit {low:g} is above the upper {high:g}"
                    raise ConversionError(self.where(limit, owner), what, "swap them")
                found["range"] = (low, high)
            found["velocity"] = self.positive(limit, "velocity", owner)
            found["effort"] = self.positive(limit, "effort", owner)
        dynamics = element.find("dynamics")
        if dynamics is not None:
            found["damping"] = self.number(dynamics, "damping", owner, 0.0)
            found["friction"] = self.number(dynamics, "friction", owner, 0.0)
        safety = element.find("safety_controller")
        if safety is not None and safety.get("soft_lower_limit") is not None:
            found["soft"] = tuple(self.number(safety, f"soft_{side}_limit", owner) for side in ("lower", "upper"))
        mimic = element.find("mimic")
        if mimic is not None:
            factor, offset = self.number(mimic, "multiplier", owner, 1.0), self.number(mimic, "offset", owner, 0.0)
            found["mimic"] = Mimic(self.text(mimic, "joint", owner), factor, offset)
        return found

    def positive(self, element: ET.Element, key: str, owner: str) -> float | None:
        """A limit; None where it is missing or zero, which URDF authors write for "none"."""
        value = self.number(element, key, owner, 0.0)
        if value < 0:
            raise ConversionError(self.where(element, owner), f'{key}="{value:g}" is negative', "give its magnitude")
        return value or None

    def pose(self, element: ET.Element, owner: str) -> Pose:
        origin = element.find("origin")
        if origin is None:
            return Pose()
        return Pose(self.vector(origin, "xyz", 3, owner, (0.0,) * 3), self.vector(origin, "rpy", 3, owner, (0.0,) * 3))

    def child(self, element: ET.Element, tag: str, owner: str) -> ET.Element:
        child = element.find(tag)
        if child is None:
            raise ConversionError(
                self.where(element, "" if element.get("name") else owner), f"has no <{tag}>", "add it"
            )
        return child

    def text(self, element: ET.Element, key: str, owner: str = "") -> str:
        text = element.get(key)
        if not text:
            raise ConversionError(self.where(element, owner), f'has no attribute "{key}"', "add it")
        return text

    def number(self, element: ET.Element, key: str, owner: str, default: float | None = None) -> float:
        if element.get(key) is None and default is not None:
            return default
        return self.vector(element, key, 1, owner)[0]

    def vector(
        self, element: ET.Element, key: str, count: int, owner: str, default: tuple[float, ...] | None = None
    ) -> tuple[float, ...]:
        if element.get(key) is None and default is not None:
            return default
        text = self.text(element, key, owner)
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)):
            wanted = "a number" if count == 1 else f"{count} numbers"
            raise ConversionError(self.where(element, owner), f'{key}="{text}" is not {wanted}', f"give {wanted}")
        return values
