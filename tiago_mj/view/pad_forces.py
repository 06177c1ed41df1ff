"""Points of application of the forces on the pads, for films and the viewer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.models import names

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PadForce:
    """The force on one pad.

    Attributes:
        side: ``right`` or ``left``.
        place: of the pad, (3,) [m].
        outwards: unit vector from the object through the pad, (3,).
        newtons: with which the object presses on it.
        goal: with which it is to press; None where the task asks for no force.
    """

    side: str
    place: Array
    outwards: Array
    newtons: float
    goal: float | None


def pad_forces(core: Any) -> list[PadForce]:
    """Forces on the pads in the present state of an environment; none where it has no load cells."""
    model, data, found = core.model, core.data, []
    force = np.asarray(core.state.force_contact)
    goal = force_goal(core)
    for k, side in enumerate(names.SIDES):
        pad = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, names.PAD_SITE[side])
        cell = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, names.LOAD_CELL_SITE[side])
        if pad < 0 or cell < 0 or force.shape != (len(names.SIDES),):
            continue
        outwards = -data.site_xmat[cell].reshape(3, 3)[:, 0]
        found.append(PadForce(side, data.site_xpos[pad].copy(), outwards, float(force[k]), goal))
    return found


def force_goal(core: Any) -> float | None:
    """Force that the task asks of each finger [N]; None where its goal is no force."""
    goal = np.ravel(core.goal)
    if not hasattr(core, "force_type") or len(goal) != len(names.SIDES):
        return None
    return float(goal[0] / core.load_cell.units(1.0))
