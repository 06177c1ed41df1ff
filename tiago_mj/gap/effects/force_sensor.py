"""Load cells: from the force on a pad to a reading, in the order of the signal."""

from __future__ import annotations

import numpy as np

from tiago_mj.gap.effects.chain import Now
from tiago_mj.gap.effects.command import rounded
from tiago_mj.gap.effects.declare import Array, Effect, effect, parameter
from tiago_mj.gap.effects.memory import DelayLine, Held, LowPass, Play

UNITS = "sensor units"


@effect("pad_creep", stage="force_sensor", targets="sensor")
class PadCreep(Effect):
    """A viscoelastic pad relaxes under load: force - fraction · (force through a low-pass).

    In a recording: after loading, the force falls by the fraction over the time constant, and undershoots when
    released.
    Typical: 5-20 % within a second for rubber and printed pads.
    """

    fraction = parameter("-", identity=0.0, default=0.2, bounds=(0.0, 0.8))
    time_constant = parameter("s", identity=None, default=0.3, bounds=(0.03, 3.0))

    def start(self, now: Now) -> None:
        self._relaxed = LowPass(self.time_constant)

    def contact_force(self, newtons: Array, now: Now) -> Array:
        return newtons - self.fraction * self._relaxed(newtons, now.period)


@effect("force_crosstalk", stage="force_sensor", targets="sensor")
class ForceCrosstalk(Effect):
    """A part of the other finger's force appears in the reading.

    In a recording: a finger reads before it touches. Typical: 2-38 % by build.
    """

    ratio = parameter("-", identity=0.0, default=0.1, bounds=(-0.6, 0.6))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading + self.ratio * reading[:, ::-1] if reading.shape[1] == 2 else reading


@effect("force_gain", stage="force_sensor", targets="sensor", gap_class="gain")
class ForceGain(Effect):
    """The load cell's gain is not the nominal one.

    In a recording: all forces are off by the same factor, motion is as predicted. Typical: 0.8-1.2 between two copies.
    """

    factor = parameter("-", identity=1.0, default=1.3, bounds=(0.2, 4.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading * self.factor


@effect("force_nonlinearity", stage="force_sensor", targets="sensor")
class ForceNonlinearity(Effect):
    """The curve bends: reading = x + quadratic · x².

    In a recording: small forces are right, large ones off. Typical: 1-10 % of the range.
    """

    quadratic = parameter("1/sensor unit", identity=0.0, default=0.1, bounds=(-0.3, 1.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading + self.quadratic * reading * reading


@effect("force_hysteresis", stage="force_sensor", targets="sensor")
class ForceHysteresis(Effect):
    """Loading and unloading differ: a play operator of that width.

    In a recording: after each reversal of the force the reading stands still for the width. Typical: 1-10 % of the
    range.
    """

    width = parameter(UNITS, identity=0.0, default=0.1, bounds=(0.0, 0.8))

    def start(self, now: Now) -> None:
        self._play = Play(self.width, np.zeros_like(self.width))

    def reading(self, reading: Array, now: Now) -> Array:
        return self._play(reading)


@effect("force_dead_zone", stage="force_sensor", targets="sensor")
class ForceDeadZone(Effect):
    """Small forces read zero, larger ones less by the width.

    In a recording: contact is noticed late, and all forces are low by a constant. Typical: slack in the sensor's mount.
    """

    width = parameter(UNITS, identity=0.0, default=0.08, bounds=(0.0, 0.8))

    def reading(self, reading: Array, now: Now) -> Array:
        return np.sign(reading) * np.maximum(np.abs(reading) - self.width, 0.0)


@effect("force_drift", stage="force_sensor", targets="sensor")
class ForceDrift(Effect):
    """The zero moves at a constant rate from the start of the recording.

    In a recording: a ramp on all readings, contact or not. Typical: minutes to warm up; visible in long recordings.
    """

    rate = parameter("sensor units/s", identity=0.0, default=0.1, bounds=(-1.0, 1.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading + self.rate * now.time


@effect("force_bias", stage="force_sensor", targets="sensor")
class ForceBias(Effect):
    """A constant is added to the readings.

    In a recording: the same offset without contact too. Typical: a tare that was taken under load.
    """

    offset = parameter(UNITS, identity=0.0, default=0.1, bounds=(-1.0, 1.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading + self.offset


@effect("force_lag", stage="force_sensor", targets="sensor", gap_class="lag of force")
class ForceLag(Effect):
    """First-order low-pass of the reading: time_constant · dy/dt = x - y.

    In a recording: contact onsets are rounded and late, holds are unchanged. Typical: 5-50 ms of filtering in the
    amplifier.
    """

    time_constant = parameter("s", identity=0.0, default=0.03, bounds=(0.0, 0.3))

    def start(self, now: Now) -> None:
        self._filter = LowPass(self.time_constant)

    def reading(self, reading: Array, now: Now) -> Array:
        return self._filter(reading, now.period)


@effect("force_saturation", stage="force_sensor", targets="sensor")
class ForceSaturation(Effect):
    """The reading goes no higher than a limit.

    In a recording: a plateau with sharp corners. Typical: the amplifier's supply.
    """

    limit = parameter(UNITS, identity=np.inf, default=0.8, bounds=(0.05, 3.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return np.clip(reading, -self.limit, self.limit)


@effect("force_noise", stage="force_sensor", targets="sensor")
class ForceNoise(Effect):
    """The sensor's noise times a factor.

    In a recording: more or less scatter at rest, the mean unchanged. Typical: 1-5 with cable and supply.
    """

    factor = parameter("-", identity=1.0, default=3.0, bounds=(0.2, 20.0))

    def noise(self, noise: Array, now: Now) -> Array:
        return noise * self.factor


@effect("force_quantization", stage="force_sensor", targets="sensor")
class ForceQuantization(Effect):
    """Readings are rounded to a grid.

    In a recording: readings stand still and jump by equal steps. Typical: a 10-bit converter over the range.
    """

    step = parameter(UNITS, identity=0.0, default=0.05, bounds=(0.0, 0.4))

    def sample(self, sample: Array, now: Now) -> Array:
        return rounded(sample, self.step)


@effect("force_delay", stage="force_sensor", targets="sensor", gap_class="lag of force")
class ForceDelay(Effect):
    """Readings come late by a constant.

    In a recording: the force is right but late, onsets as steep as ever. Typical: one to three cycles of the readout.
    """

    seconds = parameter("s", identity=0.0, default=0.03, bounds=(0.0, 0.2))

    def start(self, now: Now) -> None:
        self._line = DelayLine(self.seconds)

    def reading(self, reading: Array, now: Now) -> Array:
        return self._line(reading, now.period)


@effect("force_dropout", stage="force_sensor", targets="sensor")
class ForceDropout(Effect):
    """Some readings are missed; the one before stays.

    In a recording: exact repeats of a noisy reading. Typical: a readout slower than the recorder.
    """

    probability = parameter("-", identity=0.0, default=0.05, bounds=(0.0, 0.8))

    def start(self, now: Now) -> None:
        self._held = Held()

    def sample(self, sample: Array, now: Now) -> Array:
        return self._held(sample, now.uniform(sample.shape) < self.probability)
