"""From the command that was sent to the set point that the servo takes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Final

import numpy as np

from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import detail, form, known_to, parameter, usually
from tiago_mj.effects.memory import SHIFTED, Conveyor, Held, HeldLowPass, InARow
from tiago_mj.effects.now import Now

LENGTH = ("m", "rad")
SPEED = ("m/s", "rad/s")
#: Speed at which a set point may jump [m/s, rad/s].
AT_ONCE: Final = 1e6
#: So near to a whole number of physics steps is one.
WHOLE: Final = 1e-9
#: ``interp="linear"`` of an actuator, as MuJoCo numbers it.
LINEAR: Final = 1


@effect("command_delay", stage="command", targets="command", gap_class="delay")
class CommandDelay(Effect):
    """A command takes hold some time after it was sent.

    Formula: arriving(t) = sent(t - seconds), to a fraction of a physics step

    In a recording: every motion starts and stops late; at a constant velocity the position is behind by velocity ·
    seconds.

    Typical: 0-25 ms in a bus loop, 68-92 ms on hobby servos.

    On the robot: look at the driver's bus, at queues and buffers on the way, and at what stamps the log.

    Source: PACE; fitted on so101.

    MuJoCo: an actuator's ``delay``, with ``nsample`` and ``interp="linear"``, is the same from one physics step on;
    here the line takes fractions of a step and vanishes exactly. It lies right before the servo: what else happens to a
    command does not depend on when.
    """

    clause = "{t} act{s} on commands {seconds} later than in the simulator"
    nominal_prior = known_to(1e-3, each=False)
    form_known_to = SHIFTED
    twins = ("clock_offset",)
    signal_only = True

    seconds = parameter("s", identity=0.0, default=0.03, bounds=(0.0, 0.2))

    def start(self, now: Now) -> None:
        self._line = Conveyor(self.seconds, now.resting)

    def given(self, inputs: Array, now: Now) -> Array:
        return self._line(inputs, now.period / now.substeps)

    def model_attributes(self, now: Now) -> Mapping[str, Array] | None:
        steps = self.seconds / (now.period / now.substeps)
        # MuJoCo reads before it writes: its shortest delay is one step.
        if (self.present & (steps < 1 - WHOLE)).any():
            return None
        # One sample more than the delay needs, so that rounding never asks for what is forgotten.
        samples = np.where(self.present, np.ceil(steps - WHOLE) + 1, 0)
        return {"delay": self.seconds, "nsample": samples, "interp": np.where(self.present, LINEAR, 0)}


@effect("dropped_commands", stage="command", targets="command")
class DroppedCommands(Effect):
    """Some commands are lost; the one before stays in force.

    Formula: arriving(k) = arriving(k - 1) with the probability, else sent(k)

    In a recording: nothing while the command is constant; where it changes, the change takes hold a period or more
    late, at random.

    Typical: 0.01 on a wired bus, 0.01-0.1 on a loaded wireless link.

    On the robot: look at the bus's load and error counters, and for a controller that misses its cycle.

    Source: chosen.
    """

    clause = "{probability%} of the commands to {t} are lost"
    taken_up_by = ("command_delay",)
    loses_commands = True
    signal_only = True
    by_chance = True

    probability = parameter("-", identity=0.0, default=0.1, bounds=(0.0, 0.6), possible=(0.0, 1.0))

    def start(self, now: Now) -> None:
        self._held = Held(now.idle)

    def command(self, command: Array, now: Now) -> Array:
        return self._held(command, now.uniform(command.shape) < self.probability)


@effect("command_lag", stage="command", targets="command", gap_class="lag")
class CommandLag(Effect):
    """A first-order low-pass lies on the command.

    Formula: time_constant · dy/dt = command - y; with poles = 2 two equal ones in a row, each of half of it. A position
    is commanded for the end of a control period: the set point goes to what y is by then, no faster than its limit.

    In a recording: starts and stops are rounded; at a constant velocity the position is behind by velocity ·
    time_constant.

    Typical: 10-50 ms of smoothing in a driver.

    On the robot: look for a filter or a smoothing of set points in the driver or the controller.

    Source: chosen.

    MuJoCo: ``dyntype="filterexact"`` filters an actuator's control; an integrating servo has no room for a second
    state.
    """

    resembles = ("command_delay",)
    clause = "the commands to {t} pass a lag of {time_constant}"
    signal_only = True

    time_constant = parameter("s", identity=0.0, default=0.04, bounds=(0.0, 0.3))
    poles = form(1, 2)

    def start(self, now: Now) -> None:
        self._filter = InARow(HeldLowPass, self.time_constant, self.poles, now.resting)
        self._positions = InARow(HeldLowPass, self.time_constant, self.poles, now.idle)
        # Servos whose set points slew have a position slew to it; plain ones are given it.
        slews = ~now.takes_set_points & (now.wiring.interface == "position")
        self._slewing = np.broadcast_to(slews, self.time_constant.shape)

    def command(self, command: Array, now: Now) -> Array:
        if not self._slewing.any():
            return command
        step = now.period / now.substeps
        for _ in range(now.substeps):
            reached = self._positions(command, step)
        return np.where(self._slewing, reached, command)

    def given(self, inputs: Array, now: Now) -> Array:
        if self._slewing.all():
            return inputs
        step = now.period / now.substeps
        lagging = np.stack([self._filter(inputs[:, k], step) for k in range(inputs.shape[1])], axis=1)
        return np.where(self._slewing[:, None], inputs, lagging)


@effect("rate_limit", stage="command", targets="command")
class RateLimit(Effect):
    """The servo's set point moves no faster than a limit.

    Formula: |d set point / dt| ≤ velocity; with a ramp its speed follows with that time constant

    In a recording: fast commands are followed at a constant lower speed, slow ones exactly; what was missed is caught
    up later.

    Typical: 0.25-0.6 of what is commanded: the real gripper is run at 0.02-0.05 m/s, its simulation at 0.08 m/s.

    On the robot: look at the limits of speed and acceleration set in the driver or the controller.

    Source: the 2021 and 2023 projects' settings (llach/tiago_rl, llach/learning_fc).

    MuJoCo: ``slewmax`` of a ``pid`` actuator.
    """

    clause = "the set point of {t} moves no faster than {velocity}"
    needs_servo = True
    signal_only = True

    velocity = parameter(SPEED, identity=np.inf, default=0.6, bounds=(0.05, 1.0), nominal="velocity")
    #: Time constant with which the set point's own speed follows.
    ramp = detail("s", (0.0, 0.1), usual=usually(0.005))

    def start(self, now: Now) -> None:
        self._wanted, self._value = now.set_point.copy(), now.set_point.copy()
        self._speed = np.zeros_like(self._value)

    def given(self, inputs: Array, now: Now) -> Array:
        # What was missed is caught up until the set point is met, which is somewhere within a control period.
        seconds, speeds = now.period / now.substeps, ~now.takes_set_points
        out, most = inputs.copy(), self.velocity * seconds
        for k in range(inputs.shape[1]):
            moved = np.clip(self._wanted + inputs[:, k] * seconds, *now.wiring.span.T)
            self._wanted = np.where(speeds, moved, inputs[:, k])
            value = self._value + np.clip(self._wanted - self._value, -most, most)
            if self.ramp.any():
                value = np.where(self.ramp > 0, self._ramped(seconds), value)
            out[:, k] = np.where(speeds, (value - self._value) / seconds, value)
            self._value = value
        return out

    def _ramped(self, seconds: Array) -> Array:
        """The set point a physics step later where its speed takes time to grow; where it arrives it stops."""
        apart = self._wanted - self._value
        share = 1 - np.exp(-seconds / np.where(self.ramp > 0, self.ramp, 1.0))
        self._speed = self._speed + share * (np.clip(apart / seconds, -self.velocity, self.velocity) - self._speed)
        arrives = np.abs(apart) <= np.abs(self._speed) * seconds
        return np.where(arrives, self._wanted, self._value + self._speed * seconds)


class Stepping(Effect, ABC):
    """What passes a servo's set point on in steps: of each command, or, with a ``period``, of what the servo is given,
    which follows the commands no faster than the joint's limit, whenever its driver looks at it; it then jumps.

    A driver that looks more often than the physics steps looks in each of them; the first look is at the start."""

    #: How often the driver looks [s]; 0: at every command.
    period: Array

    @abstractmethod
    def took(self, wanted: Array) -> Array:
        """The set point that is passed on, (nsim, nactuators) [m, rad]; ``self.taken`` is the one before."""

    def change(self, now: Now) -> None:
        # What jumps has no speed: the limit of it lies before, as does that of where commands lead.
        jumping = (self.present & (self.period > 0))[:, now.wiring.act >= 0]
        actuators = now.wiring.actuators[now.wiring.act >= 0]
        for field in ("actuator_ctrlrange", "actuator_actrange"):
            limits = now.host.field(field)
            limits[:, actuators] = np.where(jumping[..., None], (-AT_ONCE, AT_ONCE), limits[:, actuators])

    def start(self, now: Now) -> None:
        self._wanted, self.taken = now.set_point.copy(), now.set_point.copy()
        self._time = np.zeros_like(self.period)
        # A look at the start finds a set point that follows speeds where it was, and one that is given there.
        self._next = np.where(now.takes_set_points, 0.0, self.period)

    def set_point(self, target: Array, now: Now) -> Array:
        looks = self.period > 0
        self.taken = np.where(looks, self.taken, self.took(target))
        return np.where(looks, target, self.taken)

    def given(self, inputs: Array, now: Now) -> Array:
        driver = self.period > 0
        if not driver.any():
            return inputs
        seconds, speeds = now.period / now.substeps, ~now.takes_set_points
        out, period = inputs.copy(), np.where(driver, self.period, 1.0)
        often = period <= seconds  # in every physics step
        for k in range(inputs.shape[1]):
            moved = np.clip(self._wanted + inputs[:, k] * seconds, *now.wiring.span.T)
            # What follows speeds is where they lead at the end of the step, what is given is there from its start on.
            last = self._time + seconds + np.where(speeds, WHOLE, -WHOLE)
            looking = self._next <= last
            at = np.maximum(np.floor(last / period) * period, self._next)
            share = np.where(often, speeds, np.clip((at - self._time) / seconds, 0.0, 1.0))
            seen = np.where(speeds, self._wanted + share * (moved - self._wanted), inputs[:, k])
            taken = np.where(looking, self.took(seen), self.taken)
            mean = share * self.taken + (1 - share) * taken
            out[:, k] = np.where(driver, np.where(speeds, (taken - self.taken) / seconds, mean), inputs[:, k])
            self.taken = np.where(driver, taken, self.taken)
            self._wanted = np.where(speeds, moved, inputs[:, k])
            self._next = np.where(looking, at + period, self._next)
            self._time = self._time + seconds
        return out


@effect("command_deadband", stage="command", targets="command")
class CommandDeadband(Stepping):
    """A change of the set point smaller than a width is not executed.

    The servo takes a new set point only when it is at least the width from the one that it has.

    Formula: taken(k) = set point(k) if |set point(k) - taken(k - 1)| ≥ width, else taken(k - 1): of each command, or
    with a period whenever so much time has passed, of what the servo is given, which follows the commands no faster
    than the joint's limit; it then jumps

    In a recording: slow motion goes in steps, small corrections have no effect, and forces held by small corrections
    are off.

    Typical: 0.09-0.29 mm on the real gripper's fingers.

    On the robot: look for a dead band or a position tolerance set in the driver.

    Source: force_vs_displacement; llach/learning_fc sends no command below 0.3 mm.
    """

    clause = "{t} ignore{s} changes of the set point below {width}[, looked at every {period}]"
    needs_servo = True
    signal_only = True

    width = parameter(LENGTH, identity=0.0, default=0.0003, bounds=((0.0, 0.003), (0.0, 0.1)))
    period = parameter("s", identity=None, default=0.0, bounds=(0.0, 0.05), tried=(0.0, 0.005))

    def took(self, wanted: Array) -> Array:
        return np.where(np.abs(wanted - self.taken) >= self.width, wanted, self.taken)


@effect("command_quantization", stage="command", targets="command")
class CommandQuantization(Stepping):
    """The set point is rounded to a grid.

    Formula: taken = step · round(set point / step): of each command, or with a period whenever so much time has passed,
    of what the servo is given, which follows the commands no faster than the joint's limit; it then jumps

    In a recording: slow motion goes in equal steps on a fixed grid.

    Typical: 1.53 mrad on servos with 4096 steps a turn.

    On the robot: look at how commands are rounded: resolution of the bus message, ticks of the driver.

    Source: so101.
    """

    clause = "the set point of {t} is rounded to steps of {step}[ every {period}]"
    needs_servo = True
    signal_only = True

    step = parameter(LENGTH, identity=0.0, default=0.0005, bounds=((0.0, 0.003), (0.0, 0.1)))
    period = parameter("s", identity=None, default=0.0, bounds=(0.0, 0.05), tried=(0.0, 0.001))

    def took(self, wanted: Array) -> Array:
        return rounded(wanted, self.step)


def rounded(value: Array, step: Array) -> Array:
    """To the nearest multiple of a step; the value itself where the step is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(step > 0, step * np.round(value / step), value)
