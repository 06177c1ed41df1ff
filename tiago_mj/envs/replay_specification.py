"""What a replay of recorded commands needs to know of an environment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.now import Wiring
from tiago_mj.models.objects import GraspObject
from tiago_mj.sensing.load_cell import LoadCell
from tiago_mj.sensing.sources import PadForces

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReplaySpecification:
    """The nominal simulation of an environment, and how an episode of it begins.

    Attributes:
        model: compiled; its physics step is the environment's.
        wiring: where commands, joints and sensors are.
        period: of control [s].
        pads: reads the pads' forces; None: there are no load cells.
        cell: what a load cell makes of them; None: there are none.
        item: the object where nobody says which; None: on an empty table.
        offset: of that object along the grasp axis [m].
        start_qpos: positions at the start, (nq,) [m, rad], of an object, or None, and its offset [m].
    """

    model: mujoco.MjModel
    wiring: Wiring
    period: float
    pads: PadForces | None
    cell: LoadCell | None
    item: GraspObject | None
    offset: float
    start_qpos: Callable[[GraspObject | None, float], Array]
