"""Load cells: from the force on a pad to a reading, in the order of the signal."""

from __future__ import annotations

from typing import Final

import numpy as np

from tiago_mj.effects.command import rounded
from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import Usual, detail, form, known_to, parameter
from tiago_mj.effects.memory import DelayLine, Held, InARow, LowPass, Play
from tiago_mj.effects.now import Now

UNITS = "sensor units"
#: Plays of a hysteresis that has no corners (Prandtl and Ishlinskii's model).
PLAYS: Final = 5


@effect("pad_creep", stage="force_sensor", targets="sensor")
class PadCreep(Effect):
    """A viscoelastic pad relaxes under load.

    Formula: felt = force - fraction · y, time_constant · dy/dt = force - y; with a spread y is the mean of two such, of
    1 - spread and 1 + spread times the time constant

    In a recording: after loading, the force falls by the fraction over the time constant, and undershoots when
    released.

    Typical: 0.05-0.2 within a second for rubber and printed pads.

    On the robot: hold a constant weight on the pad for a minute: does its reading fade? Look at rubber and glue.

    Source: chosen.
    """

    clause = "{fraction%} of the force on {t} fades under load with a time constant of {time_constant}"
    signal_only = True

    fraction = parameter("-", identity=0.0, default=0.2, bounds=(0.0, 0.8), possible=(0.0, 1.0))
    time_constant = parameter("s", identity=None, default=0.3, bounds=(0.03, 3.0))
    spread = detail("-", (0.0, 0.9), usual=Usual(0.45, 0.3))

    def start(self, now: Now) -> None:
        apart = (-1.0, 1.0) if self.spread.any() else (0.0,)
        self._relaxed = [LowPass(self.time_constant * (1 + self.spread * share)) for share in apart]

    def contact_force(self, newtons: Array, now: Now) -> Array:
        relaxed = sum((part(newtons, now.period) for part in self._relaxed), np.zeros_like(newtons))
        return newtons - self.fraction * relaxed / len(self._relaxed)


@effect("force_crosstalk", stage="force_sensor", targets="sensor")
class ForceCrosstalk(Effect):
    """A part of the other finger's force appears in the reading.

    Formula: reading = x + ratio · x of the other finger

    In a recording: a finger reads before it touches.

    Typical: 0.02-0.38 by build.

    On the robot: load one cell alone and watch the other: look at wiring, ground and shared amplifiers.

    Source: chosen.
    """

    clause = "{ratio%} of the other finger's force appears in the readings of {t}"
    signal_only = True

    ratio = parameter("-", identity=0.0, default=0.1, bounds=(-0.6, 0.6))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading + self.ratio * reading[:, ::-1] if reading.shape[1] == 2 else reading


