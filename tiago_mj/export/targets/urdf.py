"""URDF: ``<dynamics>`` and ``<limit>`` of joints, ``<inertial>`` of links, as a fragment to be merged by names.

Format: urdfdom's ``<dynamics damping="N·s/m, N·m·s/rad" friction="N, N·m"/>`` and ``<limit lower upper effort
velocity/>``; inertia is about the centre of mass along the link's axes. A robot's servos have no place in it.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Final
from xml.etree import ElementTree

from tiago_mj.export.drives import Drive, Link, Numbers
from tiago_mj.export.holding import exact, lacking
from tiago_mj.export.numbers import number, numbers
from tiago_mj.export.targets.target import Target

_NO_SERVO = lacking("a URDF has no servos: their gains are the controller's or the plugin's")
HOLDS: Final = MappingProxyType(
    {
        "servo stiffness": _NO_SERVO,
        "servo damping": _NO_SERVO,
        "motor constant": _NO_SERVO,
        "delay": _NO_SERVO,
        "effort limit": exact("`effort` of `<limit>`"),
        "velocity limit": exact("`velocity` of `<limit>`"),
        "dry friction": exact("`friction` of `<dynamics>`"),
        "viscous friction": exact("`damping` of `<dynamics>`"),
        "armature": lacking("URDF has no inertia of motors"),
        "mass": exact("`<inertial>` of the link"),
        "gravity": lacking("of the world, which a URDF has not"),
    }
)
#: What ``<limit>`` must say where there is no limit.
UNLIMITED: Final = 1e6
INERTIA: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def write(said: Numbers) -> dict[str, str]:
    """The fragment's text."""
    root = ElementTree.Element("robot", name=said.robot.file.stem)
    for drive in said.drives:
        root.append(_joint(drive))
    for link in said.links:
        root.append(_link(link))
    ElementTree.indent(root)
    note = "<!-- What a diagnosis found, to be merged into the robot's URDF by names. Written by tiago-mj export. -->\n"
    return {"joints.urdf": note + ElementTree.tostring(root, encoding="unicode") + "\n"}


def _joint(drive: Drive) -> ElementTree.Element:
    limited = math.isfinite(drive.low) and math.isfinite(drive.high)
    kind = "prismatic" if drive.slides else "revolute" if limited else "continuous"
    joint = ElementTree.Element("joint", name=drive.joint, type=kind)
    ElementTree.SubElement(joint, "dynamics", damping=number(drive.joint_damping), friction=number(drive.friction))
    bounds = {"lower": number(drive.low), "upper": number(drive.high)} if limited else {}
    most = {"effort": number(min(drive.effort, UNLIMITED)), "velocity": number(min(drive.velocity, UNLIMITED))}
    ElementTree.SubElement(joint, "limit", {**bounds, **most})
    return joint


def _link(link: Link) -> ElementTree.Element:
    out = ElementTree.Element("link", name=link.name)
    inertial = ElementTree.SubElement(out, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=numbers(*link.centre), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=number(link.mass))
    moments = {key: number(value) for key, value in zip(INERTIA, link.inertia, strict=True)}
    ElementTree.SubElement(inertial, "inertia", moments)
    return out


TARGET: Final = Target("urdf", "of urdfdom 4", HOLDS, write, None, (), "read back as XML")
