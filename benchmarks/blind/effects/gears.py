"""Between motor and joint: a motor of its own mass, and what connects it.

The servo's encoder is on the motor; what is logged is the joint. Motor and joint are two masses; the connection is
solved implicitly on the motor's side, so that it stays stable however stiff it is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from benchmarks.blind.effects.base import Array, Effect, World
from benchmarks.blind.robots import Robot

#: Mass of the rotor over the joint's effective inertia. As much is taken off the joint's own armature where it has any.
ROTOR = 0.05
#: Damping of a spring, of twice the critical one of the joint on it.
SPRING_DAMPING = 0.05


class TwoMass(Effect, ABC):
    """A motor behind a spring and a damper, with or without play."""

    two_mass = True
    stiff = True

    def build(self, robot: Robot) -> None:
        """Part of the joint's damping sits on the motor: as much as keeps it from ringing within the play."""
        wanted = np.maximum(0.6 * np.sqrt(robot.stiffness * ROTOR * robot.inertia) - robot.damping, 0.0)
        self._drag = np.zeros(len(robot.joints))
        model = robot.model
        for column in self.targets:
            dof = model.joint(robot.joints[column]).dofadr[0]
            self._drag[column] = min(wanted[column], 0.5 * model.dof_damping[dof])
            model.dof_damping[dof] -= self._drag[column]
            model.dof_armature[dof] = max(model.dof_armature[dof] - ROTOR * robot.inertia[column], 0.0)

    def start(self, world: World) -> None:
        inertia = world.robot.inertia
        self._mass = ROTOR * inertia
        self._k, self._c, self._gap = self.connection(world)
        self._soft = 0.02 * np.maximum(world.robot.limit, 1e-9) / self._k
        self._q = world.q.copy()
        self._v = np.zeros_like(world.q)

    @abstractmethod
    def connection(self, world: World) -> tuple[Array, Array, Array]:
        """Stiffness, damping, play, each (n,)."""

    def motor(self, world: World) -> tuple[Array, Array]:
        q, v = world.q.copy(), world.v.copy()
        q[:, self.targets], v[:, self.targets] = self._q[:, self.targets], self._v[:, self.targets]
        return q, v

    def through(self, force: Array, world: World) -> Array:
        k, c = self._k, self._c
        stretch = self._q - world.q
        half = self._gap / 2
        beyond = np.sign(stretch) * np.maximum(np.abs(stretch) - half, 0.0)
        kk = np.where(beyond != 0.0, k, 0.0)
        cc = c * np.minimum(np.abs(beyond) / self._soft, 1.0)  # grows with the depth, so that the force has no jumps
        return self._pass(force, world, kk, cc, beyond)

    def _pass(self, force: Array, world: World, k: Array, c: Array, stretch: Array) -> Array:
        """Move the rotor by a step and give what reaches the joint.

        The servo's own gains are implicit, too, where it is not saturated: the rotor alone is so light that a velocity
        gain of a step ago would throw it to and fro between the limits.
        """
        h, side = world.h, np.sign(stretch)
        stretch = stretch - h * world.v  # where the joint will be: teeth do not pull
        kp = np.where(world.free, world.stiffness, 0.0)
        kd = np.where(world.free, world.damping, 0.0)
        momentum = (self._mass + h * kd) * self._v + h * (force - k * stretch + c * world.v)
        self._v = momentum / (self._mass + h * (kd + c + self._drag) + h * h * (kp + k))
        passed = k * (stretch + h * self._v) + c * (self._v - world.v)
        if self._gap.any():
            passed = np.where(passed * side > 0, passed, 0.0)
        self._q = self._q + h * self._v
        out = force.copy()
        out[:, self.targets] = passed[:, self.targets]
        return out


class Backlash(TwoMass):
    """Play between the teeth; they meet as a stiff, damped contact.

    The servo's gain makes up for the teeth's own give, so that a play of nothing is no effect.
    """

    def start(self, world: World) -> None:
        super().start(world)
        world.stiffness = world.stiffness.copy()
        kp = world.stiffness[..., self.targets]
        world.stiffness[..., self.targets] = 1 / (
            1 / kp - 1 / np.broadcast_to(self._k, world.stiffness.shape)[..., self.targets]
        )

    def connection(self, world: World) -> tuple[Array, Array, Array]:
        inertia = world.robot.inertia
        k = 0.25 * inertia / world.h**2
        return k, 0.6 * np.sqrt(k * inertia), np.full_like(k, self.values["width"])


class JointElasticity(TwoMass):
    """A spring with a little damping of its own."""

    def connection(self, world: World) -> tuple[Array, Array, Array]:
        inertia = world.robot.inertia
        k = np.full_like(inertia, self.values["stiffness"])
        return k, SPRING_DAMPING * np.sqrt(k * inertia), np.zeros_like(k)

    def through(self, force: Array, world: World) -> Array:
        return self._pass(force, world, self._k, self._c, self._q - world.q)