@effect("force_gain", stage="force_sensor", targets="sensor", gap_class="gain")
class ForceGain(Effect):
    """The load cell's gain is not the nominal one.

    Formula: reading = factor · x

    In a recording: all forces are off by the same factor, motion is as predicted.

    Typical: 0.75-1.25 between two series on one object.

    On the robot: put a known weight on the cell; look at the amplifier's gain and the calibration.

    Source: force_vs_displacement.
    """

    clause = "the gain of {t} is {factor} times the nominal one"
    nominal_prior = known_to(0.04)
    signal_only = True

    factor = parameter("-", identity=1.0, default=1.3, bounds=(0.2, 4.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading * self.factor


@effect("force_nonlinearity", stage="force_sensor", targets="sensor")
class ForceNonlinearity(Effect):
    """The load cell's curve bends.

    Formula: reading = x + quadratic · x²

    In a recording: small forces are right, large ones off.

    Typical: 0.01-0.1 at the end of the range.

    On the robot: put on three or more known weights and look at whether the readings lie on a line.

    Source: chosen.
    """

    clause = "the curve of {t} bends by {quadratic}"
    signal_only = True

    quadratic = parameter("1/sensor unit", identity=0.0, default=0.1, bounds=(-0.3, 1.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading + self.quadratic * reading * reading


@effect("force_hysteresis", stage="force_sensor", targets="sensor")
class ForceHysteresis(Effect):
    """Loading and unloading differ: a play operator of that width, which starts in the middle; with a spread the mean
    of five, whose widths lie evenly from 1 - spread to 1 + spread times the width.

    Formula: x - width / 2 ≤ reading ≤ x + width / 2, at rest in between

    In a recording: after each reversal of the force the reading stands still for the width.

    Typical: 0.01-0.1 of the range.

    On the robot: put on known weights and take them off again; look at how the cell is mounted.

    Source: chosen.
    """

    clause = "loading and unloading of {t} differ by {width}"
    signal_only = True

    width = parameter(UNITS, identity=0.0, default=0.1, bounds=(0.0, 0.8))
    spread = detail("-", (0.0, 1.0), usual=Usual(0.5, 0.3))

    def start(self, now: Now) -> None:
        apart = np.linspace(-1.0, 1.0, PLAYS) if self.spread.any() else np.zeros(1)
        self._plays = [Play(self.width * (1 + self.spread * share), np.zeros_like(self.width)) for share in apart]

    def reading(self, reading: Array, now: Now) -> Array:
        return sum((play(reading) for play in self._plays), np.zeros_like(reading)) / len(self._plays)


@effect("force_dead_zone", stage="force_sensor", targets="sensor")
class ForceDeadZone(Effect):
    """Small forces read zero, larger ones less by the width.

    Formula: reading = sign(x) · max(|x| - width, 0)

    In a recording: contact is noticed late, and all forces are low by a constant.

    Typical: 0.03-0.1: with 330 units per metre, the slack of 0.09-0.29 mm that is seen on the real gripper.

    On the robot: put on small weights: from which one does the cell read? Look at the threshold in the driver.

    Source: force_vs_displacement, where the command's dead band explains it as well.
    """

    clause = "{t} read{s} zero below {width}, and less by that much above"
    signal_only = True

    width = parameter(UNITS, identity=0.0, default=0.08, bounds=(0.0, 0.8))

    def reading(self, reading: Array, now: Now) -> Array:
        return np.sign(reading) * np.maximum(np.abs(reading) - self.width, 0.0)


@effect("force_drift", stage="force_sensor", targets="sensor")
class ForceDrift(Effect):
    """The zero moves at a constant rate from the start of the recording.

    Formula: reading = x + rate · t

    In a recording: a ramp on all readings, contact or not.

    Typical: minutes to warm up: visible in long recordings.

    On the robot: leave the cell unloaded for ten minutes; look at warm-up, temperature and supply.

    Source: chosen.
    """

    clause = "the zero of {t} drifts by {rate}"
    signal_only = True

    rate = parameter("sensor units/s", identity=0.0, default=0.1, bounds=(-1.0, 1.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading + self.rate * now.time


@effect("force_bias", stage="force_sensor", targets="sensor")
class ForceBias(Effect):
    """A constant is added to the readings.

    Formula: reading = x + offset

    In a recording: the same offset with and without contact.

    Typical: a tare that was taken under load.

    On the robot: read the cell unloaded and set its zero; look for a cable or a pad that presses on it.

    Source: chosen.
    """

    clause = "the readings of {t} are off by {offset}"
    nominal_prior = known_to(0.002)
    signal_only = True
    shows_as = "rest"

    offset = parameter(UNITS, identity=0.0, default=0.1, bounds=(-1.0, 1.0))

    def reading(self, reading: Array, now: Now) -> Array:
        return reading + self.offset


@effect("force_lag", stage="force_sensor", targets="sensor", gap_class="lag of force")
class ForceLag(Effect):
    """First-order low-pass of the reading.

    Formula: time_constant · dy/dt = x - y; with poles = 2 two equal ones in a row, each of half of it

    In a recording: contact onsets are rounded and late, holds are unchanged.

    Typical: 5-50 ms of filtering in the amplifier.

    On the robot: look for a filter in the amplifier or the driver of the cell.

    Source: chosen.
    """

    clause = "the readings of {t} pass a lag of {time_constant}"
    signal_only = True

    time_constant = parameter("s", identity=0.0, default=0.03, bounds=(0.0, 0.3))
    poles = form(1, 2)

    def start(self, now: Now) -> None:
        self._filter = InARow(LowPass, self.time_constant, self.poles)

    def reading(self, reading: Array, now: Now) -> Array:
        return self._filter(reading, now.period)


@effect("force_saturation", stage="force_sensor", targets="sensor")
class ForceSaturation(Effect):
    """The reading goes no higher than a limit; with a softness it falls short well below it, as of an amplifier.

    Formula: x / (1 + |x / limit|^(1 / softness))^softness, without a softness |reading| ≤ limit

    In a recording: a plateau, with sharp corners where nothing is soft; the motion does not know of it.

    Typical: the end of the amplifier's range. Amplifiers are modelled with a softness of 0.17 to 0.25; the range of a
    converter ends sharply.

    On the robot: look at the range of the amplifier and of the converter.

    Source: Rapp 1991.

    MuJoCo: a sensor's ``cutoff``, which is sharp.
    """

    clause = "the readings of {t} go no higher than {limit}"
    signal_only = True

    limit = parameter(UNITS, identity=np.inf, default=0.8, bounds=(0.05, 3.0))
    softness = detail("-", (0.0, 1.0), usual=Usual(0.15, 0.15))

    def reading(self, reading: Array, now: Now) -> Array:
        sharp = np.clip(reading, -self.limit, self.limit)
        if not self.softness.any():
            return sharp
        soft = np.where(self.softness > 0, self.softness, 1.0)
        with np.errstate(divide="ignore"):
            over = np.log(np.abs(reading) / self.limit)
        return np.where(self.softness > 0, reading * np.exp(-soft * np.logaddexp(0.0, over / soft)), sharp)


@effect("force_noise", stage="force_sensor", targets="sensor")
class ForceNoise(Effect):
    """The sensor's noise times a factor.

    Formula: reading = x + factor · noise

    In a recording: more or less scatter at rest, the mean unchanged.

    Typical: 0.26-1.7 of 0.0077: noise of 0.002 and 0.013 is in use for the same sensor.

    On the robot: look at shield, ground and cable of the cell, and at motors that start beside it.

    Source: the paper's section III-B; llach/learning_fc.

    MuJoCo: a sensor's ``noise`` is stored and not applied; it is drawn by the load cell.
    """

    clause = "the noise of {t} is {factor} times the nominal one"
    signal_only = True
    shows_as = "noise"
    by_chance = True

    factor = parameter("-", identity=1.0, default=3.0, bounds=(0.2, 20.0))

    def noise(self, noise: Array, now: Now) -> Array:
        return noise * self.factor


@effect("force_quantization", stage="force_sensor", targets="sensor")
class ForceQuantization(Effect):
    """Readings are rounded to a grid.

    Formula: reading = step · round(x / step)

    In a recording: readings stand still and jump by equal steps.

    Typical: 0.001-0.01: a 10-bit converter over the range.

    On the robot: look at the converter's resolution and at how the driver rounds readings.

    Source: chosen.
    """

    clause = "the readings of {t} are rounded to steps of {step}"
    signal_only = True
    shows_as = "grid"
    rounds = "force"

    step = parameter(UNITS, identity=0.0, default=0.05, bounds=(0.0, 0.4))

    def sample(self, sample: Array, now: Now) -> Array:
        return rounded(sample, self.step)


@effect("force_delay", stage="force_sensor", targets="sensor", gap_class="lag of force")
class ForceDelay(Effect):
    """Readings come late by a constant.

    Formula: reading(t) = x(t - seconds)

    In a recording: the force is right but late, onsets as steep as ever.

    Typical: one to three cycles of the readout.

    On the robot: look at the driver of the cell: its rate, its queues and what stamps its readings.

    Source: chosen.

    MuJoCo: a sensor's ``delay``.
    """

    clause = "the readings of {t} come {seconds} late"
    signal_only = True

    seconds = parameter("s", identity=0.0, default=0.03, bounds=(0.0, 0.2))

    def start(self, now: Now) -> None:
        self._line = DelayLine(self.seconds)

    def reading(self, reading: Array, now: Now) -> Array:
        return self._line(reading, now.period)


@effect("force_dropout", stage="force_sensor", targets="sensor")
class ForceDropout(Effect):
    """Some readings are missed; the one before stays.

    Formula: reading(k) = reading(k - 1) with the probability, else x(k)

    In a recording: exact repeats of a noisy reading.

    Typical: 0.01-0.1: a readout that is slower than the recorder.

    On the robot: look at the cell's bus and connector, and at rates that do not fit together.

    Source: chosen.

    MuJoCo: a sensor's ``interval`` repeats regularly, not at random.
    """

    clause = "{probability%} of the readings of {t} are missed"
    signal_only = True
    shows_as = "repeats"
    by_chance = True

    probability = parameter("-", identity=0.0, default=0.05, bounds=(0.0, 0.8), possible=(0.0, 1.0))

    def start(self, now: Now) -> None:
        self._held = Held()

    def sample(self, sample: Array, now: Now) -> Array:
        return self._held(sample, now.uniform(sample.shape) < self.probability)
