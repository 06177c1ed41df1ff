"""mjlab 1.6: the model as MJCF for its MuJoCo 3.11, and one actuator configuration for each joint.

Format: ``mjlab.actuator.BuiltinPositionActuatorCfg`` (and those of velocity and effort), ``mjlab.entity``; numbers are
MuJoCo's own, at the joint, in SI units; delays are whole physics steps.
"""

from __future__ import annotations

import re
from pathlib import PurePath
from types import MappingProxyType
from typing import Final

from tiago_mj.export.drives import Drive, Numbers
from tiago_mj.export.holding import approximate, exact
from tiago_mj.export.targets import mjlab_events
from tiago_mj.export.targets.mujoco import HOLDS as IN_MJCF
from tiago_mj.export.targets.python_text import literal, steps
from tiago_mj.export.targets.target import Target

HOLDS: Final = MappingProxyType(
    {
        **IN_MJCF,
        "delay": approximate("`delay_min_lag` and `delay_max_lag`, whole physics steps"),
        "servo stiffness": exact("`stiffness`"),
        "servo damping": exact("`damping`"),
        "effort limit": exact("`effort_limit`"),
        "motor constant": exact("`stiffness`, `damping` and `effort_limit`"),
    }
)
CLASSES: Final = {
    "position": "BuiltinPositionActuatorCfg",
    "velocity": "BuiltinVelocityActuatorCfg",
    "effort": "BuiltinMotorActuatorCfg",
}
#: Effort of motors without a limit, which they must have there.
UNLIMITED: Final = 1e9
TEXT: Final = '''\
"""Actuators of {robot} with what a diagnosis found, for mjlab 1.6. Written by tiago-mj export."""

from pathlib import Path

import mujoco
from mjlab.actuator import {kind}
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg

MODEL = Path(__file__).parent / "model" / "{file}"
#: Seconds of a physics step, by which delays are counted, and physics steps in a control step.
TIMESTEP = {timestep}
DECIMATION = {decimation}


def spec() -> mujoco.MjSpec:
    """The model without the actuators that are configured below, and without keyframes, which have their controls."""
    out = mujoco.MjSpec.from_file(str(MODEL))
    for key in list(out.keys):
        out.delete(key)
    for actuator in list(out.actuators):
        if actuator.name in {actuators!r}:
            out.delete(actuator)
    return out


ACTUATORS = (
{entries})

ROBOT = EntityCfg(spec_fn=spec, articulation=EntityArticulationInfoCfg(actuators=ACTUATORS))
'''


def write(numbers: Numbers) -> dict[str, str]:
    """The module's text."""
    robot = numbers.robot
    step = float(robot.model.opt.timestep)
    text = TEXT.format(
        robot=robot.file.stem,
        kind=CLASSES[robot.wiring.interface],
        file=PurePath(robot.file).name,
        timestep=literal(step),
        decimation=robot.substeps,
        actuators=tuple(robot.actuators),
        entries="".join(_entry(drive, robot.wiring.interface, step) for drive in numbers.drives),
    )
    return {"mjlab_robot.py": text}


def _entry(drive: Drive, interface: str, step: float) -> str:
    gains = {
        "position": {"stiffness": drive.stiffness, "damping": drive.damping},
        "velocity": {"damping": drive.damping},
        "effort": {"gear": drive.gain},
    }[interface]
    lag = steps(drive.delay, step)
    lines = [f"target_names_expr=({re.escape(drive.joint)!r},)"]
    lines += [f"{key}={literal(value)}" for key, value in gains.items()]
    effort = min(drive.effort, UNLIMITED) if interface == "effort" else drive.effort
    lines += [f"effort_limit={literal(effort)}"]
    # Of friction, damping and armature None leaves what the model has.
    lines += [f"delay_min_lag={lag}", f"delay_max_lag={lag}"] if lag else []
    body = "".join(f"        {line},\n" for line in lines)
    return f"    {CLASSES[interface]}(\n{body}    ),\n"


_TRIED: Final = "loaded by mjlab 1.6, its model replayed by MuJoCo 3.11"
TARGET: Final = Target("mjlab", "1.6", HOLDS, write, "3.11", ("command_delay",), _TRIED, mjlab_events.RANDOMISATION)
