"""How well a simulator can be expected to agree with a recording: noise of the sensor, and tolerance of the model.

The noise floor of a channel is one standard deviation of what its sensor adds: from where it is quietest, by the median
absolute deviation of differences, at least the quantum over √12, at least what no sensor is better than. Differences of
order k cancel a motion that is a polynomial of degree k - 1 over their samples, and make √(2k choose k) of noise: the
first will do for a joint that hardly moves, only the fourth for one that swings at four samples a radian. The tolerance
is what two correct simulators differ by, at other time steps or integrators: it grows where a signal's slope jumps (an
onset is never in the same millisecond) and a little with its size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from tiago_mj.gap.data.recording import RecordingError, Trial
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Signals

Array = NDArray[np.float64]

#: Smallest noise that is believed, (slide, hinge): 27 µm is what the 2023 project took for the fingers' encoders
#: (llach/learning_fc), 0.1 mrad a 14-bit encoder's step over √12; velocities by the same over 50 ms.
LEAST: Final = {"position": (2.7e-5, 1e-4), "velocity": (5e-4, 2e-3), "force": (2e-3, 2e-3)}
#: Two correct simulators agree on when something happens to within this [s]: about one physics step.
TIMING: Final = 2e-3
#: And on how large it is, to within this share of the signal's range over the trial, (slide, hinge), beyond what their
#: steps make, which is known (:func:`with_numerics`): fingers rub and press, of which simulators have other forms. Of a
#: force, which is nought where nothing is touched, a share of what it is.
SHARE: Final = {"position": (0.0005, 0.0002), "velocity": (0.002, 0.0007), "force": (0.005, 0.005)}
#: What two simulators make of a contact differs from instant to instant, too: share of the force.
INSTANT: Final = 0.01
#: What is wrong stays wrong for about so long [s].
BLOCK: Final = 0.25
#: An event is a jump of the slope within this time [s], and counts for so many rows around it.
EVENT: Final = 0.02
EVENT_ROWS: Final = 2
#: So many times as far to either side, and so many rows at least, are an event's surroundings: it fills less than half.
AROUND: Final = 4
AROUND_ROWS: Final = 6
#: Differences are taken up to this order, and their scatter over so many rows: where that is least, and of the order
#: that has least, white noise shows this share of itself (10 trials of 150 to 600 rows, drawn 200 times).
ORDERS: Final = 4
QUIET_ROWS: Final = 16
SHOWN: Final = 0.81
#: Readings of a load cell that are no noise, in deviations of it.
TOUCHED: Final = 4.0
#: So many deviations of the noise beyond everything that was measured nothing is predicted: the simulation diverged.
HOPELESS: Final = 1e6
#: The nominal simulator is run with steps so many times shorter, too.
FINER: Final = 4


@dataclass(frozen=True)
class Data:
    """Measured signals of trials on rows, with what they can be trusted to.

    Attributes:
        channels: names such as ``position.gripper_right_finger_joint``, C.
        part: per channel, index of its joint or sensor, (C,).
        value: (ntrials, T, C), NaN where nothing was measured.
        noise: floor of each channel, (C,).
        sigma: floor and tolerance, (ntrials, T, C).
        common: part of the tolerance that errs alike over a block of rows, (ntrials, T, C).
        block: rows of a block.
    """

    channels: tuple[str, ...]
    part: NDArray[np.int_]
    value: Array
    noise: Array
    sigma: Array
    common: Array
    block: int = 1

    @property
    def kinds(self) -> tuple[str, ...]:
        """``position``, ``velocity`` or ``force`` of each channel."""
        return tuple(name.partition(".")[0] for name in self.channels)


def collect(plant: Plant, trials: Sequence[Trial], usable: frozenset[str] | None = None) -> Data:
    """Measured channels that the plant predicts.

    Args:
        plant: the nominal simulator.
        trials: recordings.
        usable: names of the channels that the lint trusts; None for all.
    """
    length = max(len(trial.time) for trial in trials)
    wanted = [("position", plant.joints), ("velocity", plant.joints), ("force", plant.sensors)]
    channels, part, columns, noise, share = [], [], [], [], []
    for kind, names in wanted:
        for index, name in enumerate(names):
            channel = f"{kind}.{name}"
            if usable is not None and channel not in usable:
                continue
            values = np.full((len(trials), length), np.nan)
            for k, trial in enumerate(trials):
                source = {"position": trial.positions, "velocity": trial.velocities, "force": trial.forces}[kind]
                if name in source:
                    values[k, : len(trial.time)] = source[name]
            if not np.isfinite(values).any():
                continue
            slide = kind == "force" or plant.wiring.targets.slides[index]
            channels.append(channel)
            part.append(index)
            columns.append(values)
            stated = max((_stated(trial, kind, channel) for trial in trials), default=0.0)
            noise.append(max(noise_floor(values, LEAST[kind][0 if slide else 1]), stated))
            share.append(SHARE[kind][0 if slide else 1])
    value = np.stack(columns, axis=-1) if columns else np.zeros((len(trials), length, 0))
    floor = np.array(noise)
    return Data(
        tuple(channels),
        np.array(part, dtype=int),
        value,
        floor,
        *sigma(value, floor, np.array(share), tuple(channels), plant.period),
        block=max(round(BLOCK / plant.period), 1),
    )


def _stated(trial: Trial, kind: str, channel: str) -> float:
    """What the sidecar says a value is known to, where rest does not show it: ``"uncertainty": {"force": 0.02}``."""
    said = trial.sidecar.raw.get("uncertainty") or {}
    try:
        value = float(said.get(channel, said.get(kind, 0.0)))
    except (AttributeError, TypeError, ValueError):
        value = -1.0
    if not 0 <= value < np.inf:
        raise RecordingError(
            f'{trial.source}: uncertainty in the sidecar: write columns or kinds and numbers, such as {{"force": 0.02}}'
        )
    return value


def noise_floor(values: Array, least: float) -> float:
    """One standard deviation of a channel's noise, from the quietest third of its differences, of the order that leaves
    least of the motion.

    Args:
        values: (ntrials, T).
        least: what is believed at least.
    """
    ends = (np.nanmin(values), np.nanmax(values)) if np.isfinite(values).any() else (np.nan, np.nan)
    at_an_end = np.isclose(values, ends[0], rtol=1e-9, atol=0) | np.isclose(values, ends[1], rtol=1e-9, atol=0)
    # What a sensor says below its threshold, or at its limit, has no noise.
    free = np.where(at_an_end, np.nan, values)
    steps = np.diff(free, axis=1).ravel()
    steps = steps[np.isfinite(steps)]
    if len(steps) < 8:
        return least
    moving = np.nonzero(steps)[0]
    quantum = np.min(np.abs(steps[moving])) if len(moving) else 0.0
    quiet = min(_quiet(np.diff(free, n=k, axis=1)) / np.sqrt(math.comb(2 * k, k)) for k in range(1, ORDERS + 1))
    repeated = quantum if len(np.unique(values[np.isfinite(values)])) < 0.2 * len(steps) else 0.0
    return float(max(quiet / SHOWN, repeated / np.sqrt(12), least))


def _quiet(differences: Array) -> float:
    """One standard deviation where they scatter least, (ntrials, T); infinite of too few."""
    known = differences[np.isfinite(differences)]
    count = len(known) // QUIET_ROWS
    if len(known) < QUIET_ROWS / 2:
        return np.inf
    if count < 3:
        return float(1.4826 * np.median(np.abs(known - np.median(known))))
    blocks = known[: count * QUIET_ROWS].reshape(count, QUIET_ROWS)
    spread = np.median(np.abs(blocks - np.median(blocks, axis=1, keepdims=True)), axis=1)
    return float(1.4826 * np.quantile(spread, 1 / 3))


def sigma(value: Array, noise: Array, share: Array, channels: Sequence[str], period: float) -> tuple[Array, Array]:
    """Floor and tolerance of every sample, and the part of it that errs alike over a block; same shape as ``value``.

    How fast a smooth signal changes costs no tolerance: a common delay is a nuisance of its own. Where its slope jumps
    something happens, and that may be a physics step earlier or later. How large a signal is, is wrong for as long as
    it lasts.
    """
    kinds = [name.partition(".")[0] for name in channels]
    force = np.array([kind == "force" for kind in kinds])
    filled = np.where(np.isfinite(value), value, 0.0)
    slope = np.gradient(filled, axis=1) / period
    lag = max(round(EVENT / period), 1)
    jump = np.zeros_like(slope)
    if slope.shape[1] > 2 * lag:
        inner = np.abs(slope[:, 2 * lag :] - 2 * slope[:, lag:-lag] + slope[:, : -2 * lag])
        # A joint that swings bends all the time: an event stands out of its surroundings.
        usual = median_filter(inner, size=(1, 2 * max(AROUND * lag, AROUND_ROWS) + 1, 1))
        inner -= np.where(force, 0.0, usual)
        jump[:, lag:-lag] = np.maximum(inner - 4 * noise / period, 0.0)  # less what noise alone makes
    steepest = jump.copy()
    for shift in range(1, lag + EVENT_ROWS + 1):
        steepest[:, shift:] = np.maximum(steepest[:, shift:], jump[:, :-shift])
        steepest[:, :-shift] = np.maximum(steepest[:, :-shift], jump[:, shift:])
    span = np.nanmax(np.where(np.isfinite(value), value, np.nan), axis=1) - np.nanmin(
        np.where(np.isfinite(value), value, np.nan), axis=1
    )
    pressed = np.where(np.abs(filled) > TOUCHED * noise, np.abs(filled), 0.0)
    size = np.where(force, pressed, np.nan_to_num(span)[:, None, :])
    common = share * size
    instant = np.where(force, INSTANT * pressed, 0.0)
    return np.sqrt(noise**2 + (TIMING * steepest) ** 2 + instant**2 + common**2), common


def with_numerics(data: Data, predicted: Array, finer: Array) -> Data:
    """With a tolerance of what the nominal simulator itself gets wrong by its physics step: put right in the nominal
    model (:func:`off_by_step`), it is as wrong in an explanation in which everything happens at another time.

    Args:
        data: measured.
        predicted, finer: nominal predictions at the step that is used and at one :data:`FINER` times shorter,
            (ntrials, T, C). Integrators of first order are off by FINER / (FINER - 1) of the difference. Of it the mean
            over a block errs alike, the rest sample by sample: a joint may chatter.
    """
    off = (predicted - finer) * FINER / (FINER - 1)
    alike = _block_means(off, data.block)
    apart, alike = _dilated(np.abs(off - alike)), _dilated(np.abs(alike))
    return replace(data, sigma=np.sqrt(data.sigma**2 + alike**2 + apart**2), common=np.hypot(data.common, alike))


def with_scatter(data: Data, alike: Array) -> Data:
    """With a tolerance of what the simulator itself cannot tell: predictions that nothing that matters tells apart,
    (n, ntrials, T, C), part where an object sticks in one and slips in another.

    As of :func:`with_numerics`, the mean over a block errs alike, the rest sample by sample.
    """
    spread = alike - alike.mean(axis=0)
    common = _block_means(spread, data.block)
    share = 1 / (len(alike) - 1)
    lasting, apart = (share * (part**2).sum(axis=0) for part in (common, spread - common))
    return replace(data, sigma=np.sqrt(data.sigma**2 + lasting + apart), common=np.sqrt(data.common**2 + lasting))


def on_grid(data: Data, kind: str, names: Sequence[str] | None, step: float) -> Data:
    """With readings of some parts (None: of all) that lie on a grid, as predictions of them do: two values δ apart end
    up a whole step apart with probability |δ| / step, which is their mean square; E|δ| = √(2/π) σ. It is no noise: what
    stands still stays apart."""
    channels = [f"{kind}.{name}" for name in names] if names is not None else None
    mine = [k == kind if channels is None else c in channels for c, k in zip(data.channels, data.kinds, strict=True)]

    wider = np.sqrt(data.sigma**2 + np.minimum(np.sqrt(2 / np.pi) * data.sigma * step, step**2 / 6))
    return replace(data, sigma=np.where(mine, wider, data.sigma))


def by_block(values: Array, rows: int) -> Array:
    """Sums over blocks of rows, (..., T, C) to (..., nblocks, C)."""
    return np.add.reduceat(values, np.arange(0, values.shape[-2], rows), axis=-2)


def over_blocks(sums: Array, rows: int, length: int) -> Array:
    """The same number for all rows of a block, (..., T, C)."""
    return np.repeat(sums, rows, axis=-2)[..., :length, :]


def _block_means(values: Array, rows: int) -> Array:
    """The mean of its block for every row, (..., T, C)."""
    return over_blocks(by_block(values, rows) / by_block(np.ones_like(values), rows), rows, values.shape[-2])


def _dilated(size: Array) -> Array:
    """The largest within a few rows: what happens may happen that much earlier or later."""
    around = size.copy()
    for shift in range(1, EVENT_ROWS + 1):
        around[:, shift:] = np.maximum(around[:, shift:], size[:, :-shift])
        around[:, :-shift] = np.maximum(around[:, :-shift], size[:, shift:])
    return around


def off_by_step(simulated: Signals, finer: Signals) -> Signals:
    """What signals get wrong by their physics step, from a second run with one :data:`FINER` times shorter."""
    share = FINER / (FINER - 1)
    return Signals(*((getattr(simulated, f) - getattr(finer, f)) * share for f in Signals.__dataclass_fields__))


def part(data: Data, trials: Sequence[int]) -> Data:
    """Of some trials."""
    index = list(trials)
    return replace(data, value=data.value[index], sigma=data.sigma[index], common=data.common[index])


def without_repeats(data: Data) -> Data:
    """Readings of load cells that repeat the one before exactly count as not measured: they were missed."""
    value = data.value.copy()
    for c, kind in enumerate(data.kinds):
        if kind == "force":
            repeated = np.zeros(value.shape[:2], dtype=bool)
            repeated[:, 1:] = data.value[:, 1:, c] == data.value[:, :-1, c]
            value[:, :, c] = np.where(repeated, np.nan, value[:, :, c])
    return replace(data, value=value)


def predicted(data: Data, signals: Signals) -> Array:
    """The predictions of the measured channels, (nsim, T, C): finite.

    A simulation that diverged, or ran away, is :data:`HOPELESS` off: it loses wherever predictions are compared.
    """
    sources = {"position": signals.position, "velocity": signals.velocity, "force": signals.reading}
    columns = [sources[kind][:, :, part] for kind, part in zip(data.kinds, data.part, strict=True)]
    length = data.value.shape[1]
    most = np.nanmax(np.abs(data.value), axis=(0, 1), initial=0.0) + HOPELESS * data.noise
    return np.clip(
        np.nan_to_num(np.stack([column[:, :length] for column in columns], axis=-1), nan=np.inf), -most, most
    )
