"""From the command that was sent to the set point that the servo takes."""

from __future__ import annotations

import numpy as np

from tiago_mj.gap.effects.chain import Now
from tiago_mj.gap.effects.declare import Array, Effect, effect, parameter
from tiago_mj.gap.effects.memory import DelayLine, Held, HeldLowPass

LENGTH = ("m", "rad")
SPEED = ("m/s", "rad/s")


@effect("command_delay", stage="command", targets="command", gap_class="delay")
class CommandDelay(Effect):
    """A command takes hold some time after it was sent.

    arriving(t) = sent(t - seconds); fractions of a control period by interpolation.

    In a recording: every motion starts and stops late; with a constant velocity the position is behind by velocity ·
    seconds.
    Typical: 0-25 ms on a bus (PACE), 68-92 ms on hobby servos (fitted on SO-101 recordings).
    """

    seconds = parameter("s", identity=0.0, default=0.03, bounds=(0.0, 0.2))

    def start(self, now: Now) -> None:
        self._line = DelayLine(self.seconds, now.idle)

    def command(self, command: Array, now: Now) -> Array:
        return self._line(command, now.period)


@effect("dropped_commands", stage="command", targets="command")
class DroppedCommands(Effect):
    """Some commands are lost; the one before stays in force.

    In a recording: nothing while the command is constant; where it changes, the change takes hold a period or more
    late, at random. Typical: below 1 % on a wired bus, 1-10 % over a loaded wireless link.
    """

    probability = parameter("-", identity=0.0, default=0.1, bounds=(0.0, 0.6))

    def start(self, now: Now) -> None:
        self._held = Held(now.idle)

    def command(self, command: Array, now: Now) -> Array:
        return self._held(command, now.uniform(command.shape) < self.probability)


@effect("command_lag", stage="command", targets="command", gap_class="lag")
class CommandLag(Effect):
    """A first-order low-pass lies on the command.

    time_constant · dy/dt = command - y.

    In a recording: starts and stops are rounded, a constant velocity trails by velocity · time_constant.
    Typical: 10-50 ms of smoothing in a driver.
    """

    time_constant = parameter("s", identity=0.0, default=0.04, bounds=(0.0, 0.3))

    def start(self, now: Now) -> None:
        self._filter = HeldLowPass(self.time_constant, now.idle)

    def command(self, command: Array, now: Now) -> Array:
        return self._filter(command, now.period)


@effect("rate_limit", stage="command", targets="command")
class RateLimit(Effect):
    """The servo's set point moves no faster than a limit.

    In a recording: fast commands are followed at a constant lower speed, slow ones exactly; what was missed is caught
    up later.
    Typical: the real gripper is run at 0.02-0.05 m/s, its simulation at 0.08 (facts on the 2021 and 2023 projects).
    """

    velocity = parameter(SPEED, identity=np.inf, default=0.6, bounds=(0.05, 1.0), nominal="velocity")

    def start(self, now: Now) -> None:
        self._value = now.set_point.copy()

    def set_point(self, target: Array, now: Now) -> Array:
        most = self.velocity * now.period
        self._value = np.where(self.present, self._value + np.clip(target - self._value, -most, most), target)
        return self._value


@effect("command_deadband", stage="command", targets="command")
class CommandDeadband(Effect):
    """A change of the set point smaller than a width is not executed.

    The servo takes a new set point only when it is farther than ``width`` from the one that it has.

    In a recording: slow motion goes in steps, small corrections have no effect, and forces held by small corrections
    are off.
    Typical: 0.1-0.3 mm on the real gripper's fingers (llach/learning_fc: commands below 0.3 mm are not sent).
    """

    width = parameter(LENGTH, identity=0.0, default=0.0003, bounds=(0.0, 0.003))

    def start(self, now: Now) -> None:
        self._value = now.set_point.copy()

    def set_point(self, target: Array, now: Now) -> Array:
        self._value = np.where(np.abs(target - self._value) >= self.width, target, self._value)
        return self._value


@effect("command_quantization", stage="command", targets="command")
class CommandQuantization(Effect):
    """The set point is rounded to a grid: step · round(set point / step).

    In a recording: slow motion goes in equal steps on a fixed grid. Typical: 1.53 mrad on servos with 4096 steps a
    turn.
    """

    step = parameter(LENGTH, identity=0.0, default=0.0005, bounds=(0.0, 0.003))

    def set_point(self, target: Array, now: Now) -> Array:
        return rounded(target, self.step)


def rounded(value: Array, step: Array) -> Array:
    """To the nearest multiple of a step; the value itself where the step is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(step > 0, step * np.round(value / step), value)
