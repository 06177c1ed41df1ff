"""Isaac Lab 2.3: an actuator configuration for ``ArticulationCfg.actuators``.

Format: ``isaaclab.actuators.ImplicitActuatorCfg`` and ``DelayedPDActuatorCfg``, of which numbers are by joint, at the
joint, in SI units with radians; ``friction`` and ``dynamic_friction`` are efforts (Isaac Sim 5 and later), delays whole
physics steps, which explicit actuators alone have. Isaac Lab cannot be installed without its simulator: not tried.
"""

from __future__ import annotations

import re
from types import MappingProxyType
from typing import Final

from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import approximate, exact
from tiago_mj.export.targets import isaaclab_events
from tiago_mj.export.targets.python_text import by_name, literal, steps
from tiago_mj.export.targets.target import Target

HOLDS: Final = MappingProxyType(
    {
        "delay": approximate("`min_delay` and `max_delay` of `DelayedPDActuatorCfg`, whole physics steps"),
        "servo stiffness": exact("`stiffness`"),
        "servo damping": exact("`damping`"),
        "effort limit": exact("`effort_limit_sim`, and `effort_limit` of explicit actuators"),
        "motor constant": exact("`stiffness`, `damping` and effort limits"),
        "velocity limit": approximate("`velocity_limit_sim`, which PhysX cuts velocities at, not a servo's force"),
        "dry friction": exact("`friction` and `dynamic_friction`"),
        "viscous friction": exact("`viscous_friction`"),
        "elasticity": approximate("lower `stiffness` and `damping`, which give and trail as the spring does"),
        "armature": exact("`armature`"),
        "mass": exact("of the model beside, which Isaac Lab converts from MJCF"),
        "gravity": approximate("`gravity` of `SimulationCfg`, said in a comment"),
    }
)
#: What the model beside does not have: second joints that the format cannot describe, and what the text has.
ELSEWHERE: Final = ("command_delay", "backlash", "joint_elasticity")
TEXT: Final = '''\
"""Actuators of {robot} with what a diagnosis found, for Isaac Lab 2.3. Written by tiago-mj export."""

from isaaclab.actuators import {kind}

#: For SimulationCfg and the environment: seconds of a physics step, and physics steps in a control step.
SIM_DT = {step}
DECIMATION = {decimation}
#: For SimulationCfg(gravity=...) [m/s²].
GRAVITY = {gravity}

ACTUATORS = {{
{groups}}}
'''


def write(numbers: Numbers) -> dict[str, str]:
    """The module's text."""
    robot = numbers.robot
    step = float(robot.model.opt.timestep)
    kind = "DelayedPDActuatorCfg" if any(drive.delay for drive in numbers.drives) else "ImplicitActuatorCfg"
    lags = sorted({steps(drive.delay, step) for drive in numbers.drives})
    text = TEXT.format(
        robot=robot.file.stem,
        kind=kind,
        step=literal(step),
        decimation=robot.substeps,
        gravity="(" + ", ".join(literal(float(one)) for one in numbers.model.opt.gravity) + ")",
        groups="".join(_group(numbers, kind, lag, step) for lag in lags),
    )
    return {"isaaclab_actuators.py": text}


def _group(numbers: Numbers, kind: str, lag: int, step: float) -> str:
    """Actuators that are late by the same number of physics steps: the format has one for a group."""
    drives = [drive for drive in numbers.drives if steps(drive.delay, step) == lag]
    own = {
        "stiffness": {re.escape(drive.joint): drive.stiffness for drive in drives},
        "damping": {re.escape(drive.joint): drive.damping for drive in drives},
        "armature": {re.escape(drive.joint): drive.armature for drive in drives},
        "friction": {re.escape(drive.joint): drive.friction for drive in drives},
        "dynamic_friction": {re.escape(drive.joint): drive.friction for drive in drives},
        "viscous_friction": {re.escape(drive.joint): drive.joint_damping for drive in drives},
        "effort_limit_sim": {re.escape(drive.joint): drive.effort for drive in drives},
        "velocity_limit_sim": {re.escape(drive.joint): drive.velocity for drive in drives},
    }
    delayed = kind == "DelayedPDActuatorCfg"
    if delayed:
        own |= {"effort_limit": own["effort_limit_sim"], "velocity_limit": own["velocity_limit_sim"]}
    lines = [f"joint_names_expr={[re.escape(drive.joint) for drive in drives]!r}"]
    lines += [f"{key}={by_name(values, '        ')}" for key, values in own.items()]
    lines += [f"min_delay={lag}", f"max_delay={lag}"] if delayed else []
    body = "".join(f"        {line},\n" for line in lines)
    return f'    "late_by_{lag}": {kind}(\n{body}    ),\n'


TARGET: Final = Target(
    "isaaclab",
    "2.3",
    HOLDS,
    write,
    "3.17",
    ELSEWHERE,
    "not tried, but for the model beside",
    isaaclab_events.RANDOMISATION,
)
