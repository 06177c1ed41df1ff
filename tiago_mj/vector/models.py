"""Model values of each simulation's own: its object, and the nominal values of what effects have changed."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from tiago_mj.models import scene
from tiago_mj.models.objects import GraspObject


class Models:
    """Gives simulations of a batch their objects, and takes back what effects did to their models.

    Args:
        batch: the simulations.
        nominal: the model that all were made of.
        item: the object in it.
    """

    def __init__(self, batch: mujoco.batch.Batch, nominal: mujoco.MjModel, item: GraspObject | None) -> None:
        self._batch = batch
        self._model = copy.copy(nominal)
        self._in_model = item
        self._names: frozenset[str] = frozenset()
        self.items: list[GraspObject | None] = [item] * batch.nsim

    def note_expanded(self) -> None:
        """Find out which fields have values of each simulation's own: effects may have added some."""
        self._names = frozenset(n for n in mujoco.batch.MODEL_FIELDS if self._batch.expanded(n) is not None)

    def give(self, rows: NDArray[np.intp], items: Sequence[GraspObject | None], *, restore: bool) -> None:
        """Give simulations their objects for an episode.

        Args:
            rows: which.
            items: one each.
            restore: every other value of their models becomes nominal, too: effects may have changed some.
        """
        of_item: dict[GraspObject | None, list[int]] = {}
        for row, item in zip(rows.tolist(), items, strict=True):
            if restore or item != self.items[row]:
                of_item.setdefault(item, []).append(row)
                self.items[row] = item
        if not of_item:
            return
        if any(item != self._in_model for item in of_item) and not self._names.issuperset(scene.OBJECT_FIELDS):
            for name in scene.OBJECT_FIELDS:
                self._batch.expand(name)
            self.note_expanded()
        scratch = mujoco.MjData(self._model)
        for item, some in of_item.items():
            self._write(some, item, self._names if restore else self._names & set(scene.OBJECT_FIELDS), scratch)

    def _write(self, rows: list[int], item: GraspObject | None, names: frozenset[str], scratch: mujoco.MjData) -> None:
        if item is not None and item != self._in_model:
            scene.set_object(self._model, item, scratch)
            self._in_model = item
        for name in names:
            field = self._batch.expand(name)
            holder = self._model.opt if name.startswith("opt.") else self._model
            value = np.asarray(getattr(holder, name.removeprefix("opt.")))
            field[rows] = value[: field.shape[1]] if value.ndim else value  # of bvh_aabb a batch has the first rows
