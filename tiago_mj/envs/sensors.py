"""All that is measured at the end of a control step, of one simulation or of many."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.chain import Chain
from tiago_mj.envs.state import State, StateReader
from tiago_mj.sensing.load_cell import LoadCell
from tiago_mj.sensing.sources import PadForces

Array = NDArray[np.float64]


class Measured(Protocol):
    """Effects on what is measured, as :class:`tiago_mj.effects.chain.Chain` has them."""

    def reading(self, newtons: Array, units_per_newton: Callable[[Array], Array], noise: Array) -> Array:
        """Load-cell samples [sensor units]."""

    def position(self, position: Array) -> Array:
        """Joint positions."""

    def velocity(self, velocity: Array) -> Array:
        """Joint velocities."""


class OneOf:
    """A chain of effects on one simulation, for arrays without an axis of simulations."""

    def __init__(self, chain: Chain) -> None:
        self._chain = chain

    def reading(self, newtons: Array, units_per_newton: Callable[[Array], Array], noise: Array) -> Array:
        """See :class:`Measured`."""
        return self._chain.reading(newtons[None], units_per_newton, noise[None])[0]

    def position(self, position: Array) -> Array:
        """See :class:`Measured`."""
        return self._chain.position(position[None])[0]

    def velocity(self, velocity: Array) -> Array:
        """See :class:`Measured`."""
        return self._chain.velocity(velocity[None])[0]


class Sensors:
    """Encoders, load cells and the simulator's truth, found by name in a model.

    Args:
        model: of the scene.
        joints: whose positions and velocities are measured, in this order.
        cell: how newtons become readings.
        source: what the load cells read (:mod:`tiago_mj.sensing.sources`); None: there are no load cells.
    """

    def __init__(self, model: mujoco.MjModel, joints: tuple[str, ...], cell: LoadCell, source: str | None) -> None:
        self.cell = cell
        self.pads = None if source is None else PadForces(model, source)
        self._reader = StateReader(model, joints)

    def tare(self, sensordata: Array) -> Array | float:
        """What the load cells read without contact, (..., 2) [N]."""
        return 0.0 if self.pads is None else self.pads.tare(sensordata)

    def read(
        self,
        qpos: Array,
        qvel: Array,
        sensordata: Array,
        *,
        tare: Array | float,
        noise: Array | None,
        average: Callable[[Array], Array],
        effects: Measured | None = None,
    ) -> State:
        """One reading of every sensor; arrays may have leading axes of simulations.

        Args:
            qpos, qvel, sensordata: of the simulations.
            tare: of the load cells, (..., 2) [N].
            noise: of the load cells, (..., 2) [sensor units]; None where there are none.
            average: the load cells' moving average.
            effects: on what is measured.
        """
        if self.pads is None or noise is None:
            contact = raw = binary = np.zeros((*qpos.shape[:-1], 0))
        else:
            contact = self.pads.truth(sensordata)
            newtons = contact if self.pads.source == "contact" else self.pads.read(sensordata, tare)
            if effects is None:
                sample = self.cell.signal(newtons)
                sample += noise
            else:
                sample = effects.reading(newtons, self.cell.signal, noise)
            raw = average(sample)
            binary = self.cell.binary(raw)
        state = self._reader.read(qpos, qvel, sensordata, contact, raw, binary)
        if effects is None:
            return state
        return state._replace(position=effects.position(state.position), velocity=effects.velocity(state.velocity))
