"""All targets by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from tiago_mj.export.targets import gymnasium, isaaclab, mjlab, mujoco, newton, playground, ros2_control, sdf, urdf
from tiago_mj.export.targets.target import Target

TARGETS: Final[Mapping[str, Target]] = MappingProxyType(
    {
        module.TARGET.name: module.TARGET
        for module in (mujoco, mjlab, playground, isaaclab, newton, gymnasium, ros2_control, urdf, sdf)
    }
)
