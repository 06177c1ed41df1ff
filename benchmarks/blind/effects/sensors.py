"""Encoders, load cells, clocks."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.effects.base import Array, Effect, World


def _some(old: Array, new: Array, columns: list[int]) -> Array:
    out = old.copy()
    out[..., columns] = new[..., columns]
    return out


# Encoders -----------------------------------------------------------------------------------------------------------


class EncoderBias(Effect):
    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        return q + self.on(world, self.values["offset"]), v, x


class EncoderScale(Effect):
    """Position and velocity alike: both come from the same counts."""

    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        factor = self.on(world, self.values["factor"], 1.0)
        return q * factor, v * factor, x


class EncoderQuantization(Effect):
    """Counts from the joint's zero; noise comes before counting and decides between two of them."""

    order = 80

    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        step = self.values["step"]
        return _some(q, np.floor(q / step + 0.5) * step, self.targets), v, x


class VelocityFilter(Effect):
    """Two equal poles on the reported velocity, together as late as one of the time constant. A pole takes what came in
    over a step at its mean: at its end each would be early by half a step."""

    def start(self, world: World) -> None:
        self._a, self._b, self._came = world.v.copy(), world.v.copy(), world.v.copy()

    def joints_read(self, q: Array, v: Array, world: World) -> tuple[Array, Array]:
        share = 1 - np.exp(-world.h / (self.values["time_constant"] / 2))
        before = self._a
        self._a = self._a + share * (0.5 * v + 0.5 * self._came - self._a)
        self._b = self._b + share * (0.5 * self._a + 0.5 * before - self._b)
        self._came = np.array(v)
        return q, _some(v, self._b, self.targets)


class Converter(Effect):
    """Encoders or load cells of few bits, as their data sheet has them: no effect of a case, but part of its robot.

    Args:
        kind: ``position`` or ``force``.
        steps: of each joint, (n,), or load cell, (2,).
        before: whether noise comes after rounding.
    """

    order = 85

    def __init__(self, kind: str, steps: Array, before: bool) -> None:
        super().__init__({}, [])
        self._kind, self._steps, self._before = kind, steps, before

    def _rounded(self, q: Array, x: Array) -> tuple[Array, Array]:
        if self._kind == "position":
            return np.floor(q / self._steps + 0.5) * self._steps, x
        return q, np.floor(x / self._steps + 0.5) * self._steps

    def converted(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        if self._before:
            q, x = self._rounded(q, x)
        return q, v, x

    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        if not self._before:
            q, x = self._rounded(q, x)
        return q, v, x


# Load cells ---------------------------------------------------------------------------------------------------------


class PadCreep(Effect):
    """Rubber: two relaxing parts, faster and slower than the time constant, that share the fraction."""

    order = 20

    def start(self, world: World) -> None:
        self._slow = np.zeros((2, *world.newtons.shape))

    def forces_read(self, x: Array, world: World) -> Array:
        for k, factor in enumerate((0.7, 1.4)):
            tau = self.values["time_constant"] * factor
            self._slow[k] += (1 - np.exp(-world.h / tau)) * (x - self._slow[k])
        return x - self.cells(self.values["fraction"]) * self._slow.mean(axis=0)


class ForceCrosstalk(Effect):
    order = 30

    def forces_read(self, x: Array, world: World) -> Array:
        return x + self.cells(self.values["ratio"]) * x[:, ::-1]


class ForceGain(Effect):
    order = 40

    def forces_read(self, x: Array, world: World) -> Array:
        return x * self.cells(self.values["factor"], 1.0)


class ForceNonlinearity(Effect):
    order = 41

    def forces_read(self, x: Array, world: World) -> Array:
        return x + self.cells(self.values["quadratic"]) * x * x


class ForceHysteresis(Effect):
    """Five plays of several widths (Prandtl-Ishlinskii), their mean width that of the contract's one."""

    order = 45
    SHARES = np.array([0.4, 0.7, 1.0, 1.3, 1.6])

    def start(self, world: World) -> None:
        self._plays = np.zeros((5, *world.newtons.shape))

    def forces_read(self, x: Array, world: World) -> Array:
        half = self.SHARES[:, None, None] * self.values["width"] / 2
        self._plays = np.clip(self._plays, x - half, x + half)
        return _some(x, self._plays.mean(axis=0), self.targets)


class ForceLag(Effect):
    """Two equal poles, together as late as one of the time constant."""

    order = 50

    def start(self, world: World) -> None:
        self._a = np.zeros_like(world.newtons)
        self._b = np.zeros_like(world.newtons)

    def forces_read(self, x: Array, world: World) -> Array:
        share = 1 - np.exp(-world.h / (self.values["time_constant"] / 2))
        self._a = self._a + share * (x - self._a)
        self._b = self._b + share * (self._a - self._b)
        return _some(x, self._b, self.targets)


class ForceDelay(Effect):
    """A conveyor of samples, read between two of them where the delay is no whole number of steps."""

    order = 55

    def start(self, world: World) -> None:
        self._steps = self.values["seconds"] / world.h
        self._line: list[Array] = []

    def forces_read(self, x: Array, world: World) -> Array:
        self._line.insert(0, x.copy())
        del self._line[int(self._steps) + 2 :]
        near = min(int(self._steps), len(self._line) - 1)
        far = min(near + 1, len(self._line) - 1)
        w = self._steps - int(self._steps)
        return _some(x, (1 - w) * self._line[near] + w * self._line[far], self.targets)


class ForceBias(Effect):
    order = 60

    def forces_read(self, x: Array, world: World) -> Array:
        return x + self.cells(self.values["offset"])


class ForceDrift(Effect):
    order = 61

    def forces_read(self, x: Array, world: World) -> Array:
        return x + self.cells(self.values["rate"]) * world.t


class ForceNoise(Effect):
    def noise_factor(self, world: World) -> Array:
        return self.cells(self.values["factor"], 1.0)


class ForceDeadZone(Effect):
    order = 70

    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        width = self.values["width"]
        return q, v, _some(x, np.sign(x) * np.maximum(np.abs(x) - width, 0.0), self.targets)


class ForceSaturation(Effect):
    """An amplifier at its rail, with a rounded knee (2 % of the limit)."""

    order = 71

    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        limit = self.values["limit"]
        knee = 0.02 * limit
        return q, v, _some(x, x - knee * np.logaddexp(0.0, (x - limit) / knee), self.targets)


class ForceQuantization(Effect):
    order = 80

    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        step = self.values["step"]
        return q, v, _some(x, np.floor(x / step + 0.5) * step, self.targets)


class ForceDropout(Effect):
    order = 90

    def start(self, world: World) -> None:
        self._last: Array | None = None

    def sampled(self, q: Array, v: Array, x: Array, world: World) -> tuple[Array, Array, Array]:
        if self._last is not None:
            missed = world.rng.random(x.shape) < self.cells(self.values["probability"])
            x = np.where(missed, self._last, x)
        self._last = x.copy()
        return q, v, x


# Clocks -------------------------------------------------------------------------------------------------------------


class ClockOffset(Effect):
    """What is logged at an instant was measured earlier."""

    def ready(self) -> None:
        self.late = self.values["seconds"]


class ClockSkew(Effect):
    def stamp(self, time: Array) -> Array:
        return time * (1 + self.values["rate"])
