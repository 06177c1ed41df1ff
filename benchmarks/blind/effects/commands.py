"""On the way from what is commanded to the force of the drive."""

from __future__ import annotations

import mujoco
import numpy as np

from benchmarks.blind.effects.base import Array, Effect, World
from benchmarks.blind.robots import Robot, press


class CommandDelay(Effect):
    """A command is queued and takes hold after a time, whatever the steps are."""

    def latency(self, world: World) -> Array:
        return self.on(world, self.values["seconds"])


class DroppedCommands(Effect):
    """A packet is lost; the receiver keeps what it had."""

    def start(self, world: World) -> None:
        self._last: Array | None = None

    def sent(self, command: Array, world: World) -> Array:
        if self._last is None:
            self._last = command.copy()
        lost = world.rng.random(command.shape) < self.on(world, self.values["probability"])
        self._last = np.where(lost, self._last, command)
        return self._last


class CommandLag(Effect):
    """Two equal poles in a row, each half the time constant: the same delay at low frequency as one.

    A position is commanded for the end of a control period: the set point goes to what the lag makes of it by then.
    """

    def start(self, world: World) -> None:
        self._a, self._b = world.idle.copy(), world.idle.copy()

    def shaped(self, command: Array, world: World) -> Array:
        pole = self.values["time_constant"] / 2
        share = 1 - np.exp(-world.h / pole)
        self._a = self._a + share * (command - self._a)
        self._b = self._b + share * (self._a - self._b)
        left, ahead = np.exp(-world.ahead / pole), world.ahead / pole
        then = command + left * (self._b - command + ahead * (self._a - command))
        out = command.copy()
        out[:, self.targets] = then[:, self.targets]
        return out


class RateLimit(Effect):
    """The drive's profile follows the set point at no more than a speed; it brakes within 2 ms instead of at once."""

    def start(self, world: World) -> None:
        self._at: Array | None = None
        self._speed = np.zeros_like(world.q)

    def executed(self, point: Array, world: World) -> Array:
        if self._at is None:
            self._at = point.copy()
        top = self.values["velocity"]
        wanted = np.clip((point - self._at) / world.h, -top, top)
        self._speed += (1 - np.exp(-world.h / 0.002)) * (wanted - self._speed)
        settled = np.abs(point - self._at) <= np.abs(self._speed) * world.h
        self._at = np.where(settled, point, self._at + self._speed * world.h)
        out = point.copy()
        out[:, self.targets] = self._at[:, self.targets]
        return out


class CommandDeadband(Effect):
    """A driver that looks at the set point every 5 ms and passes it on only where it moved by the width."""

    order = 60

    def start(self, world: World) -> None:
        self._held: Array | None = None
        self._next = 0.0

    def executed(self, point: Array, world: World) -> Array:
        if self._held is None:
            self._held = point.copy()
        if world.t >= self._next - 1e-9:
            self._next += 0.005
            moved = np.abs(point - self._held) >= self.values["width"]
            self._held = np.where(moved, point, self._held)
        out = point.copy()
        out[:, self.targets] = self._held[:, self.targets]
        return out


class CommandQuantization(Effect):
    """The set point is a whole number of counts from the joint's zero."""

    order = 61

    def executed(self, point: Array, world: World) -> Array:
        step = self.values["step"]
        out = point.copy()
        out[:, self.targets] = np.floor(out[:, self.targets] / step + 0.5) * step
        return out


class ServoStiffness(Effect):
    """Another gain in the drive."""

    def start(self, world: World) -> None:
        world.stiffness = world.stiffness * self.on(world, self.values["factor"], 1.0)


class ServoDamping(Effect):
    """A derivative gain on a velocity that the drive estimates from its encoder, over 2 ms."""

    def start(self, world: World) -> None:
        self._slow = world.q.copy()

    def control(self, force: Array, world: World) -> Array:
        share = 1 - np.exp(-world.h / 0.002)
        rate = (world.q - self._slow) * share / world.h  # at a constant velocity that velocity
        self._slow += share * (world.q - self._slow)
        return force - self.on(world, self.values["damping"]) * rate


class ForceLimit(Effect):
    """The drive saturates earlier, with a rounded knee (3 % of the limit)."""

    order = 40

    def drive(self, force: Array, world: World) -> Array:
        limit = self.values["limit"]
        knee = 0.03 * limit
        excess = np.abs(force) - limit
        world.free = world.free & (excess < 0)
        soft = np.abs(force) - knee * np.logaddexp(0.0, excess / knee)
        out = force.copy()
        out[:, self.targets] = (np.sign(force) * np.maximum(soft, 0.0))[:, self.targets]
        return out


class TorqueConstant(Effect):
    """The motor makes less force of the same current, everywhere behind the limit."""

    order = 45

    def drive(self, force: Array, world: World) -> Array:
        return force * self.on(world, self.values["factor"], 1.0)


class VelocityLimit(Effect):
    """Back-EMF: at the top speed no more force is left than keeps that speed, and beyond it the motor brakes.

    The slope of a real motor's curve there is steeper than a physics step can follow, so the force is the one that
    brings the joint to the top speed within two steps, given what resisted in the last.
    """

    order = 46

    def start(self, world: World) -> None:
        robot = world.robot
        several = robot.models or [robot.model]
        drag = np.array([model.dof_damping[robot.dof] for model in several])
        self._drag = drag if robot.models else drag[0]
        self._before, self._gave = world.v.copy(), np.zeros_like(world.v)

    def drive(self, force: Array, world: World) -> Array:
        top, mass = self.values["velocity"], world.robot.inertia
        resisted = self._gave - mass * (world.v - self._before) / world.h - self._drag * world.v
        reserve = 0.5 * mass / world.h
        most = resisted + reserve * (top - world.v) + self._drag * top
        least = resisted - reserve * (top + world.v) - self._drag * top
        out = force.copy()
        out[:, self.targets] = np.clip(force, least, most)[:, self.targets]
        self._before, self._gave = world.v.copy(), out
        return out


class MotorCogging(Effect):
    """Detent force over position, not quite a sine: its second harmonic is a tenth.

    The contract's effect has an amplitude and a period, and no phase: at the joint's zero it vanishes. Another phase
    would be an effect that no parameters of the contract describe.
    """

    def drive(self, force: Array, world: World) -> Array:
        angle = 2 * np.pi * world.q / self.values["period"]
        return force + self.on(world, self.values["amplitude"]) * (np.sin(angle) + 0.1 * np.sin(2 * angle))


class CouplingError(Effect):
    """The fingers' drives pull on each other: one follows a part of what the other has moved."""

    def start(self, world: World) -> None:
        self._home = world.q.copy()

    def executed(self, point: Array, world: World) -> Array:
        moved = world.q - self._home
        out = point.copy()
        for column in self.targets:
            other = column + (1 if column == world.q.shape[1] - 2 else -1)
            out[:, column] += self.values["ratio"] * moved[:, other]
        return np.clip(out, world.robot.low, world.robot.high)


class Armature(Effect):
    """More mass on a slide (weightless, as a rotor is), more rotor inertia on a hinge."""

    def build(self, robot: Robot) -> None:
        model = robot.model
        for column in self.targets:
            model.dof_armature[model.joint(robot.joints[column]).dofadr[0]] += self.values["mass"]
        # What follows from inertias: how far the joint's own dry friction gives, a contact's stiffness.
        mujoco.mj_setConst(model, mujoco.MjData(model))
        if robot.item is not None:
            press(model, robot.item.stiffness, robot.item.damping)
