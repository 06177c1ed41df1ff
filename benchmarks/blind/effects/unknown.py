"""What no library has: families that the diagnosis must call unknown."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.effects.base import Array, Effect, World
from benchmarks.blind.effects.friction import Bristles


class ThermalFade(Effect):
    """Windings heat with the square of the force and lose gain, within seconds."""

    order = 47

    def start(self, world: World) -> None:
        self._heat = np.zeros_like(world.q)

    def drive(self, force: Array, world: World) -> Array:
        load = (force / world.robot.limit) ** 2
        self._heat += world.h / self.values["time_constant"] * (self.values["heating"] * load - self._heat)
        return force * np.where(self.on(world, 1.0) > 0, 1 / (1 + self._heat), 1.0)


class CableTug(Effect):
    """A cable that goes taut on one part of the way, and drags."""

    def load(self, world: World) -> Array:
        low, high = world.robot.low, world.robot.high
        taut = low + self.values["place"] * (high - low)
        reach = np.maximum(taut - world.q, 0.0)
        pull = self.values["stiffness"] * reach + 0.3 * self.values["stiffness"] * reach * np.tanh(world.v / 0.005)
        return pull * self.on(world, 1.0)


class PlaceFriction(Bristles):
    """A dry, dented stretch of the guide: friction there alone."""

    def level(self, world: World) -> Array:
        low, high = world.robot.low, world.robot.high
        middle = low + self.values["place"] * (high - low)
        spread = self.values["width"] * (high - low)
        return self.values["force"] * np.exp(-(((world.q - middle) / spread) ** 2))


class StiffeningSpring(Effect):
    """A rubber boot that resists more and more."""

    def load(self, world: World) -> Array:
        low, high = world.robot.low, world.robot.high
        x = (world.q - high) / (high - low)
        return -self.on(world, self.values["force"]) * x * x * x


class MainsHum(Effect):
    """The mains on the load cells' leads, and its third harmonic; what the logger makes of it is an alias."""

    order = 65

    def ready(self) -> None:
        self._phase = self.own.uniform(0, 2 * np.pi, 2)

    def forces_read(self, x: Array, world: World) -> Array:
        angle = 2 * np.pi * self.values["frequency"] * world.t + self._phase
        return x + self.cells(self.values["amplitude"]) * (np.sin(angle) + 0.2 * np.sin(3 * angle))


class MountResonance(Effect):
    """The gripper's mount gives and rings: the reaction of the drives shakes it, and the cells feel their own tips."""

    order = 35

    def start(self, world: World) -> None:
        self._x = np.zeros(len(world.q))
        self._v = np.zeros(len(world.q))
        self._a = np.zeros(len(world.q))

    def load(self, world: World) -> Array:
        omega = 2 * np.pi * self.values["frequency"]
        mass = 1.0
        push = world.force[:, -2] - world.force[:, -1]
        self._a = push / mass - 2 * 0.03 * omega * self._v - omega**2 * self._x
        self._v = self._v + world.h * self._a
        self._x = self._x + world.h * self._v
        shake = self.values["strength"] * self._a
        out = np.zeros_like(world.q)
        out[:, -2], out[:, -1] = -shake * world.robot.inertia[..., -2], shake * world.robot.inertia[..., -1]
        return out

    def forces_read(self, x: Array, world: World) -> Array:
        tip = 0.05 * self.values["strength"] * self._a[:, None] * np.array([1.0, -1.0])
        return x + tip * world.robot.units


class SupplySag(Effect):
    """A weak battery: both drives together get no more than a power; what one takes the other lacks."""

    order = 48

    def drive(self, force: Array, world: World) -> Array:
        drawn = np.abs(force).sum(axis=1, keepdims=True)
        share = 1 / (1 + (drawn / self.values["current"]) ** 4) ** 0.25
        return force * np.where(self.on(world, 1.0) > 0, share, 1.0)


class SoftSaturation(Effect):
    """An amplifier that gives way long before its rail: small forces are right, large ones come ever shorter."""

    order = 71

    def forces_read(self, x: Array, world: World) -> Array:
        short = (1 + (np.abs(x) / self.values["limit"]) ** 4) ** -0.25
        return x * np.where(self.cells(1.0) > 0, short, 1.0)


class LateStamps(Effect):
    """A busy logger: its stamps come late by what waits before it, which swells and is worked off."""

    def stamp(self, time: Array) -> Array:
        waits = 0.5 * self.values["seconds"] * (1 - np.cos(2 * np.pi * time / self.values["period"]))
        return time + waits


class StickyPads(Effect):
    """Pads that cling: letting go takes a pull, the more the longer and harder they were pressed."""

    order = 25

    def start(self, world: World) -> None:
        self._bond = np.zeros_like(world.newtons)

    def forces_read(self, x: Array, world: World) -> Array:
        self._bond += world.h / 0.8 * (self.values["share"] * np.maximum(x, 0) - self._bond)
        letting_go = x < 0.5 * self._bond / max(self.values["share"], 1e-9)
        return x - self.cells(1.0) * np.where(letting_go, self._bond, 0.0)
