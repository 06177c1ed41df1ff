"""SDFormat 1.11 (Gazebo Harmonic): ``<dynamics>`` and ``<limit>`` of joints, ``<inertial>`` of links, as a fragment.

Format: ``<axis>`` of ``<joint>``: ``<dynamics><damping/><friction/></dynamics>`` [N·s/m, N·m·s/rad], [N, N·m];
``<limit><lower/><upper/><effort/><velocity/></limit>``, of which infinity is no limit. Gazebo is not installed by a
package: not tried.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final
from xml.etree import ElementTree

from tiago_mj.export.drives import Drive, Link, Numbers
from tiago_mj.export.holding import exact, lacking
from tiago_mj.export.numbers import number, numbers
from tiago_mj.export.targets.target import Target
from tiago_mj.export.targets.urdf import INERTIA

_NO_SERVO = lacking("gains are those of Gazebo's controller plugins, which are configured apart")
HOLDS: Final = MappingProxyType(
    {
        "servo stiffness": _NO_SERVO,
        "servo damping": _NO_SERVO,
        "motor constant": _NO_SERVO,
        "delay": _NO_SERVO,
        "effort limit": exact("`<effort>` of `<limit>`"),
        "velocity limit": exact("`<velocity>` of `<limit>`"),
        "dry friction": exact("`<friction>` of `<dynamics>`"),
        "viscous friction": exact("`<damping>` of `<dynamics>`"),
        "armature": lacking("SDFormat has no inertia of motors"),
        "mass": exact("`<inertial>` of the link"),
        "gravity": exact("`<gravity>` of the world"),
    }
)


def write(said: Numbers) -> dict[str, str]:
    """The fragment's text."""
    root = ElementTree.Element("sdf", version="1.11")
    world = ElementTree.SubElement(root, "world", name="world")
    ElementTree.SubElement(world, "gravity").text = numbers(*said.model.opt.gravity)
    model = ElementTree.SubElement(world, "model", name=said.robot.file.stem)
    for drive in said.drives:
        model.append(_joint(drive))
    for link in said.links:
        model.append(_link(link))
    ElementTree.indent(root)
    note = "<!-- What a diagnosis found, to be merged into the robot's SDF by names. Written by tiago-mj export. -->\n"
    return {"joints.sdf": note + ElementTree.tostring(root, encoding="unicode") + "\n"}


def _joint(drive: Drive) -> ElementTree.Element:
    joint = ElementTree.Element("joint", name=drive.joint, type="prismatic" if drive.slides else "revolute")
    axis = ElementTree.SubElement(joint, "axis")
    _filled(axis, "dynamics", {"damping": drive.joint_damping, "friction": drive.friction})
    bounds = {"lower": drive.low, "upper": drive.high, "effort": drive.effort, "velocity": drive.velocity}
    _filled(axis, "limit", {key: value for key, value in bounds.items() if math.isfinite(value)})
    return joint


def _link(link: Link) -> ElementTree.Element:
    out = ElementTree.Element("link", name=link.name)
    inertial = ElementTree.SubElement(out, "inertial")
    ElementTree.SubElement(inertial, "pose").text = numbers(*link.centre, 0, 0, 0)
    ElementTree.SubElement(inertial, "mass").text = number(link.mass)
    _filled(inertial, "inertia", dict(zip(INERTIA, link.inertia, strict=True)))
    return out


def _filled(parent: ElementTree.Element, name: str, values: Mapping[str, float]) -> None:
    element = ElementTree.SubElement(parent, name)
    for key, value in values.items():
        ElementTree.SubElement(element, key).text = number(value)


TARGET: Final = Target("sdf", "1.11", HOLDS, write, None, (), "not tried")
