"""Effects measured on the readings alone, whatever the motion: repeated readings, quantization, noise, offset.

A dropped reading repeats the one before exactly, a quantized one is a multiple of a step, and more noise is more
scatter. The mean of a prediction does not depend on any of the three, so they are estimated here, independently of what
else explains the recordings. The same holds for the reading of a load cell before contact, which needs no simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats

from tiago_mj.effects import EFFECTS, Effect
from tiago_mj.effects.declare import STAGES
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.simulation.phases import still
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.recordings import robust
from tiago_mj.recordings.grid import grid_step

Array = NDArray[np.float64]

#: A sensor's noise is known to about this share.
NOISE_SHARE: Final = 0.12
#: Standard deviations from what is expected that are named, and within which two channels have the same value.
NAMED_DEVIATIONS: Final = 3.5
EQUAL_DEVIATIONS: Final = 2.5
#: Exact repeats of a noisy reading that are no accident.
MIN_REPEATS: Final = 4
#: A tone is sought in stretches of so many rows, and named where noise would show one as strong in one of so many
#: recordings, and its variance is this share of the noise's.
STRETCH_ROWS: Final = 32
MAX_FALSE_ALARM: Final = 1e-6
MIN_TONE_VARIANCE_SHARE: Final = 0.5
#: It swings at least so often in a stretch: what is slower may be drift.
MIN_TONE_CYCLES: Final = 3
#: Share of the time until a load cell should feel something in which it surely does not, wherever the object stands.
UNTOUCHED_SHARE: Final = 0.6
#: Ratio of a measured to the stated quantization step from which on it is coarser: between 1 (as stated) and 2 (every
#: other level missing).
COARSER_GRID_RATIO: Final = 1.5
#: Offset of a load cell that is one, three deviations of what every cell may have [sensor units].
MIN_BIAS: Final = 0.006


@dataclass(frozen=True)
class Known:
    """An effect whose magnitude is measured on the readings, with its standard deviation."""

    candidate: Candidate
    value: float
    deviation: float


@dataclass(frozen=True)
class Trace:
    """Statistics of the readings of one channel.

    Attributes:
        channel: its name.
        noise: scatter of one sample at rest; ``noise_samples`` differences went into it.
        repeats: number of readings that equal the one before exactly, of ``samples``.
        grid: step of the grid that all readings lie on, 0 if they lie on none.
        stated: step of the grid that the sensor is said to have, 0 if it is said to have none.
        expected: the noise that the nominal sensor has; 0 for one without.
        rest: what it reads before anything is touched, with one standard deviation, where that is the same from
            beginning to end; None where it is not, or unknown.
    """

    channel: str
    noise: float
    noise_samples: int
    repeats: int
    samples: int
    grid: float
    expected: float
    rest: tuple[float, float] | None = None
    stated: float = 0.0


def of_channels(plant: Plant, data: Data, base: Array) -> list[Trace]:
    """Statistics of the readings of every channel.

    Args:
        plant: whose load cells are known.
        data: what was measured, (ntrials, T, channels).
        base: nominal prediction of it, same shape.
    """
    cell = plant.cell
    noises = cell.noises if cell is not None and cell.average == 1 else np.zeros(2)
    before = _before_touch(plant, data, base)
    return [
        trace(
            name,
            data.value[:, :, c],
            still(base[:, :, c]),
            float(noises[data.part[c]]) if name.startswith("force") else 0.0,
            before if name.startswith("force") else None,
            plant.grids.get(name, 0.0),
        )
        for c, name in enumerate(data.channels)
    ]


def _before_touch(plant: Plant, data: Data, base: Array) -> NDArray[np.bool_] | None:
    """Mask of the rows at the beginning of every trial, well before a load cell is predicted to be loaded, (ntrials,
    T)."""
    cells = [c for c, kind in enumerate(data.kinds) if kind == "force"]
    if plant.cell is None or not cells:
        return None
    nothing = plant.cell.signal(np.zeros(2))[data.part[cells]]
    touched = (base[:, :, cells] != nothing).any(axis=2)
    first = np.where(touched.any(axis=1), touched.argmax(axis=1), touched.shape[1])
    return np.arange(touched.shape[1]) < UNTOUCHED_SHARE * first[:, None]


def _level(values: Array, counts: NDArray[np.bool_], expected: float) -> tuple[float, float] | None:
    """Mean of some readings and its standard deviation; None for too few, or where the mean changes.

    Args:
        values: (ntrials, T), NaN where nothing was measured.
        counts: readings that are looked at, (ntrials, T).
        expected: noise of one.
    """
    counts = counts & np.isfinite(values)
    rows = np.nonzero(counts)[1]
    if not expected or len(rows) < 2 * STRETCH_ROWS:
        return None
    read = values[counts]
    scatter = max(robust.deviation(read), 0.5 * expected)
    error = scatter / np.sqrt(len(read))
    trials = [float(values[k, row].mean()) - float(read.mean()) for k, row in enumerate(counts) if row.any()]
    sizes = [scatter / np.sqrt(row.sum()) for row in counts if row.any()]
    centred = rows - rows.mean()
    slope = float(centred @ read) / max(float(centred @ centred), 1e-12) * float(rows.std())
    same = stats.chi2.sf(float(np.sum(np.square(np.divide(trials, sizes)))), len(trials)) > MAX_FALSE_ALARM
    return (float(read.mean()), error) if same and abs(slope) < NAMED_DEVIATIONS * error else None


def trace(
    channel: str,
    values: Array,
    quiet: NDArray[np.bool_],
    expected: float,
    untouched: NDArray[np.bool_] | None = None,
    stated: float = 0.0,
) -> Trace:
    """Statistics of the readings of a channel: noise at rest, exact repeats, quantization step, level before contact.

    Args:
        channel: its name.
        values: (ntrials, T), NaN where nothing was measured.
        quiet: rows in which the signal is predicted to stand still, (ntrials, T).
        expected: noise that the nominal sensor has.
        untouched: rows before anything is touched, (ntrials, T); None: not asked.
        stated: step of the grid that it is said to have.
    """
    steps = np.diff(values, axis=1)
    known = np.isfinite(steps) & ~_at_an_end(values)[:, 1:]
    standing = known & quiet[:, 1:] & quiet[:, :-1]
    different = steps[standing & (steps != 0)]
    noise = robust.deviation(different, about_zero=True) / np.sqrt(2) if len(different) > 10 else 0.0
    return Trace(
        channel=channel,
        noise=noise,
        noise_samples=len(different),
        repeats=int((steps[known] == 0).sum()),
        samples=max(int(known.sum()), 1),
        grid=grid_step(values[np.isfinite(values)]),
        expected=expected,
        rest=None if untouched is None else _level(values, untouched, expected),
        stated=stated,
    )


def _at_an_end(values: Array) -> NDArray[np.bool_]:
    """Mask of the readings equal to the largest or smallest of all, where a saturated or dead sensor repeats itself."""
    known = values[np.isfinite(values)]
    if not len(known):
        return np.zeros(values.shape, dtype=bool)
    ends = (float(known.min()), float(known.max()))
    near = 1e-9 * (ends[1] - ends[0])
    return np.asarray((np.abs(values - ends[0]) <= near) | (np.abs(values - ends[1]) <= near))


@dataclass(frozen=True)
class Tone:
    """A sinusoid in the readings of an unloaded load cell.

    Attributes:
        channel: its name.
        frequency: as it is seen at the rate of the recording [Hz]; a faster one is folded down.
        amplitude: in the channel's unit.
    """

    channel: str
    frequency: float
    amplitude: float


def tones(plant: Plant, data: Data, base: Array) -> list[Tone]:
    """Sinusoids in the readings of the load cells while they are predicted to be unloaded.

    Args:
        plant: that may have load cells.
        data: what was measured, (ntrials, T, channels).
        base: nominal prediction of it, same shape.
    """
    if plant.cell is None:
        return []
    nothing, noises = plant.cell.signal(np.zeros(2)), plant.cell.noises
    found = [
        tone(name, data.value[:, :, c], base[:, :, c] == nothing[part], plant.period, float(noises[part]))
        for c, (name, part) in enumerate(zip(data.channels, data.part, strict=True))
        if name.startswith("force")
    ]
    return [one for one in found if one is not None]


def tone(channel: str, values: Array, untouched: NDArray[np.bool_], period: float, expected: float) -> Tone | None:
    """A sinusoid in the readings of an unloaded load cell, which should be noise alone; None without one.

    Args:
        channel: its name.
        values: (ntrials, T), NaN where nothing was measured.
        untouched: rows in which it should feel nothing, (ntrials, T).
        period: of the rows [s].
        expected: noise that the nominal sensor has.
    """
    pieces = [
        piece for row, free in zip(values, untouched & np.isfinite(values), strict=True) for piece in _runs(row, free)
    ]
    pieces = [piece for piece in pieces if _swings_about_zero(piece, expected)]
    if not expected or len(pieces) < 2:
        return None
    some = signal.detrend(np.stack(pieces), axis=1)
    power = (np.abs(np.fft.rfft(some, axis=1)) ** 2).mean(axis=0)[MIN_TONE_CYCLES:]
    top = int(np.argmax(power))
    near = slice(max(top - 1, 0), top + 2)
    rest = float(np.delete(power, near).mean())
    # Averages of K periodograms of noise are Gamma(K) distributed about their mean.
    accident = len(power) * stats.gamma.sf(len(pieces) * power[top] / max(rest, 1e-300), len(pieces))
    variance = 2 * float(power[near].sum()) / STRETCH_ROWS**2
    if accident > MAX_FALSE_ALARM or variance < MIN_TONE_VARIANCE_SHARE * expected**2:
        return None
    return Tone(channel, (top + MIN_TONE_CYCLES) / (STRETCH_ROWS * period), float(np.sqrt(2 * variance)))


def _swings_about_zero(piece: Array, expected: float) -> bool:
    """Whether the mean of every quarter of a stretch is near zero; otherwise there is contact."""
    means = np.abs(piece.reshape(4, -1).mean(axis=1))
    return bool((means < max(3 * expected, 0.5 * float(piece.std()))).all())


def _runs(row: Array, free: NDArray[np.bool_]) -> list[Array]:
    """Stretches of :data:`STRETCH_ROWS` consecutive rows."""
    out, begin = [], 0
    for k in range(len(row)):
        if not free[k]:
            begin = k + 1
        elif k + 1 - begin == STRETCH_ROWS:
            out.append(row[begin : k + 1])
            begin = k + 1
    return out


def measured_on_readings(traces: Sequence[Trace], pool: Sequence[Candidate]) -> tuple[Known, ...]:
    """Effects measured on the readings alone, with their magnitudes.

    One magnitude serves all channels where it fits them all, else each channel has its own.

    Args:
        traces: of the channels.
        pool: candidates that may be named.
    """
    found: list[Known] = []
    for declared in _read_off():
        mine, measure = [c for c in pool if c.effect == declared.name], MEASURES[declared.shows_as]
        kind = "force" if declared.targets == "sensor" else "position"
        seen = {t.channel.partition(".")[2]: measure(t) for t in traces if t.channel.startswith(f"{kind}.")}
        there = {key: value for key, value in seen.items() if value is not None}
        everywhere = [c for c in mine if c.target is None]
        values = np.array([value for value, _ in there.values()])
        errors = np.array([error for _, error in there.values()])
        if everywhere and there and len(there) == len(seen):
            weight = 1 / errors**2
            mean = float((weight * values).sum() / weight.sum())
            if bool((np.abs(values - mean) <= EQUAL_DEVIATIONS * errors).all()):
                found.append(_known(everywhere[0], mean, float(weight.sum() ** -0.5)))
                continue
        for c in mine:
            if c.target is not None and len(c.target) == 1 and c.target[0] in there:
                found.append(_known(c, *there[c.target[0]]))
    return tuple(found)


def _read_off() -> list[type[Effect]]:
    """Effects that readings show by themselves, in the order of :data:`MEASURES` and of the signal chain."""
    mine = [declared for declared in EFFECTS.values() if declared.shows_as in MEASURES]
    symptoms = list(MEASURES)
    return sorted(mine, key=lambda one: (symptoms.index(one.shows_as), STAGES.index(one.stage)))


def only_read_off() -> tuple[str, ...]:
    """Names of those of them that do not change predicted means: no prediction tells how large they are."""
    return tuple(declared.name for declared in _read_off() if declared.rounds or declared.by_chance)


def _known(candidate: Candidate, value: float, error: float) -> Known:
    return Known(candidate, float(np.clip(value, candidate.low, candidate.high)), error)


def _grid(trace: Trace) -> tuple[float, float] | None:
    """Quantization step that is not stated, or is coarser than the stated one."""
    return (trace.grid, 1e-3 * trace.grid) if trace.grid > COARSER_GRID_RATIO * trace.stated else None


def _noise(trace: Trace) -> tuple[float, float] | None:
    """Factor on the nominal noise, where it differs by more than the nominal noise is known to."""
    if trace.grid or not trace.expected or trace.noise_samples <= 20 or trace.noise <= 0:
        return None
    factor = trace.noise / trace.expected
    # The median absolute deviation of n differences is uncertain by about 1.2 / √n of itself.
    error = 1.2 / np.sqrt(trace.noise_samples)
    if abs(np.log(factor)) < NAMED_DEVIATIONS * np.hypot(NOISE_SHARE, error):
        return None
    return factor, factor * error


def _repeats(trace: Trace) -> tuple[float, float] | None:
    """Share of readings that repeat the one before exactly, which noisy readings never do."""
    if trace.grid or not trace.expected or trace.repeats < MIN_REPEATS:
        return None
    share = trace.repeats / trace.samples
    return share, float(np.sqrt(share * (1 - share) / trace.samples))


def _rest(trace: Trace) -> tuple[float, float] | None:
    """Reading of an unloaded load cell."""
    if trace.grid or trace.rest is None or abs(trace.rest[0]) < max(NAMED_DEVIATIONS * trace.rest[1], MIN_BIAS):
        return None
    return trace.rest


#: How each symptom is measured on the readings of a channel: value and one standard deviation, or None.
MEASURES: Final = {"grid": _grid, "noise": _noise, "repeats": _repeats, "rest": _rest}
