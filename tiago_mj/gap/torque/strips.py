"""From trials to motion and effort on one uniform grid: resampled, low-passed without phase shift, differentiated.

The cut-off follows from the motion: well above what moves, well below most of the noise. Efforts, and every torque that
is predicted, pass the same filter, so that what is compared went the same way.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from tiago_mj.models import inverse
from tiago_mj.recordings import robust
from tiago_mj.recordings.recording import RecordingError, Trial

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: The highest cut-off, over the frequency below which 90 % of the motion's velocity power lies, and at most as a share
#: of the rate.
HEADROOM: Final = 32.0
LARGEST_SHARE: Final = 0.2
#: Grid over cut-off: the torques are evaluated on it, jumps of dry friction included.
GRID_PER_CUTOFF: Final = 10.0
#: Slower than this share of a joint's own fast motion (99th percentile) is rest; so is what the noise alone makes.
REST_SHARE: Final = 0.02
REST_NOISES: Final = 4.0
#: A stretch must hold this many periods of the cut-off to be filtered.
SHORTEST: Final = 6.0
#: Periods of the cut-off before and after a rest in which rows hold more of it than of their own. A rest that lasts no
#: longer is a turn.
REACH: Final = 0.5
#: What the filter puts of a pulse in other rows, as shares of its peak: the largest of each lobe of its response, with
#: how many periods of the cut-off it ends away from the pulse.
LEAKS: Final = ((REACH, 1.0), (1.0, 0.134), (1.5, 0.037), (2.0, 0.010))
#: Periods of the cut-off over which the filter spoils either end of a stretch, and mixes two parts of one.
MIXED: Final = 1.0


@dataclass(frozen=True)
class Strip:
    """One stretch of a trial on the grid.

    Attributes:
        trial: name.
        time: (T,) [s], of the trial.
        position, velocity, acceleration: (T, m) [m, rad and per s, s²], by moving joint.
        effort: (T, c) [N, N·m], low-passed, by channel.
        noise: (c,) standard deviation of the effort's noise inside the pass band [N, N·m].
    """

    trial: str
    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    effort: Array
    noise: Array

    def rows(self, rows: slice, trial: str) -> Strip:
        """Some of its rows, as a stretch of a trial of that name."""
        time, position, velocity = self.time[rows], self.position[rows], self.velocity[rows]
        return Strip(trial, time, position, velocity, self.acceleration[rows], self.effort[rows], self.noise)


@dataclass(frozen=True)
class Course:
    """Every stretch, one after the other.

    Attributes:
        joints: that move or are held, m.
        channels: joints whose effort is used, c.
        strips: as recorded.
        rate: of the grid [Hz].
        cutoff: of the low-pass [Hz].
        rest_speed: (m,) below it a joint rests [m/s, rad/s].
        period: of the recorded rows [s].
        noise: (m,) standard deviation of the positions' noise, row by row as recorded [m, rad].
        every: recorded rows, evenly spaced, per row of the grid.
    """

    joints: tuple[str, ...]
    channels: tuple[str, ...]
    strips: tuple[Strip, ...]
    rate: float
    cutoff: float
    rest_speed: Array
    period: float
    noise: Array
    every: int

    @property
    def columns(self) -> list[int]:
        """Index of every channel among the joints."""
        return [self.joints.index(name) for name in self.channels]

    def stack(self, quantity: str) -> Array:
        """A quantity of all strips, (sum of T, ...)."""
        return np.concatenate([getattr(strip, quantity) for strip in self.strips])

    @property
    def lengths(self) -> tuple[int, ...]:
        """Rows of every strip."""
        return tuple(len(strip.time) for strip in self.strips)

    def filtered(self, values: Array) -> Array:
        """Pass values (sum of T, n) through the filter that the efforts passed, strip by strip."""
        out = np.empty_like(values)
        for rows in self._alike:
            out[rows] = signal.sosfiltfilt(self._sections, values[rows], axis=1)
        return out

    @cached_property
    def _alike(self) -> list[NDArray[np.intp]]:
        """Rows of the strips of each length, (strips, T): they are filtered at once."""
        begins = np.cumsum([0, *self.lengths[:-1]])
        each = {length: begins[np.array(self.lengths) == length] for length in self.lengths}
        return [begin[:, None] + np.arange(length) for length, begin in each.items()]

    @cached_property
    def _sections(self) -> Array:
        return signal.butter(inverse.FILTER_ORDER, self.cutoff, fs=self.rate, output="sos")

    def noise_of_motion(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """One draw of what the positions' noise makes of position, velocity and acceleration, (sum of T, m) each, by
        the way that the positions went."""
        drawn = []
        for rows in self.lengths:
            raw = rng.standard_normal((rows * self.every, len(self.joints))) * self.noise
            smooth = inverse.low_pass(raw, rate=1 / self.period, cutoff=self.cutoff)
            velocity = np.gradient(smooth, self.period, axis=0)
            acceleration = np.gradient(velocity, self.period, axis=0)
            drawn.append([x[:: self.every] for x in (smooth, velocity, acceleration)])
        q, v, a = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
        return q, v, a

    def of_trial(self, trial: str) -> Course:
        """The strips of one trial."""
        return replace(self, strips=tuple(strip for strip in self.strips if strip.trial == trial))

    def in_parts(self, shortest: float) -> Course:
        """Every strip in parts of equal length, each a trial of its own (name-01, name-02, ...).

        A part has the rows that it is compared in and at either end those that the filter spoils, which are its
        neighbours': what is filtered whole and then cut loses nothing where it is cut. Between the rows of two parts
        lie those that the filter mixes.

        Args:
            shortest: length of a part at least [s].
        """
        mixed, parts = self._rows(MIXED), list[Strip]()
        for strip in self.strips:
            rows = len(strip.time) - mixed
            count = max(int(rows / (shortest * self.rate + mixed)), 1)
            for begin in range(0, count * (rows // count), rows // count):
                number = sum(one.trial.startswith(f"{strip.trial}-") for one in parts) + 1
                parts.append(strip.rows(slice(begin, begin + rows // count + mixed), f"{strip.trial}-{number:02d}"))
        return replace(self, strips=tuple(parts))

    def _rows(self, periods: float) -> int:
        """Rows of so many periods of the cut-off."""
        return math.ceil(periods * self.rate / self.cutoff)

    def shifted(self, values: Array, seconds: float) -> Array:
        """Values (sum of T, n) as they are ``seconds`` later; a strip's last value stays."""
        steps = seconds * self.rate
        parts = np.split(values, np.cumsum(self.lengths)[:-1])
        return np.concatenate([_later(part, steps) for part in parts])

    def moving(self) -> Mask:
        """(sum of T, m): the joint moves or turns, and no rest is so near that the filter has not forgotten it.

        At rest dry friction takes whatever value holds the joint, the same in all rows of a rest, so that these tell
        nothing about a joint's torque; nor do the ends of a strip, where the filter can only guess. In a turn, which is
        shorter than the filter's memory, it is unsure by as much as it changes: :meth:`leaked`.
        """
        edge, window = self._rows(MIXED), np.ones((2 * self._rows(REACH) + 1, 1), dtype=bool)
        kept = []
        for still in self._still():
            free = ~ndimage.binary_dilation(self._long(still), structure=window)
            free[:edge] = free[len(free) - edge :] = False
            kept.append(free)
        return np.concatenate(kept)

    def leaked(self, gap: Array) -> Array:
        """Deviation of what the filter puts of rests in the rows that are compared, (sum of T, c) [N, N·m].

        While a joint sticks where it turns, its dry friction is anything between what it is a period of the cut-off
        before and after, where the joint passes one place.

        Args:
            gap: what a model without dry friction lacks of the efforts, (sum of T, c).
        """
        found = []
        for lacks, still in zip(np.split(gap, np.cumsum(self.lengths)[:-1]), self._still(), strict=True):
            variance = np.zeros_like(lacks)
            for c, j in enumerate(self.columns):
                for rest in _runs(still[:, j]):
                    before, *_, after = lacks[_wider(rest, self._rows(1.0)), c]
                    unsure = (after - before) ** 2 / 12  # of a uniform distribution
                    for periods, share in LEAKS:
                        variance[_wider(rest, self._rows(periods)), c] += share**2 * unsure
            found.append(np.sqrt(variance))
        return np.concatenate(found)

    def _long(self, still: Mask) -> Mask:
        """Of rests, (T, m), those that are no turns."""
        kept = still.copy()
        for j, column in enumerate(still.T):
            for rest in _runs(column):
                kept[rest, j] = rest.stop - rest.start > self._rows(REACH)
        return kept

    def _still(self) -> list[Mask]:
        """By strip, (T, m): slower than rest, or turning round between two rows."""
        found = []
        for strip in self.strips:
            still = np.abs(strip.velocity) < self.rest_speed
            turn = np.diff(np.sign(strip.velocity), axis=0) != 0
            still[1:] |= turn
            still[:-1] |= turn
            found.append(still)
        return found


