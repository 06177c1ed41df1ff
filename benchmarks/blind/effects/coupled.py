"""A motor that turns with a joint and with the one before it: what it has of friction acts on both."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from benchmarks.blind.effects.base import Array, Effect, World


class CoupledMotor(Effect, ABC):
    """A force against the sum of two joints' speeds."""

    stiff = True

    def load(self, world: World) -> Array:
        out = np.zeros_like(world.q)
        for column in self.targets:
            if column:
                both = slice(column - 1, column + 1)
                out[:, both] += self.against(world.v[:, both].sum(axis=1), column, world)[:, None]
        return out

    @abstractmethod
    def against(self, v: Array, column: int, world: World) -> Array:
        """Force on either joint at a speed of the motor, (ntrials,)."""


class CoupledMotorDamping(CoupledMotor):
    """A dash-pot on the motor."""

    def against(self, v: Array, column: int, world: World) -> Array:
        return -self.values["damping"] * v


class CoupledMotorFriction(CoupledMotor):
    """Bristles on the motor, as those of :mod:`benchmarks.blind.effects.friction`."""

    def start(self, world: World) -> None:
        self._z = np.zeros_like(world.q)
        inertia = np.broadcast_to(world.robot.inertia, world.q.shape)
        # Two joints that are pushed alike give way as much as both together.
        self._inertia = 0.5 / (1 / inertia + 1 / np.roll(inertia, 1, axis=1))

    def against(self, v: Array, column: int, world: World) -> Array:
        stiffness = 0.15 * self._inertia[:, column] / world.h**2
        loss = 0.6 * np.sqrt(stiffness * self._inertia[:, column])
        end, z = np.sign(v) * self.values["force"] / stiffness, self._z[:, column]
        share = np.exp(-stiffness * np.abs(v) / self.values["force"] * world.h)
        new = np.where(np.abs(v) > 1e-12, end + (z - end) * share, z)
        slope = (new - z) / world.h
        self._z[:, column] = new
        return -(stiffness * new + loss * slope)
