"""How well a simulator can be expected to agree with a recording: noise of the sensor, and tolerance of the model.

The noise floor of a channel is one standard deviation of what its sensor adds
(:mod:`tiago_mj.gap.inference.sensor_noise`). A grid is no noise: what is compared knows its step, and that a reading on
it says "between" (:mod:`tiago_mj.gap.inference.between`).
The tolerance is what two correct simulators differ by, at other time steps or integrators: it grows where a signal's
slope jumps (an onset is never in the same millisecond) and a little with its size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, minimum_filter1d

from tiago_mj.gap.inference import sensor_noise, timing_noise, trailing
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Signals
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]
#: Names of channels that can be believed: in all trials, or by the file of each trial, or that it is a part of.
Usable = frozenset[str] | Mapping[str, frozenset[str]]

#: Two correct simulators agree on when something happens to within this [s]: about one physics step.
TIMING_TOLERANCE: Final = 2e-3
#: Relative model error: two correct simulators agree on a signal's size to within this share of its range over the
#: trial, (slide, hinge); for a force, which is 0 without contact, of its value. The error of the physics step comes
#: on top (:mod:`tiago_mj.gap.inference.step_tolerance`). Halved and doubled, none of 15 answers about hinges changes
#: (varied.json).
SIZE_TOLERANCE: Final = {"position": (0.0005, 0.0002), "velocity": (0.002, 0.0007), "force": (0.005, 0.005)}
#: Share of a contact force by which two simulators differ from sample to sample, independently. Halved and doubled,
#: 4 of 16 answers about grasps change, 0 to right, 2 to wrong (varied_grasps.json).
CONTACT_TOLERANCE: Final = 0.01
#: Model errors are taken as constant over blocks of this length [s]. Halved and doubled, none of 15 answers about
#: hinges changes (varied.json).
BLOCK_SECONDS: Final = 0.25
#: An event is a jump of the slope within this time [s], and counts for so many rows around it.
EVENT_SECONDS: Final = 0.02
EVENT_ROWS: Final = 2
#: Half-width of an event's surroundings, in units of EVENT_SECONDS, and at least so many rows: the event fills less
#: than half, so that a median over them is of what is usual. Halved and doubled, none of 32 answers about hinges
#: changes (varied.json).
SURROUNDING_RATIO: Final = 4
MIN_SURROUNDING_ROWS: Final = 6
#: Load cell readings beyond this many deviations of the noise count as contact: Gaussian noise alone is in one of
#: 16 000 samples.
CONTACT_DEVIATIONS: Final = 4.0
#: Predictions are clipped at this many deviations of the noise beyond the measured range; a diverged simulation lies
#: there.
DIVERGED_DEVIATIONS: Final = 1e6


@dataclass(frozen=True)
class Tolerance:
    """What two correct simulators differ by.

    Attributes:
        share: of a signal's size, of each channel, (C,), or of each trial, too, (ntrials, 1, C).
        seconds: between the instants at which something happens, as ``share``, or one for all.
    """

    share: Array
    seconds: Array | float = TIMING_TOLERANCE


@dataclass(frozen=True)
class Data:
    """Measured signals of trials on rows, with what they can be trusted to.

    Attributes:
        channels: names such as ``position.gripper_right_finger_joint``, C.
        part: per channel, index of its joint or sensor, (C,).
        value: (ntrials, T, C), NaN where nothing was measured.
        noise: floor of each channel, (C,).
        sigma: floor and tolerance, (ntrials, T, C).
        common: part of the tolerance whose error is the same in all rows of a block, (ntrials, T, C).
        block: rows of a block.
        step: of the grid that the readings of each channel lie on, or are rounded to before noise comes in, (C,); 0 for
            none. It is part of ``noise``, and not of ``sigma``. None: no channel has one.
        least: noise that is believed at least, (C,). None: ``noise`` itself.
        stepless: ``sigma`` and ``common`` without what the physics step gets wrong. None: nothing of it is in them.
        timing: variance of what is read earlier or later than its stamp says, (ntrials, T, C); part of ``sigma``, and
            not of ``noise``. None: nothing is.
        late: root mean square of the time by which readings are early or late, (C,) [s]. None: nothing is.
        assumed: of these the variances that were assumed for any two simulators, sample by sample and alike over a
            block, (ntrials, T, C) each. None: nothing was.
    """

    channels: tuple[str, ...]
    part: NDArray[np.int_]
    value: Array
    noise: Array
    sigma: Array
    common: Array
    block: int = 1
    step: Array | None = None
    least: Array | None = None
    stepless: tuple[Array, Array] | None = None
    assumed: tuple[Array, Array] | None = None
    timing: Array | None = None
    late: Array | None = None

    @property
    def floor(self) -> Array:
        """What readings are off by on average, one standard deviation of each channel, (C,)."""
        if self.timing is None:
            return self.noise
        known = np.isfinite(self.value)
        total = np.where(known, self.timing, 0.0).sum(axis=(0, 1))
        return np.sqrt(self.noise**2 + total / np.maximum(known.sum(axis=(0, 1)), 1))

    @property
    def reading_noise(self) -> Array:
        """What each reading is off by, one standard deviation, (1 or ntrials, 1 or T, C)."""
        return np.sqrt(self.noise**2 + (np.zeros((1, 1, 1)) if self.timing is None else self.timing))

    @property
    def own(self) -> Array:
        """Noise of each channel apart from its grid, (C,)."""
        return self.noise if self.step is None else np.sqrt(np.maximum(self.noise**2 - self.step**2 / 12, 0.0))

    @property
    def kinds(self) -> tuple[str, ...]:
        """``position``, ``velocity`` or ``force`` of each channel."""
        return tuple(name.partition(".")[0] for name in self.channels)


def collect(plant: Plant, trials: Sequence[Trial], usable: Usable | None = None) -> Data:
    """Measured channels that the plant predicts.

    Args:
        plant: the nominal simulator.
        trials: recordings.
        usable: names of the channels that the lint trusts, of all trials or by their sources; None for all.
    """
    length = max(len(trial.time) for trial in trials)
    wanted = [("position", plant.joints), ("velocity", plant.joints), ("force", plant.sensors)]
    channels, part, columns, noise, leasts, steps = [], [], [], [], [], []
    share, seconds, late, timing = [], [], [], []
    for kind, names in wanted:
        for index, name in enumerate(names):
            channel = f"{kind}.{name}"
            values = np.full((len(trials), length), np.nan)
            for k, trial in enumerate(trials):
                source = {"position": trial.positions, "velocity": trial.velocities, "force": trial.forces}[kind]
                trusted = _trusted(trial, usable) if isinstance(usable, Mapping) else usable
                if name in source and (trusted is None or channel in trusted):
                    values[k, : len(trial.time)] = source[name]
            if not np.isfinite(values).any():
                continue
            slide = kind == "force" or plant.wiring.targets.slides[index]
            channels.append(channel)
            part.append(index)
            columns.append(values)
            stated = max((sensor_noise.stated(trial, kind, channel) for trial in trials), default=0.0)
            usual = sensor_noise.MIN_NOISE[kind][0 if slide else 1]
            # TIAGo's encoders are known; those of a user's robot its readings tell of.
            shown = usual if plant.environment is not None else sensor_noise.least(kind, values, slide=slide)
            least = stated or shown
            nominal = float(plant.cell.noises[index]) if kind == "force" and plant.cell is not None else 0.0
            step = plant.grids.get(channel, 0.0)
            noise.append(sensor_noise.beside_grid(values, least, step, nominal))
            leasts.append(least)
            steps.append(max(step, sensor_noise.grid_of(values)))
            # How TIAGo's controllers log is another matter, and its grasps have corners in every row.
            told = kind == "position" and plant.environment is None
            late.append(0.0)
            if told:
                late[-1], noise[-1] = _late(trials, values, noise[-1], steps[-1], least)
            timing.append(_timing(trials, values, late[-1]))
            trails = (
                trailing.share_of_range(plant, trials, index, values) if kind == "position" and least < usual else 1.0
            )
            share.append(SIZE_TOLERANCE[kind][0 if slide else 1] * np.broadcast_to(trails, len(trials)))
            seconds.append(TIMING_TOLERANCE * np.broadcast_to(trails, len(trials)))
    value = np.stack(columns, axis=-1) if columns else np.zeros((len(trials), length, 0))
    own, grid = np.array(noise), np.array(steps)
    tolerance = Tolerance(*(np.reshape(one, (-1, len(trials))).T[:, None] for one in (share, seconds)))
    whole, common = sigma(value, own, tolerance, tuple(channels), plant.period, grid)
    of_timing = np.stack(timing, axis=-1) if any(late) else None
    return Data(
        tuple(channels),
        np.array(part, dtype=int),
        value,
        np.sqrt(own**2 + grid**2 / 12),
        whole if of_timing is None else np.sqrt(whole**2 + of_timing),
        common,
        block=max(round(BLOCK_SECONDS / plant.period), 1),
        step=grid if grid.any() else None,
        least=np.array(leasts),
        assumed=(np.maximum(whole**2 - own**2 - common**2, 0.0), common**2),
        timing=of_timing,
        late=np.array(late) if any(late) else None,
    )


def _late(trials: Sequence[Trial], values: Array, noise: float, step: float, least: float) -> tuple[float, float]:
    """Root mean square of the time by which the readings of a channel, (ntrials, T), are early or late [s], and their
    noise at rest, ``least`` at least."""
    read = [row[: len(trial.time)] for trial, row in zip(trials, values, strict=True)]
    # A grid's noise is believed at least in part, whether the readings show it or not.
    shown = 0.0 if step and noise <= sensor_noise.MIN_GRID_NOISE * step else noise
    found = timing_noise.lateness([trial.time for trial in trials], read, shown, step)
    return found.seconds, noise if step or not found.seconds else max(found.noise, least)


def _timing(trials: Sequence[Trial], values: Array, late: float) -> Array:
    """Variance of readings, (ntrials, T), that are so many seconds early or late."""
    out = np.zeros_like(values)
    for trial, row, read in zip(trials, out, values, strict=True):
        rows = len(trial.time)
        row[:rows] = timing_noise.variance(trial.time, read[:rows], late)
    return out


def _trusted(trial: Trial, usable: Mapping[str, frozenset[str]]) -> frozenset[str]:
    """Channels of a trial that are trusted; those of a part are its recording's."""
    return next((usable[file] for file in (trial.source, *trial.part_of) if file in usable), frozenset())


