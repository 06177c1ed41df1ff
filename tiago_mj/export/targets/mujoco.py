"""MJCF: the user's own files with what differs (:mod:`tiago_mj.export.mjcf`)."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

from tiago_mj.export.drives import Numbers
from tiago_mj.export.holding import approximate, exact, lacking
from tiago_mj.export.targets.target import Target

HOLDS: Final = MappingProxyType(
    {
        "delay": exact("`delay` and `nsample` of the actuator, of one physics step or more"),
        "servo stiffness": exact("`kp`, or `gainprm` and `biasprm`"),
        "servo damping": exact("`kv`, or `biasprm`"),
        "effort limit": exact("`forcerange`"),
        "motor constant": exact("gains and `forcerange`"),
        "dry friction": exact("`frictionloss`, with solver parameters that stick"),
        "viscous friction": exact("`damping` of the joint"),
        "play": approximate("a second joint with a range in the body, and a tendon over both"),
        "elasticity": approximate("a second joint with a spring in the body, and a tendon over both"),
        "spring": exact("`stiffness` and `springref` of the joint"),
        "coupled motor": approximate("a fixed tendon over both joints"),
        "armature": exact("`armature`"),
        "mass": exact("`<inertial>`, and `gravcomp` where gravity is compensated"),
        "gravity": exact("`gravity` of `<option>`"),
        "velocity limit": lacking("MuJoCo has no limit of a joint's speed"),
    }
)


def write(_: Numbers) -> dict[str, str]:
    """Nothing but the model itself."""
    return {}


_TRIED: Final = "loaded and replayed by MuJoCo 3.11, 3.17 and 4.0"
TARGET: Final = Target("mujoco", "3.11, 3.17 and 4.0", HOLDS, write, "4.0", (), _TRIED)
