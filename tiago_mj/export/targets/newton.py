"""Newton 1.8: a USD layer of drive and joint properties, to be laid over the robot's own USD.

Format: ``PhysicsDriveAPI`` of UsdPhysics and ``NewtonJointAPI``. On revolute joints stiffness, damping and speeds are
per degree, as UsdPhysics has them; armature and friction are not. Loaded by ``newton.ModelBuilder.add_usd``.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Final

from tiago_mj.export.drives import Drive, Link, Numbers
from tiago_mj.export.holding import approximate, exact, lacking
from tiago_mj.export.numbers import number
from tiago_mj.export.targets.target import Target

HOLDS: Final = MappingProxyType(
    {
        "servo stiffness": exact("`drive:…:physics:stiffness`, per degree on hinges"),
        "servo damping": exact("`drive:…:physics:damping`, per degree on hinges"),
        "effort limit": exact("`drive:…:physics:maxForce`"),
        "motor constant": exact("stiffness, damping and `maxForce` of the drive"),
        "velocity limit": approximate("`newton:velocityLimit`, which some of its solvers ignore"),
        "dry friction": exact("`newton:friction`"),
        "viscous friction": exact("`newton:damping`, per degree on hinges"),
        "elasticity": approximate("lower gains of the drive, which give and trail as the spring does"),
        "armature": exact("`newton:armature`"),
        "mass": exact("`physics:mass`, `physics:centerOfMass` and inertia of the body"),
        "gravity": exact("`gravity` of the model beside, for `newton.ModelBuilder.add_mjcf`"),
        "delay": lacking("USD has no delays: delay controls in the loop that sends them"),
    }
)
#: What the model beside does not have: second joints that the format cannot describe, and what the text has.
ELSEWHERE: Final = ("command_delay", "backlash", "joint_elasticity")
HEAD: Final = '''\
#usda 1.0
(
    doc = """{robot} with what a diagnosis found, for Newton 1.8. Written by tiago-mj export.
Load a layer with subLayers = [@newton_drives.usda@, @ROBOT.usd@], of which the first is the stronger. Joints are
looked for in /{root}/joints and bodies in /{root}: move them to where yours are."""
)

over "{root}"
{{
'''


def write(numbers: Numbers) -> dict[str, str]:
    """The layer's text."""
    root = _identifier(numbers.robot.file.stem)
    joints = "".join(_joint(drive) for drive in numbers.drives)
    bodies = "".join(_body(link) for link in numbers.links)
    text = HEAD.format(robot=numbers.robot.file.stem, root=root)
    return {"newton_drives.usda": f'{text}    over "joints"\n    {{\n{joints}    }}\n{bodies}}}\n'}


def _joint(drive: Drive) -> str:
    axis = "linear" if drive.slides else "angular"
    per = 1.0 if drive.slides else math.pi / 180  # per radian to per degree
    values = {
        f"drive:{axis}:physics:stiffness": drive.stiffness * per,
        f"drive:{axis}:physics:damping": drive.damping * per,
        f"drive:{axis}:physics:maxForce": drive.effort,
        "newton:armature": drive.armature,
        "newton:friction": drive.friction,
        "newton:damping": drive.joint_damping * per,
        "newton:velocityLimit": drive.velocity / per,
    }
    lines = [f"            float {key} = {number(value)}\n" for key, value in values.items() if math.isfinite(value)]
    applied = f'prepend apiSchemas = ["PhysicsDriveAPI:{axis}", "NewtonJointAPI"]'
    over = f'        over "{_identifier(drive.joint)}" (\n            {applied}\n        )\n'
    return f"{over}        {{\n{''.join(lines)}        }}\n"


def _body(link: Link) -> str:
    centre, inertia, axes = (", ".join(map(number, values)) for values in (link.centre, link.moments, link.axes))
    return (
        f'    over "{_identifier(link.name)}" (\n        prepend apiSchemas = ["PhysicsMassAPI"]\n    )\n    {{\n'
        f"        float physics:mass = {number(link.mass)}\n"
        f"        point3f physics:centerOfMass = ({centre})\n"
        f"        float3 physics:diagonalInertia = ({inertia})\n"
        f"        quatf physics:principalAxes = ({axes})\n    }}\n"
    )


def _identifier(name: str) -> str:
    """A name as USD takes it: letters, digits and underscores."""
    text = "".join(sign if sign.isalnum() and sign.isascii() else "_" for sign in name) or "_"
    return f"_{text}" if text[0].isdigit() else text


TARGET: Final = Target("newton", "1.8", HOLDS, write, "3.17", ELSEWHERE, "loaded by newton 1.8")