def sigma(
    value: Array,
    noise: Array,
    tolerance: Tolerance,
    channels: Sequence[str],
    period: float,
    step: Array | None = None,
) -> tuple[Array, Array]:
    """Floor and tolerance of every sample, and the part whose error all rows of a block share, as ``value``.

    How fast a smooth signal changes costs no tolerance: a common delay is a nuisance of its own. Where its slope jumps
    something happens, and that may be a physics step earlier or later. How large a signal is, is wrong for as long as
    it lasts.
    """
    kinds = [name.partition(".")[0] for name in channels]
    force = np.array([kind == "force" for kind in kinds])
    filled = _held(value)
    grid = np.zeros(len(kinds)) if step is None else step
    smooth = filled.copy()
    for c in np.nonzero(grid)[0]:
        smooth[:, :, c] = _grid_interpolated(filled[:, :, c])
    slope = np.gradient(smooth, axis=1) / period
    lag = max(round(EVENT_SECONDS / period), 1)
    jump = np.zeros_like(slope)
    if slope.shape[1] > 2 * lag:
        inner = np.abs(slope[:, 2 * lag :] - 2 * slope[:, lag:-lag] + slope[:, : -2 * lag])
        # A joint that swings bends all the time: an event stands out of its surroundings.
        usual = median_filter(inner, size=(1, 2 * max(SURROUNDING_RATIO * lag, MIN_SURROUNDING_ROWS) + 1, 1))
        inner -= np.where(force, 0.0, usual)
        # Less what noise alone makes, and half a step, which a fast signal may be off between two lines.
        jump[:, lag:-lag] = np.maximum(inner - (4 * noise + grid / 2) / period, 0.0)
        jump *= minimum_filter1d(_between_first_and_last(value).astype(float), 2 * lag + 3, axis=1, mode="nearest")
    steepest = dilated(jump, lag + EVENT_ROWS)
    known = np.isfinite(value)
    span = np.max(value, axis=1, where=known, initial=-np.inf) - np.min(value, axis=1, where=known, initial=np.inf)
    pressed = np.where(np.abs(filled) > CONTACT_DEVIATIONS * np.hypot(noise, grid / np.sqrt(12)), np.abs(filled), 0.0)
    size = np.where(force, pressed, np.maximum(span, 0.0)[:, None, :])
    common = tolerance.share * size
    instant = np.where(force, CONTACT_TOLERANCE * pressed, 0.0)
    return np.sqrt(noise**2 + (tolerance.seconds * steepest) ** 2 + instant**2 + common**2), common


