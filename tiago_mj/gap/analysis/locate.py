"""Gap table: mean squared residual by channel, phase of the motion and frequency band, with bootstrap intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.result import BANDS, PHASES, Place

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

#: Upper edges of the bands below the last [Hz]; ``bias`` is the mean over the phase.
EDGES: Final = (1.0, 5.0)
#: Draws of the bootstrap, and the quantiles of its interval.
DRAWS: Final = 400
QUANTILES: Final = (0.05, 0.95)


@dataclass(frozen=True)
class Signal:
    """One stretch of a channel that was measured without a break.

    Attributes:
        residual: in units of the noise floor, (T,); NaN: not measured.
        phase: of every row, as indices into ``PHASES``, (T,).
        piece: of every row, (T,): pieces are as good as independent, and are what the bootstrap draws. Numbers are
            those of all stretches together.
    """

    residual: Array
    phase: Ints
    piece: Ints


def locate(data: Data, predicted: Array, phase: NDArray[np.int_], period: float, seed: int = 0) -> tuple[Place, ...]:
    """Mean squared residual in units of the noise floor, by channel, phase and frequency band.

    Args:
        data: measured.
        predicted: (ntrials, T, C).
        phase: (ntrials, T).
        period: control period [s].
        seed: of the bootstrap, which draws trials.

    Returns:
        Rows with at least two samples, largest share of the excess first.
    """
    residual = (data.value - predicted) / data.floor
    signals = {
        name: [Signal(one[:, c], phase[k], np.full(len(one), k)) for k, one in enumerate(residual)]
        for c, name in enumerate(data.channels)
    }
    return table(signals, period, 0.5 / period, seed)


def table(signals: Mapping[str, Sequence[Signal]], period: float, highest: float, seed: int) -> tuple[Place, ...]:
    """Gap table of given signals, as of :func:`locate`.

    Args:
        signals: stretches of every channel.
        period: of the rows [s].
        highest: frequency up to which the noise is white [Hz]; there is none above.
        seed: of the bootstrap.

    Returns:
        Rows with at least two samples, largest share of the excess over the noise first.
    """
    rng = np.random.default_rng(seed)
    rows = [
        (name, PHASES[p], *row)
        for name, parts in signals.items()
        for p in range(len(PHASES))
        for row in _phase(parts, p, period, highest, rng)
    ]
    whole = sum(row[-1] for row in rows)
    places = [Place(*row[:-1], row[-1] / whole if whole > 0 else 0.0) for row in rows]
    return tuple(sorted(places, key=lambda place: -place.share))


def _phase(
    parts: Sequence[Signal], phase: int, period: float, highest: float, rng: np.random.Generator
) -> list[tuple[str, float, float, float, float]]:
    """Band, mean square, the ends of its interval and the summed excess for one phase of one channel; None for fewer
    than two samples."""
    inside = [np.isfinite(part.residual) & (part.phase == phase) for part in parts]
    counts = [int(rows.sum()) for rows in inside]
    if sum(counts) < 2:
        return []
    means = [float(part.residual[rows].mean()) if rows.any() else 0.0 for part, rows in zip(parts, inside, strict=True)]
    split = [_bands(np.where(np.isfinite(part.residual), part.residual, 0.0), period) for part in parts]
    found = []
    for b, band in enumerate(BANDS):
        if 0 < b < len(BANDS) - 1 and max(counts) * period < 1 / (2 * EDGES[b - 1]):
            continue  # the phase is too short to hold this band
        if _noise_share(band, highest) == 0 and b:
            continue  # nothing passes the filter there
        if b == 0:
            drawn = _mean_squares(parts, inside, rng)
            energy = float(np.dot(np.square(means), counts))
        else:
            centred = [
                np.where(rows, one[b - 1] - (mean if b == 1 else 0.0), 0.0)
                for one, rows, mean in zip(split, inside, means, strict=True)
            ]
            drawn = _energies(parts, inside, centred, rng)
            energy = float(sum(one @ one for one in centred))
        low, high = np.quantile(drawn, QUANTILES)
        excess = max(energy - _noise_share(band, highest) * sum(counts), 0.0)
        gap = energy / sum(counts)
        found.append((band, gap, min(float(low), gap), max(float(high), gap), excess))  # few pieces may leave it out
    return found


def stage(places: tuple[Place, ...]) -> str | None:
    """Stage of the signal chain that the largest excess indicates; None without an excess."""
    if not places or places[0].share <= 0:
        return None
    kinds: dict[str, float] = {}
    for place in places:
        kind = place.channel.partition(".")[0]
        kinds[kind] = kinds.get(kind, 0.0) + place.share
    if kinds.get("force", 0.0) > 0.9:
        return "force_sensor"
    if kinds.get("velocity", 0.0) > 0.9:
        return "joint_sensor"
    bias = sum(p.share for p in places if p.band == "bias" and p.phase == "rest" and p.channel.startswith("position"))
    if bias > 0.5:
        return "joint_sensor"
    motion = sum(p.share for p in places if p.phase in ("free motion", "reversal"))
    return "transmission" if motion > 0.5 else "actuator"


def _bands(residual: Array, period: float) -> list[Array]:
    """A signal, (T,), split into frequency bands that add up to it."""
    spectrum = np.fft.rfft(residual)
    frequency = np.fft.rfftfreq(len(residual), period)
    edges = (-1.0, *EDGES, np.inf)
    return [
        np.fft.irfft(np.where((frequency > a) & (frequency <= b), spectrum, 0.0), n=len(residual))
        for a, b in pairwise(edges)
    ]


def _pieces(
    parts: Sequence[Signal], inside: Sequence[NDArray[np.bool_]], rng: np.random.Generator
) -> tuple[list[Ints], Array]:
    """Indices of the pieces that the rows belong to, from 0, (count,) for each stretch, and how often each bootstrap
    draw contains them, (DRAWS, npieces); a single piece is always drawn."""
    numbers = np.concatenate([part.piece[rows] for part, rows in zip(parts, inside, strict=True)])
    names, of = np.unique(numbers, return_inverse=True)
    edges = np.cumsum([int(rows.sum()) for rows in inside])[:-1]
    count = len(names)
    return np.split(of, edges), rng.multinomial(count, np.full(count, 1 / count), size=DRAWS).astype(float)


def _energies(
    parts: Sequence[Signal], inside: Sequence[NDArray[np.bool_]], values: Sequence[Array], rng: np.random.Generator
) -> Array:
    """Mean squares over resampled pieces, (DRAWS,)."""
    of, times = _pieces(parts, inside, rng)
    joined = np.concatenate(of)
    squares = np.concatenate([one[rows] ** 2 for one, rows in zip(values, inside, strict=True)])
    drawn: Array = times @ np.bincount(joined, squares) / (times @ np.bincount(joined))
    return drawn


def _mean_squares(parts: Sequence[Signal], inside: Sequence[NDArray[np.bool_]], rng: np.random.Generator) -> Array:
    """Squares of the stretches' means, weighted by their samples, over resampled pieces, (DRAWS,)."""
    of, times = _pieces(parts, inside, rng)
    total, samples = np.zeros(DRAWS), np.zeros(DRAWS)
    for part, rows, piece in zip(parts, inside, of, strict=True):
        count = times @ np.bincount(piece, minlength=times.shape[1])
        mean = times @ np.bincount(piece, part.residual[rows], minlength=times.shape[1]) / np.maximum(count, 1)
        total, samples = total + mean**2 * count, samples + count
    drawn: Array = total / samples
    return drawn


def _noise_share(band: str, highest: float) -> float:
    """Fraction of the white noise's power in a band."""
    low, high = {
        BANDS[0]: (0.0, 0.0),
        BANDS[1]: (0.0, EDGES[0]),
        BANDS[2]: EDGES,
        BANDS[3]: (EDGES[1], np.inf),
    }[band]
    return max(min(high, highest) - min(low, highest), 0.0) / highest
