"""Clocks: when a measurement is said to have been made."""

from __future__ import annotations

from tiago_mj.effects.declare import Array, Effect, effect
from tiago_mj.effects.fields import known_to, parameter
from tiago_mj.effects.memory import SHIFTED, DelayLine
from tiago_mj.effects.now import Now


@effect("clock_offset", stage="timing", targets="clock", gap_class="delay")
class ClockOffset(Effect):
    """All measured channels are stamped late by a constant.

    Formula: measured(t) = true(t - seconds), for positions, velocities and forces alike

    In a recording: everything measured comes late by the same time, at every speed; nothing changes at rest.

    Typical: 0-25 ms in a bus loop.

    On the robot: look at which clock stamps commands and which stamps measurements, and synchronise them.

    Source: PACE.

    MuJoCo: a sensor's ``delay`` shifts that sensor alone; here one delay line holds every measured channel.
    """

    clause = "the measured channels are stamped {seconds} late"
    clause_less = "the measured channels are stamped {seconds} early"
    form_known_to = SHIFTED
    signal_only = True
    delays_readings = "seconds"
    effort_prior = known_to(0.5, share_of="row")

    seconds = parameter("s", identity=0.0, default=0.03, bounds=(0.0, 0.2))

    def start(self, now: Now) -> None:
        self._position, self._velocity, self._force = (DelayLine(self.seconds) for _ in range(3))

    def measure_position(self, position: Array, now: Now) -> Array:
        return self._position(position, now.period)

    def measure_velocity(self, velocity: Array, now: Now) -> Array:
        return self._velocity(velocity, now.period)

    def reading(self, reading: Array, now: Now) -> Array:
        return self._force(reading, now.period)  # the noise is each sample's own: a delay does not smooth it


@effect("clock_skew", stage="timing", targets="clock")
class ClockSkew(Effect):
    """The recorder's clock runs fast: a recorded second is 1 / (1 + rate) true seconds.

    Formula: true time = recorded time / (1 + rate)

    In a recording: motion looks slower by the factor, and the error of positions grows with the distance travelled.

    Typical: 0.003 where loop counts are taken for time; below 1e-4 for a quartz.

    On the robot: look at whether all computers follow one clock (NTP, PTP), and at the rate that is assumed.

    Source: so101 (a loop of nominally 50 Hz that ran at 49.85 Hz); the quartz is chosen.

    MuJoCo: each simulation has its own ``opt.timestep``.
    """

    clause = "the recorder's clock runs {rate%} fast"
    clause_less = "the recorder's clock runs {rate%} slow"

    rate = parameter("-", identity=0.0, default=0.005, bounds=(-0.05, 0.05), possible=(-0.9, 9.0))

    def place(self, now: Now) -> None:
        now.clock = now.clock / (1 + self.rate[:, 0])