def _runs(still: Mask) -> list[slice]:
    """Rows of each rest, of (T,)."""
    return [run for (run,) in ndimage.find_objects(ndimage.label(still)[0])]


def _wider(rows: slice, by: int) -> slice:
    """These rows, and so many before and after."""
    return slice(max(rows.start - by, 0), rows.stop + by)


def lay_out(trials: Sequence[Trial], joints: Sequence[str], channels: Sequence[str], share: float = 1.0) -> Course:
    """Put trials on one grid.

    Args:
        trials: with positions of all ``joints`` and efforts of all ``channels``.
        joints: whose motion is used.
        channels: whose effort is used, some of the joints.
        share: of the highest cut-off.

    Raises:
        RecordingError: nothing moves, or every stretch is too short to be filtered; names the files.
    """
    files = ", ".join(dict.fromkeys(trial.source for trial in trials))
    pieces = [piece for trial in trials for piece in _pieces(trial, joints, channels)]
    if not pieces:
        raise RecordingError(f"{files}: no stretch holds both position and effort: log both, row by row")
    rate = 1 / float(np.median(np.concatenate([np.diff(time) for _, time, _, _ in pieces])))
    cutoff = _cutoff([inverse.uniform(time, position, rate)[1] for _, time, position, _ in pieces], rate, files, share)
    step = max(1, int(rate / (GRID_PER_CUTOFF * cutoff)))
    shortest = SHORTEST / cutoff
    strips, noisy = [], []
    for name, time, position, effort in pieces:
        if time[-1] - time[0] < shortest:
            continue
        grid, raw = inverse.uniform(time, np.hstack([position, effort]), rate)
        smooth = inverse.low_pass(raw, rate=rate, cutoff=cutoff)
        noise = _noise(raw, smooth, rate, cutoff)
        m = len(joints)
        velocity = np.gradient(smooth[:, :m], 1 / rate, axis=0)
        acceleration = np.gradient(velocity, 1 / rate, axis=0)
        t, q, v, a, tau = (x[::step] for x in (grid, smooth[:, :m], velocity, acceleration, smooth[:, m:]))
        strips.append(Strip(name, t, q, v, a, tau, noise[m:]))
        noisy.append(noise[:m])
    if not strips:
        longest = max(time[-1] - time[0] for _, time, _, _ in pieces)
        raise RecordingError(
            f"{files}: the longest stretch lasts {longest:.2g} s; motion of this speed needs {shortest:.2g} s: "
            "record longer"
        )
    fast = np.percentile(np.abs(np.concatenate([s.velocity for s in strips])), 99, axis=0)
    inside = np.max(noisy, axis=0)
    jitter = inside * 2 * np.pi * cutoff / np.sqrt(3)  # white noise, differentiated up to the cut-off
    return Course(
        tuple(joints),
        tuple(channels),
        tuple(strips),
        rate / step,
        cutoff,
        np.maximum(np.maximum(REST_SHARE * fast, REST_NOISES * jitter), 1e-6),
        1 / rate,
        inside / np.sqrt(2 * cutoff / rate),
        step,
    )


