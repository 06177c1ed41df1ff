"""Dry friction as bristles (LuGre): z' = v - |v| z s0 / g(v), force = s0 z + s1 z'. Breakaway is at a few hundredths of
a millimetre; at rest it holds, as MuJoCo's own friction does not."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from benchmarks.blind.effects.base import Array, Effect, World
from benchmarks.blind.robots import Robot


class Bristles(Effect, ABC):
    """Friction whose level :meth:`level` gives, (ntrials, n) [N, N·m]."""

    stiff = True

    def build(self, robot: Robot) -> None:
        """Take the joint's own friction over, so that one bristle bears the whole: MuJoCo's beside it creeps as no real
        one does, and the joint comes to rest where the bristle alone holds it."""
        self._base = np.zeros(len(robot.joints))
        for column in self.targets:
            dof = robot.model.joint(robot.joints[column]).dofadr[0]
            self._base[column] = robot.model.dof_frictionloss[dof]
            robot.model.dof_frictionloss[dof] = 0.0

    @abstractmethod
    def level(self, world: World) -> Array:
        """Steady friction now, without the joint's own."""

    def whole(self, world: World) -> Array:
        """Steady friction now, with it."""
        return self._base + self.level(world)

    def start(self, world: World) -> None:
        self._z = np.zeros_like(world.q)
        inertia = world.robot.inertia
        self._s0 = 0.15 * inertia / world.h**2
        self._s1 = 0.6 * np.sqrt(self._s0 * inertia)

    def load(self, world: World) -> Array:
        level = np.maximum(self.whole(world), 1e-9)
        v = world.v
        # Exact over a step for a constant velocity: z goes to sign(v) level / s0.
        rate = self._s0 * np.abs(v) / level
        end = np.sign(v) * level / self._s0
        new = np.where(np.abs(v) > 1e-12, end + (self._z - end) * np.exp(-rate * world.h), self._z)
        slope = (new - self._z) / world.h
        self._z = new
        force = -(self._s0 * new + self._s1 * slope)
        out = np.zeros_like(v)
        out[:, self.targets] = force[:, self.targets]
        return out


class CoulombFriction(Bristles):
    def level(self, world: World) -> Array:
        return np.full_like(world.q, self.values["force"])


class StribeckFriction(Bristles):
    """Breakaway force that fades as a bell over speed; what is left of it when moving is nothing."""

    def level(self, world: World) -> Array:
        share = np.exp(-((world.v / self.values["velocity"]) ** 2))
        return self.values["static"] * share


class LoadDependentFriction(Bristles):
    """Friction in proportion to what the gear transmits, seen through 5 ms of the gear's own give; the robot's
    weight, which its motors lift, is a part of that."""

    def start(self, world: World) -> None:
        super().start(world)
        self._carried = np.zeros_like(world.q)

    def level(self, world: World) -> Array:
        force = world.force + world.lifted
        self._carried += (1 - np.exp(-world.h / 0.005)) * (np.abs(force) - self._carried)
        return self.values["coefficient"] * self._carried


class AsymmetricFriction(Bristles):
    """More by the force in one direction, less by it in the other, down to none; the joint's own friction included."""

    def level(self, world: World) -> Array:
        # The bristle's own bend says which way the joint is pushed; a trembling one does not let go of it.
        return np.sign(self._z) * self.values["force"]

    def whole(self, world: World) -> Array:
        return np.maximum(super().whole(world), 0.0)


class ViscousFriction(Effect):
    """A dash-pot beside the joint's own."""

    def build(self, robot: Robot) -> None:
        model = robot.model
        for column in self.targets:
            dof = model.joint(robot.joints[column]).dofadr[0]
            model.dof_damping[dof] += self.values["damping"]
