"""Command programs of the recordings: grasps under force control, squeezes, waves, free motions; another mix in
every trial.

A program is a generator that is sent what was measured and yields the speeds of the set points. In velocity control
they are the commands; in position control they are added up to targets.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.robots import FINGER_SPEED, Robot

Array = NDArray[np.float64]
Seen = tuple[float, Array, Array]
Program = Generator[Array, Seen, None]

#: A reading this far above the first ones counts as touch [sensor units].
TOUCH = 0.12
#: Longest approach [s].
PATIENCE = 3.5
#: Opening at which a session's fingers begin [m].
OPEN = 0.045
#: No user closes faster than this [m/s].
FASTEST = 0.07


@dataclass(frozen=True)
class Style:
    """How a session is moved.

    Attributes:
        softness: of what yields in contact, over the nominal servo's: scales depths and gains. A finger whose velocity
            is a constraint has only the object's contact to yield.
        pace: seconds of everything, over those of a session of 10 s; speeds and gains grow as its root falls.
        start: opening at which the fingers begin [m].
    """

    softness: float = 1.0
    pace: float = 1.0
    start: float = OPEN

    def seconds(self, seconds: float) -> float:
        """A time."""
        return seconds * self.pace

    def speed(self, speed: float) -> float:
        """A speed [m/s]."""
        return min(speed / self.pace**0.5, FASTEST)

    def often(self, frequency: float) -> float:
        """A frequency [Hz]."""
        return frequency / self.pace**0.5

    def gain(self, gain: float) -> float:
        """A gain of force control [m/s per sensor unit]."""
        return self.softness * gain / self.pace**0.5


PLAIN = Style()


class Conductor:
    """Runs one program a trial; gives the commands of all trials.

    Args:
        programs: one a trial.
        robot: for limits.
        interface: ``velocity``, ``position`` or ``direct``.
        start: (ntrials, n) first set points.
        period: of control [s].
        acceleration: of the commands [per s²]; None: they may jump, as a force controller's do.
    """

    def __init__(
        self,
        programs: list[Program],
        robot: Robot,
        interface: str,
        start: Array,
        period: float,
        acceleration: float | None = None,
    ) -> None:
        self._programs, self._interface, self._period = programs, interface, period
        self._low, self._high, self._speed = robot.low, robot.high, robot.speed
        self._target = start.copy()
        self._sent = np.zeros_like(start)
        self._step = np.inf if acceleration is None else acceleration * period

    def __call__(self, row: int, t: float, q: Array, f: Array) -> Array:
        speed = np.zeros_like(self._target)
        for k, program in enumerate(self._programs):
            try:
                speed[k] = next(program) if row == 0 else program.send((t, q[k], f[k]))
            except StopIteration:
                speed[k] = 0.0
        speed = np.clip(speed, -self._speed, self._speed)
        self._sent = speed = np.clip(speed, self._sent - self._step, self._sent + self._step)
        moved = np.clip(self._target + speed * self._period, self._low, self._high)
        if self._interface == "velocity":
            return speed
        self._target = moved
        return moved.copy()


def _for(seconds: float, speed: Array, now: list[float]) -> Program:
    """Keep a speed for a time."""
    end = now[0] + seconds
    while now[0] < end - 1e-9:
        seen = yield speed
        now[0] = seen[0]


def _approach(speed: float, style: Style, zero: Array, now: list[float]) -> Program:
    """Close until both pads touch; a finger that touches waits for the other."""
    speed, end = style.speed(speed), now[0] + style.seconds(PATIENCE)
    move = np.full(2, -speed)
    while now[0] < end:
        t, _, f = yield move
        now[0] = t
        touched = f - zero > TOUCH
        if touched.all():
            return
        move = np.where(touched, 0.0, -speed)


def _hold(goal: float, seconds: float, gain: float, style: Style, zero: Array, now: list[float]) -> Program:
    """PI on both forces."""
    end, gain = now[0] + style.seconds(seconds), style.gain(gain)
    whole = np.zeros(2)
    last = now[0]
    move = np.zeros(2)
    while now[0] < end - 1e-9:
        t, _, f = yield move
        now[0] = t
        error = goal - (f - zero)
        whole = np.clip(whole + error * (t - last), -2, 2)
        last = t
        move = -np.clip(gain * error + 0.5 * gain * whole, -0.03, 0.03)


def _tare(style: Style, now: list[float]) -> Generator[Array, Seen, Array]:
    """Stand still for a moment and take the mean of the readings."""
    seen: list[Array] = []
    while len(seen) < 6 or now[0] < style.seconds(0.2) - 1e-9:
        t, _, f = yield np.zeros(2)
        now[0] = t
        seen.append(f)
    return np.mean(seen, axis=0) if seen[0].size else np.zeros(2)


def grasp(rng: np.random.Generator, style: Style = PLAIN) -> Program:
    """Close, hold a force, another, let go, open."""
    now = [0.0]
    zero = yield from _tare(style, now)
    yield from _approach(rng.uniform(0.015, 0.045), style, zero, now)
    for _ in range(int(rng.integers(2, 4))):
        yield from _hold(rng.uniform(0.4, 1.6), rng.uniform(1.0, 1.8), rng.uniform(0.01, 0.025), style, zero, now)
    opening = style.seconds(rng.uniform(0.3, 0.6))
    yield from _for(opening, np.full(2, style.speed(rng.uniform(0.01, 0.04))), now)
    yield from _for(style.seconds(rng.uniform(0.3, 0.8)), np.zeros(2), now)
    yield from _approach(rng.uniform(0.02, 0.06), style, zero, now)
    yield from _hold(rng.uniform(0.6, 1.4), 9.0, rng.uniform(0.01, 0.025), style, zero, now)


def squeeze(rng: np.random.Generator, style: Style = PLAIN) -> Program:
    """Close, press in steps without looking at the force, release in steps, press again, hardest last."""
    now = [0.0]
    zero = yield from _tare(style, now)
    yield from _approach(rng.uniform(0.02, 0.05), style, zero, now)
    depth = 0.0
    while now[0] < 20:
        wanted = style.softness * rng.uniform(0.0008, 0.0055)
        speed = style.softness * style.speed(rng.uniform(0.004, 0.03))
        seconds = abs(wanted - depth) / speed
        yield from _for(seconds, np.full(2, -np.sign(wanted - depth) * speed), now)
        depth = wanted
        yield from _for(style.seconds(rng.uniform(0.4, 1.3)), np.zeros(2), now)


def waves(rng: np.random.Generator, style: Style = PLAIN) -> Program:
    """Close, press, then wave in contact, slower and faster."""
    now = [0.0]
    zero = yield from _tare(style, now)
    yield from _approach(rng.uniform(0.02, 0.05), style, zero, now)
    yield from _for(0.15, np.full(2, -0.02 * style.softness), now)
    while now[0] < 20:
        frequency = style.often(rng.uniform(0.3, 2.0))
        depth = style.softness * rng.uniform(0.0005, 0.0022)
        begun, shift = now[0], np.array([0.0, rng.choice([0.0, 0.0, np.pi])])
        move, end = np.zeros(2), begun + style.seconds(rng.uniform(1.5, 2.5))
        while now[0] < end:
            t, _, _ = yield move
            now[0] = t
            angle = 2 * np.pi * frequency * (t - begun)
            move = -depth * 2 * np.pi * frequency * np.sin(angle + shift)
        yield from _for(style.seconds(rng.uniform(0.3, 0.7)), np.zeros(2), now)


def air(rng: np.random.Generator, style: Style = PLAIN) -> Program:
    """To and fro without touching, slow and fast, rests between; then close and hold."""
    now = [0.0]
    zero = yield from _tare(style, now)
    where, end = np.full(2, style.start), style.seconds(rng.uniform(5.0, 6.5))
    while now[0] < end:
        wanted = np.where(rng.random(2) < 0.8, rng.uniform(0.028, 0.0445, 2), where)
        speed = style.speed(float(np.exp(rng.uniform(np.log(0.005), np.log(0.06)))))
        seconds = min(float(np.abs(wanted - where).max()) / speed, style.seconds(2.0))
        if seconds < 0.04:
            continue
        move = np.clip((wanted - where) / seconds, -FASTEST, FASTEST)
        begun = now[0]
        yield from _for(seconds, move, now)
        where = where + move * (now[0] - begun)
        if rng.random() < 0.4:
            yield from _for(style.seconds(rng.uniform(0.15, 0.8)), np.zeros(2), now)
    yield from _approach(rng.uniform(0.03, 0.06), style, zero, now)
    yield from _hold(rng.uniform(0.5, 1.5), 9.0, rng.uniform(0.01, 0.025), style, zero, now)


#: Mix of a session of ten; any other number goes through it again.
SESSION = (grasp, air, squeeze, waves, grasp, air, squeeze, grasp, waves, squeeze)


def finger_programs(ntrials: int, seed: int, styles: list[Style] | None = None) -> list[Program]:
    """A session of finger motions; which comes first is drawn.

    Args:
        ntrials: one program each.
        seed: of the session.
        styles: one a trial.
    """
    rng = np.random.default_rng([seed, 7])
    order = rng.permutation(len(SESSION))
    styles = styles or [PLAIN] * ntrials
    return [SESSION[order[k % len(SESSION)]](np.random.default_rng([seed, 8, k]), styles[k]) for k in range(ntrials)]


def joint_program(
    rng: np.random.Generator,
    robot: Robot,
    joints: list[int],
    reach: Array,
    fastest: Array,
    pace: float = 1.0,
) -> Program:
    """Moves of some joints about the start: steps, slow crossings, waves, rests.

    Args:
        rng: of the trial.
        robot: for the number of joints.
        joints: that move; the rest stands still.
        reach: how far from the start each may go, (n,).
        fastest: speed of each, (n,).
        pace: seconds of everything, over those of a trial of 10 s; no speed grows beyond ``fastest``.
    """
    now = [0.0]
    n = len(robot.joints)
    where = np.zeros(n)
    yield from _for(max(0.3 * pace, 0.1), np.zeros(n), now)
    while now[0] < 30:
        some = rng.choice(joints, size=int(rng.integers(1, len(joints) + 1)), replace=False)
        if rng.random() < 0.35:
            frequency = rng.uniform(0.3, 1.5) / pace**0.5
            size = np.zeros(n)
            size[some] = rng.uniform(0.1, 0.5, len(some))
            size = np.minimum(size * reach, fastest / (2 * np.pi * frequency))
            begun, end, home = now[0], now[0] + pace * rng.uniform(1.5, 3.0), where.copy()
            move = np.zeros(n)
            while now[0] < end:
                t, _, _ = yield move
                angle = 2 * np.pi * frequency * (t - begun)
                aim = home + size * np.sin(angle)
                move = np.clip((np.clip(aim, -reach, reach) - where) / max(t - now[0], 1e-3), -fastest, fastest)
                where = where + move * (t - now[0])
                now[0] = t
        else:
            wanted = where.copy()
            wanted[some] = rng.uniform(-1, 1, len(some)) * reach[some]
            share = float(np.exp(rng.uniform(np.log(0.08 / pace), 0.0))) if pace > 0.08 else 1.0
            seconds = max(float((np.abs(wanted - where) / fastest).max()) / share, 0.04)
            move = (wanted - where) / seconds
            begun = now[0]
            yield from _for(seconds, move, now)
            where = where + move * (now[0] - begun)
        if rng.random() < 0.6:
            yield from _for(pace * rng.uniform(0.2, 0.9), np.zeros(n), now)


__all__ = ["FINGER_SPEED", "Conductor", "Style", "finger_programs", "joint_program"]
