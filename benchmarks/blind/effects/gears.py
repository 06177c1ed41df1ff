"""Between motor and joint: a motor of its own mass, and what connects it.

The servo's encoder is on the motor; what is logged is the joint. Motor and joint are two masses; the connection is
solved implicitly on the motor's side, so that it stays stable however stiff it is.
"""

from __future__ import annotations

import numpy as np

from benchmarks.blind.effects.base import Array, Effect, World

#: Mass of the rotor over the joint's effective inertia.
ROTOR = 0.3


class TwoMass(Effect):
    """A motor behind a spring and a damper, with or without play."""

    two_mass = True
    stiff = True

    def start(self, world: World) -> None:
        inertia = world.robot.inertia
        self._mass = ROTOR * inertia
        self._k, self._c, self._gap = self.connection(world)
        self._q = world.q.copy()
        self._v = np.zeros_like(world.q)

    def connection(self, world: World) -> tuple[Array, Array, Array]:
        """Stiffness, damping, play, each (n,)."""
        raise NotImplementedError

    def motor(self, world: World) -> tuple[Array, Array]:
        q, v = world.q.copy(), world.v.copy()
        q[:, self.targets], v[:, self.targets] = self._q[:, self.targets], self._v[:, self.targets]
        return q, v

    def through(self, force: Array, world: World) -> Array:
        h, k, c = world.h, self._k, self._c
        stretch = self._q - world.q
        half = self._gap / 2
        beyond = np.sign(stretch) * np.maximum(np.abs(stretch) - half, 0.0)
        engaged = beyond != 0.0
        kk, cc = np.where(engaged, k, 0.0), np.where(engaged, c, 0.0)
        drag = 0.5 * np.sqrt(world.stiffness * self._mass)
        momentum = self._mass * self._v + h * (force - kk * beyond + cc * world.v)
        self._v = momentum / (self._mass + h * (cc + drag) + h * h * kk)
        passed = kk * (beyond + h * self._v) + cc * (self._v - world.v)
        passed = np.where(np.sign(passed) == np.sign(beyond), passed, 0.0)  # teeth push, they do not pull
        self._q = self._q + h * self._v
        out = force.copy()
        out[:, self.targets] = passed[:, self.targets]
        return out


class Backlash(TwoMass):
    """Play between the teeth; they meet as a stiff, damped contact."""

    def connection(self, world: World) -> tuple[Array, Array, Array]:
        inertia = world.robot.inertia
        k = 0.25 * inertia / world.h**2
        return k, 0.6 * np.sqrt(k * inertia), np.full_like(k, self.values["width"])


class JointElasticity(TwoMass):
    """A spring with a little damping of its own."""

    def connection(self, world: World) -> tuple[Array, Array, Array]:
        inertia = world.robot.inertia
        k = np.full_like(inertia, self.values["stiffness"])
        return k, 0.05 * np.sqrt(k * inertia), np.zeros_like(k)

    def through(self, force: Array, world: World) -> Array:
        h, k, c = world.h, self._k, self._c
        stretch = self._q - world.q
        drag = 0.1 * np.sqrt(world.stiffness * self._mass)
        momentum = self._mass * self._v + h * (force - k * stretch + c * world.v)
        self._v = momentum / (self._mass + h * (c + drag) + h * h * k)
        passed = k * (stretch + h * self._v) + c * (self._v - world.v)
        self._q = self._q + h * self._v
        out = force.copy()
        out[:, self.targets] = passed[:, self.targets]
        return out