def _pieces(trial: Trial, joints: Sequence[str], channels: Sequence[str]) -> Iterable[tuple[str, Array, Array, Array]]:
    """Stretches of a trial without holes: (name, time, positions, efforts)."""
    table = np.stack([*(trial.positions[j] for j in joints), *(trial.efforts[c] for c in channels)], axis=1)
    full = np.isfinite(table).all(axis=1)
    if full.sum() < 0.5 * np.isfinite(table).any(axis=1).sum():  # streams fill rows of their own: bring them together
        table = np.stack([_filled(trial.time, column) for column in table.T], axis=1)
        full = np.isfinite(table).all(axis=1)
    time, table = trial.time[full], table[full]
    if len(time) < 2:
        return
    hole = np.flatnonzero(np.diff(time) > 10 * np.median(np.diff(time))) + 1
    for t, part in zip(np.split(time, hole), np.split(table, hole), strict=True):
        if len(t) > 1:
            yield trial.name, t, part[:, : len(joints)], part[:, len(joints) :]


def _filled(time: Array, column: Array) -> Array:
    there = np.isfinite(column)
    if there.sum() < 2:
        return column
    return np.interp(time, time[there], column[there], left=np.nan, right=np.nan)


def _cutoff(positions: Sequence[Array], rate: float, files: str, share: float) -> float:
    """Cut-off of the low-pass [Hz] from the spectrum of the velocities, each joint scaled to its own power."""
    needed = 0.0
    for joint in range(positions[0].shape[1]):
        total, frequencies = np.zeros(0), np.zeros(0)
        for position in positions:
            speed = np.diff(position[:, joint]) * rate
            n = 1 << max(int(np.ceil(np.log2(20 * rate))), 6)
            frequencies, power = signal.welch(speed, rate, nperseg=min(n, len(speed)), nfft=n, detrend=False)
            total = power * len(speed) + (total if total.size else 0.0)
        if total.sum() > 0 and np.ptp(np.concatenate([p[:, joint] for p in positions])) > 0:
            below = np.cumsum(total) / total.sum()
            needed = max(needed, float(frequencies[np.searchsorted(below, 0.9)]))
    if needed == 0:
        raise RecordingError(f"{files}: no joint moves: torque along a motion needs a motion")
    return share * float(min(HEADROOM * needed, LARGEST_SHARE * rate))


def _noise(raw: Array, smooth: Array, rate: float, cutoff: float) -> Array:
    """Standard deviation of white noise inside the pass band, (n,).

    The larger of two: the signal above the cut-off, scaled to the band below (its median deviation, so that single
    jumps do not count), and the quantum.
    """
    above = raw - smooth
    share = cutoff / (rate / 2 - cutoff)
    high = robust.deviations(above, axis=0) * np.sqrt(share)
    quantum = np.array([_quantum(column) for column in raw.T]) * np.sqrt(2 * cutoff / rate / 12)
    return np.maximum(high, quantum)


def _quantum(column: Array) -> float:
    """Smallest step between values that occur; 0 where hardly any occurs twice."""
    values, counts = np.unique(column, return_counts=True)
    return float(np.diff(values).min()) if len(values) > 1 and np.mean(counts) > 4 else 0.0


def _later(values: Array, steps: float) -> Array:
    index = np.arange(len(values)) + steps
    low = np.clip(np.floor(index).astype(int), 0, len(values) - 1)
    high = np.clip(low + 1, 0, len(values) - 1)
    share = np.clip(index - low, 0.0, 1.0)[:, None]
    return (1 - share) * values[low] + share * values[high]