def _between_first_and_last(values: Array) -> NDArray[np.bool_]:
    """Rows from the first to the last that was measured: a trial's end is no event."""
    known = np.isfinite(values)
    inside: NDArray[np.bool_] = (
        np.maximum.accumulate(known, axis=1) & np.maximum.accumulate(known[:, ::-1], axis=1)[:, ::-1]
    )
    return inside


def _held(values: Array) -> Array:
    """Values with what was not measured as it was measured last, or will be first; 0 where nothing was."""
    rows = np.arange(values.shape[1])[None, :, None]
    known = np.isfinite(values)
    last = np.maximum.accumulate(np.where(known, rows, -1), axis=1)
    first = np.argmax(known, axis=1)[:, None]
    return np.nan_to_num(np.take_along_axis(values, np.where(last < 0, first, last), axis=1))


def _grid_interpolated(values: Array) -> Array:
    """Readings on a grid as straight lines from where they cross from one value to another to where they do next:
    (ntrials, T), what was rounded to within half a step."""
    rows = np.arange(values.shape[1])
    out = np.empty_like(values)
    for k, row in enumerate(values):
        at = np.flatnonzero(np.diff(row))
        crossed = np.concatenate([row[:1], (row[at] + row[at + 1]) / 2, row[-1:]])
        out[k] = np.interp(rows, np.concatenate([[0.0], at + 0.5, [len(row) - 1.0]]), crossed)
    return out


