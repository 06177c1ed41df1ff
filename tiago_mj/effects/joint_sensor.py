"""Encoders: from where a joint is to what is read."""

from __future__ import annotations

from tiago_mj.effects.command import rounded
from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import form, known_to, parameter
from tiago_mj.effects.memory import InARow, LowPass
from tiago_mj.effects.now import Now

LENGTH = ("m", "rad")


@effect("encoder_bias", stage="joint_sensor", targets="joint")
class EncoderBias(Effect):
    """A constant error of the position readings.

    Formula: reading = position + offset

    In a recording: the same offset everywhere, at rest too.

    Typical: below 1 mm, 10 mrad, after a poor homing.

    On the robot: put the joint on its zero mark and set the encoder's zero anew.

    Source: chosen.
    """

    clause = "the position readings of {t} are off by {offset}"
    nominal_prior = known_to((2e-5, 5e-4))
    signal_only = True

    offset = parameter(LENGTH, identity=0.0, default=0.001, bounds=((-0.01, 0.01), (-0.2, 0.2)))

    def measure_position(self, position: Array, now: Now) -> Array:
        return position + self.offset

    def true_position(self, measured: Array, now: Now) -> Array:
        return measured - self.offset


@effect("encoder_scale", stage="joint_sensor", targets="joint")
class EncoderScale(Effect):
    """Position readings, and the velocities that are made of them, times a factor.

    Formula: reading = factor · position

    In a recording: the error grows with the distance from zero.

    Typical: 0.98-1.02.

    On the robot: move the joint by a known angle or length and compare; look at the ticks a turn and the gear ratio.

    Source: chosen.
    """

    clause = "the position readings of {t} are {factor} times the true ones"
    signal_only = True

    factor = parameter("-", identity=1.0, default=1.05, bounds=(0.7, 1.4))

    def measure_position(self, position: Array, now: Now) -> Array:
        return position * self.factor

    def true_position(self, measured: Array, now: Now) -> Array:
        return measured / self.factor

    def measure_velocity(self, velocity: Array, now: Now) -> Array:
        return velocity * self.factor


@effect("encoder_quantization", stage="joint_sensor", targets="joint")
class EncoderQuantization(Effect):
    """Position readings are rounded to a grid.

    Formula: reading = step · round(position / step)

    In a recording: readings stand still and jump by equal steps.

    Typical: 1.53 mrad (4096 steps a turn).

    On the robot: look at the encoder's resolution and at how the driver rounds positions.

    Source: so101.
    """

    clause = "the position readings of {t} are rounded to steps of {step}"
    signal_only = True
    shows_as = "grid"
    rounds = "position"

    step = parameter(LENGTH, identity=0.0, default=0.0005, bounds=((0.0, 0.005), (0.0, 0.1)))

    def measure_position(self, position: Array, now: Now) -> Array:
        return rounded(position, self.step)


@effect("velocity_filter", stage="joint_sensor", targets="joint")
class VelocityFilter(Effect):
    """Reported velocities are low-passed.

    Formula: time_constant · dy/dt = velocity - y; with poles = 2 two equal ones in a row, each of half of it

    In a recording: velocities trail the derivative of the positions.

    Typical: 10-50 ms.

    On the robot: look for a filter of velocities in the driver.

    Source: chosen.
    """

    clause = "the reported velocity of {t} passes a low-pass of {time_constant}"
    signal_only = True

    time_constant = parameter("s", identity=0.0, default=0.04, bounds=(0.0, 0.3))
    poles = form(1, 2)

    def start(self, now: Now) -> None:
        self._filter = InARow(LowPass, self.time_constant, self.poles)

    def measure_velocity(self, velocity: Array, now: Now) -> Array:
        return self._filter(velocity, now.period)
