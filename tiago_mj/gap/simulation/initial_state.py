"""Initial states of the trials that a batch simulates: objects, joints, inputs and set points."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.host import BatchHost
from tiago_mj.gap.simulation.plant import Plant, Start
from tiago_mj.models import scene
from tiago_mj.models.objects import GraspObject

Array = NDArray[np.float64]


def set_initial(plant: Plant, host: BatchHost, starts: Sequence[Start], set_points: Array) -> None:
    """Objects, positions, velocities, inputs and set points, (nsim, nactuators), of the trials' starts."""
    host.batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
    _set_objects(plant, host, starts)
    host.state("qpos")[:] = [start.qpos for start in starts]
    host.state("qvel")[:] = [start.qvel for start in starts]
    if starts[0].idle is not None:
        host.state("ctrl")[:] = [start.idle for start in starts]
    stateful = plant.wiring.act >= 0
    if stateful.any():
        act = host.state("act")
        act[:, plant.wiring.act[stateful]] = set_points[:, stateful]


def _set_objects(plant: Plant, host: BatchHost, starts: Sequence[Start]) -> None:
    """Trials with other objects than the model's: their fields, simulation by simulation."""
    items = [start.item for start in starts]
    if all(item is None for item in items):
        return
    models: dict[GraspObject | None, mujoco.MjModel] = {None: plant.model}
    for item in filter(None, dict.fromkeys(items)):
        model = copy.copy(plant.model)
        scene.set_object(model, item)
        models[item] = model
    for name in scene.OBJECT_FIELDS:
        values = [getattr(models[item], name) for item in items]
        if any(not np.array_equal(value, getattr(plant.model, name)) for value in values):
            host.field(name)[:] = values