def dilated(size: Array, rows: int) -> Array:
    """The largest within so many rows, (ntrials, T, C): what happens may happen that much earlier or later."""
    around = size.copy()
    for shift in range(1, rows + 1):
        around[:, shift:] = np.maximum(around[:, shift:], size[:, :-shift])
        around[:, :-shift] = np.maximum(around[:, :-shift], size[:, shift:])
    return around


def sum_by_block(values: Array, rows: int) -> Array:
    """Sums over blocks of rows, (..., T, C) to (..., nblocks, C)."""
    return np.add.reduceat(values, np.arange(0, values.shape[-2], rows), axis=-2)


def repeat_over_blocks(sums: Array, rows: int, length: int) -> Array:
    """The same number for all rows of a block, (..., T, C)."""
    return np.repeat(sums, rows, axis=-2)[..., :length, :]


def select_trials(data: Data, trials: Sequence[int]) -> Data:
    """Of some trials."""
    index = list(trials)
    stepless, assumed = (
        None if two is None else (two[0][index], two[1][index]) for two in (data.stepless, data.assumed)
    )
    return replace(
        data,
        value=data.value[index],
        sigma=data.sigma[index],
        common=data.common[index],
        stepless=stepless,
        assumed=assumed,
        timing=None if data.timing is None else data.timing[index],
    )


def select_channel(data: Data, c: int) -> Data:
    """Of one channel, by index."""
    at = slice(c, c + 1)
    stepless, assumed = (
        None if two is None else (two[0][..., at], two[1][..., at]) for two in (data.stepless, data.assumed)
    )
    return replace(
        data,
        channels=data.channels[at],
        part=data.part[at],
        value=data.value[..., at],
        noise=data.noise[at],
        sigma=data.sigma[..., at],
        common=data.common[..., at],
        step=None if data.step is None else data.step[at],
        least=None if data.least is None else data.least[at],
        stepless=stepless,
        assumed=assumed,
        timing=None if data.timing is None else data.timing[..., at],
        late=None if data.late is None else data.late[at],
    )


def with_trials_replaced(data: Data, index: Sequence[int], some: Data) -> Data:
    """With what is known of some trials, at these indices, as it is in ``some``."""

    def merged(all_of_it: Array, part: Array) -> Array:
        out = all_of_it.copy()
        out[list(index)] = part
        return out

    def pair(all_of_it: tuple[Array, Array] | None, part: tuple[Array, Array] | None) -> tuple[Array, Array] | None:
        if all_of_it is None or part is None:
            return None
        return merged(all_of_it[0], part[0]), merged(all_of_it[1], part[1])

    return replace(
        data,
        value=merged(data.value, some.value),
        sigma=merged(data.sigma, some.sigma),
        common=merged(data.common, some.common),
        stepless=pair(data.stepless, some.stepless),
        assumed=pair(data.assumed, some.assumed),
    )


def without_repeats(data: Data) -> Data:
    """Set to NaN the load cell readings that repeat the one before exactly: these were dropped."""
    value = data.value.copy()
    for c, kind in enumerate(data.kinds):
        if kind == "force":
            repeated = np.zeros(value.shape[:2], dtype=bool)
            repeated[:, 1:] = data.value[:, 1:, c] == data.value[:, :-1, c]
            value[:, :, c] = np.where(repeated, np.nan, value[:, :, c])
    return replace(data, value=value)


def predicted(data: Data, signals: Signals) -> Array:
    """The predictions of the measured channels, (nsim, T, C): finite.

    A diverged simulation is clipped at :data:`DIVERGED_DEVIATIONS` deviations beyond the measured range, so that it has
    the worst likelihood wherever predictions are compared.
    """
    sources = {"position": signals.position, "velocity": signals.velocity, "force": signals.reading}
    columns = [sources[kind][:, :, part] for kind, part in zip(data.kinds, data.part, strict=True)]
    length = data.value.shape[1]
    most = np.nanmax(np.abs(data.value), axis=(0, 1), initial=0.0) + DIVERGED_DEVIATIONS * data.noise
    return np.clip(
        np.nan_to_num(np.stack([column[:, :length] for column in columns], axis=-1), nan=np.inf), -most, most
    )
