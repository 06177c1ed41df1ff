"""ros2_control (Jazzy): limits of joints as YAML parameters.

Format: ``joint_limits`` of the package ``joint_limits``: ``has_velocity_limits``, ``max_velocity`` [m/s, rad/s],
``has_effort_limits``, ``max_effort`` [N, N·m], ``has_position_limits``, ``min_position``, ``max_position`` [m, rad].
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Any, Final

import yaml

from tiago_mj.export.drives import Drive, Numbers
from tiago_mj.export.holding import exact, lacking
from tiago_mj.export.numbers import number
from tiago_mj.export.targets.target import Target

_NO_PLANT = lacking("it commands a robot and simulates none: only its limits are its own")
HOLDS: Final = MappingProxyType(
    {
        "effort limit": exact("`max_effort`"),
        "velocity limit": exact("`max_velocity`"),
        **dict.fromkeys(
            (
                *("delay", "servo stiffness", "servo damping", "motor constant", "dry friction", "viscous friction"),
                *("play", "elasticity", "armature", "mass", "gravity"),
            ),
            _NO_PLANT,
        ),
    }
)


def write(numbers: Numbers) -> dict[str, str]:
    """The parameters' text."""
    said = {"joint_limits": {drive.joint: _limits(drive) for drive in numbers.drives}}
    head = f"# Limits of {numbers.robot.file.stem} with what a diagnosis found. Written by tiago-mj export.\n"
    return {"joint_limits.yaml": head + yaml.safe_dump(said, sort_keys=False, allow_unicode=True)}


def _limits(drive: Drive) -> dict[str, Any]:
    out: dict[str, Any] = {"has_position_limits": math.isfinite(drive.low) and math.isfinite(drive.high)}
    if out["has_position_limits"]:
        out |= {"min_position": _round(drive.low), "max_position": _round(drive.high)}
    for name, value in (("velocity", drive.velocity), ("effort", drive.effort)):
        out[f"has_{name}_limits"] = math.isfinite(value)
        if math.isfinite(value):
            out[f"max_{name}"] = _round(value)
    return out


def _round(value: float) -> float:
    return float(number(value))


TARGET: Final = Target("ros2_control", "Jazzy", HOLDS, write, None, (), "not tried")
