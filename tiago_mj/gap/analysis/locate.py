"""Where the gap lies: channel × phase × frequency band, with intervals."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.result import BANDS, PHASES, Place

Array = NDArray[np.float64]

#: Upper edges of the bands below the last [Hz]; ``bias`` is the mean over the phase.
EDGES: Final = (1.0, 5.0)
DRAWS: Final = 200
#: Channel kinds and phases that point to a stage of the signal chain, first match by the largest share.
_STAGE_OF_SENSOR: Final = "force_sensor"


def locate(data: Data, predicted: Array, phase: NDArray[np.int_], period: float, seed: int = 0) -> tuple[Place, ...]:
    """Mean squared residual in units of the noise floor, by channel, phase and band.

    Args:
        data: measured.
        predicted: (ntrials, T, C).
        phase: (ntrials, T).
        period: control period [s].
        seed: of the moving-block bootstrap (Künsch 1989; whole trials' segments are the blocks).

    Returns:
        Rows with at least two samples, largest share of the excess first.
    """
    rng = np.random.default_rng(seed)
    residual = (data.value - predicted) / data.noise
    rows: list[tuple[str, str, str, float, float, float, float]] = []
    for c, channel in enumerate(data.channels):
        parts = _bands(np.where(np.isfinite(residual[:, :, c]), residual[:, :, c], 0.0), period)
        known = np.isfinite(data.value[:, :, c])
        for p, name in enumerate(PHASES):
            inside = known & (phase == p)
            if inside.sum() < 2:
                continue
            bias = np.array(
                [residual[k, inside[k], c].mean() if inside[k].any() else np.nan for k in range(len(inside))]
            )
            counts = inside.sum(axis=1)
            mean = np.where(counts > 0, np.nan_to_num(bias), 0.0)
            rows.append(
                (channel, name, BANDS[0], *_interval(mean**2 * counts, counts, rng), float((mean**2 * counts).sum()))
            )
            for b, part in enumerate(parts):
                longest = counts.max() * period
                if b < 2 and longest < 1 / (2 * EDGES[b]):
                    continue  # the phase is too short to hold this band
                centred = np.where(inside, part - (mean[:, None] if b == 0 else 0.0), 0.0)
                energy = (centred**2).sum(axis=1)
                rows.append((channel, name, BANDS[b + 1], *_interval(energy, counts, rng), float(energy.sum())))
    # Excess over what noise alone would leave in each row's bandwidth.
    excess = [
        max(total - _noise_share(band, period) * _samples(data, channel, name, phase), 0.0)
        for channel, name, band, _, _, _, total in rows
    ]
    whole = sum(excess)
    places = [
        Place(channel, name, band, gap, low, high, e / whole if whole > 0 else 0.0)
        for (channel, name, band, gap, low, high, _), e in zip(rows, excess, strict=True)
    ]
    return tuple(sorted(places, key=lambda place: -place.share))


def stage(places: tuple[Place, ...], onset_late: bool = False) -> str | None:
    """Stage of the signal chain that the pattern points to; None without an excess."""
    if not places or places[0].share <= 0:
        return None
    kinds: dict[str, float] = {}
    for place in places:
        kind = place.channel.partition(".")[0]
        kinds[kind] = kinds.get(kind, 0.0) + place.share
    if kinds.get("force", 0.0) > 0.9:
        contact = sum(p.share for p in places if p.phase in ("contact onset", "loading", "release"))
        return "contact" if contact > 0.9 and onset_late else _STAGE_OF_SENSOR
    if kinds.get("velocity", 0.0) > 0.9:
        return "joint_sensor"
    bias = sum(p.share for p in places if p.band == "bias" and p.phase == "rest" and p.channel.startswith("position"))
    if bias > 0.5:
        return "joint_sensor"
    motion = sum(p.share for p in places if p.phase in ("free motion", "reversal"))
    return "transmission" if motion > 0.5 else "actuator"


def _bands(residual: Array, period: float) -> list[Array]:
    """Split signals (ntrials, T) by frequency; the parts add up to the signal."""
    spectrum = np.fft.rfft(residual, axis=1)
    frequency = np.fft.rfftfreq(residual.shape[1], period)
    edges = (-1.0, *EDGES, np.inf)
    return [
        np.fft.irfft(np.where((frequency > a) & (frequency <= b), spectrum, 0.0), n=residual.shape[1], axis=1)
        for a, b in pairwise(edges)
    ]


def _interval(energy: Array, counts: NDArray[np.int_], rng: np.random.Generator) -> tuple[float, float, float]:
    """Mean per sample over trials, with a 90 % bootstrap interval over trials."""
    gap = float(energy.sum() / counts.sum())
    if len(energy) < 2:
        return gap, gap, gap
    drawn = rng.integers(len(energy), size=(DRAWS, len(energy)))
    totals = counts[drawn].sum(axis=1)
    means = energy[drawn].sum(axis=1) / np.maximum(totals, 1)
    low, high = np.quantile(means, [0.05, 0.95])
    return gap, float(low), float(high)


def _noise_share(band: str, period: float) -> float:
    """Share of white noise's power that falls into a band."""
    nyquist = 0.5 / period
    edges = {BANDS[0]: (0.0, 0.0), BANDS[1]: (0.0, EDGES[0]), BANDS[2]: EDGES, BANDS[3]: (EDGES[1], nyquist)}[band]
    return max(min(edges[1], nyquist) - min(edges[0], nyquist), 0.0) / nyquist


def _samples(data: Data, channel: str, name: str, phase: NDArray[np.int_]) -> int:
    c = data.channels.index(channel)
    return int((np.isfinite(data.value[:, :, c]) & (phase == PHASES.index(name))).sum())
