"""Spatial periods of a force that repeats over position, from a periodogram of the position error.

The likelihood has no useful gradient in a period: at a few per cent off, a ripple is out of phase after some turns. But
a servo yields to such a force in proportion to its compliance, so the position error has the same period over position.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.detectors.liveliest import liveliest
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.simulation.plant import Plant

Array = NDArray[np.float64]

#: Waves that are looked at, evenly, so many to one more over where the joint was seen, from the longest on; the best of
#: them, and those around each, so many to one more between a joint's zero and the farthest; those that are simulated.
WAVES_PER_CYCLE: Final = 3
MAX_WAVES: Final = 1000
MAX_COARSE_PEAKS: Final = 8
FINE_WAVES_PER_CYCLE: Final = 12
MAX_FINE_WAVES: Final = 100
MAX_PERIODS: Final = 4
#: Waves that differ by less than this over either of these lengths are one.
MIN_PEAK_DISTANCE: Final = 0.4
#: Between rows that are farther apart than a period over this, positions are interpolated, to so many a row at most;
#: farther apart are all but a few.
POINTS_PER_PERIOD: Final = 4.0
MAX_POINTS_PER_ROW: Final = 12
FAST_QUANTILE: Final = 0.95
#: A squared error counts no more than so many times the median one: onsets say nothing of ripples.
MAX_SQUARE_RATIO: Final = 9.0


def with_periods(
    plant: Plant, data: Data, base: Array, free: NDArray[np.bool_], share: Array, pool: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """The pool, its ripples at the periods that the position error shows, of each joint in its liveliest trials.

    Args:
        plant: the nominal simulator.
        data: measured.
        base: nominal predictions, (ntrials, T, C).
        free: rows in which nothing is touched, (ntrials, T).
        share: of the way to where a force pushes a joint, that it covers from one row to the next, (njoints,).
        pool: candidates.
    """
    names = plant.wiring.targets.names("joint")
    columns = {data.part[c]: c for c, kind in enumerate(data.kinds) if kind == "position"}
    error = data.value - base
    rows = (np.isfinite(error) & free[:, :, None]).sum(axis=1)
    moved = np.nansum(np.abs(np.diff(base, axis=1)), axis=1)
    out = [c for c in pool if not EFFECTS[c.effect].ripple_period]
    found: dict[object, Candidate] = {c.label: c for c in pool if EFFECTS[c.effect].ripple_period}
    for candidate in found.values():
        declared = EFFECTS[candidate.effect]
        name = declared.ripple_period
        joints = [names.index(name) for name in candidate.target or names]
        side = 0 if plant.wiring.targets.slides[joints[0]] else 1
        low, high = declared.parameters[name].bounds[side]
        traces = [
            Trace(data.value[t, :, columns[j]], error[t, :, columns[j]], free[t], float(share[j]))
            for j in joints
            if j in columns
            for t in liveliest(moved[:, columns[j]], rows[:, columns[j]])
        ]
        settings = peaks(traces, low, high) or [dict(candidate.fixed)[name]]
        out += [replace(candidate, fixed=((name, period),)) for period in settings]
    return tuple(out)


@dataclass(frozen=True)
class Trace:
    """Position and position error of one joint in one trial, with a mask of valid rows, (T,) each, and the fraction of
    its response to a force step that the joint completes in one row."""

    position: Array
    error: Array
    counts: NDArray[np.bool_]
    share: float = 1.0

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of the rows that are valid and measured."""
        known: NDArray[np.bool_] = self.counts & np.isfinite(self.position) & np.isfinite(self.error)
        return known


def peaks(traces: Sequence[Trace], low: float, high: float) -> list[float]:
    """Periods of the strongest ripples, strongest first; low and high in the unit of the position.

    First those of any phase; then, around the best of them, those whose phase is zero at the joint's zero, as a
    ripple's is. That may be far from where the joint moves, so that small changes of the period matter.
    """
    used = [one for one in traces if one.known.sum() > 16 and np.ptp(one.position[one.known]) > low]
    if not used:
        return []
    places = np.concatenate([one.position[one.known] for one in used])
    span, farthest = float(np.ptp(places)), float(np.abs(places).max())
    count = int(np.clip(WAVES_PER_CYCLE * span / low, 2 * WAVES_PER_CYCLE, MAX_WAVES))
    waves = np.linspace(1 / high, min(1 / low, 1 / high + count / (WAVES_PER_CYCLE * span)), count)
    sine, cosine, sines, cosines, both = _products(used, waves)
    strength = sine**2 * cosines - 2 * sine * cosine * both + cosine**2 * sines
    strength /= np.maximum(sines * cosines - both**2, 1e-12)
    near = np.linspace(
        -1, 1, min(math.ceil(2 * FINE_WAVES_PER_CYCLE * farthest / (WAVES_PER_CYCLE * span)), MAX_FINE_WAVES)
    ) / (WAVES_PER_CYCLE * span)
    there = [waves[k] for k in _highest_peaks(strength, waves, MIN_PEAK_DISTANCE / span, MAX_COARSE_PEAKS)]
    waves = np.unique(np.clip(np.add.outer(there, near), 1 / high, waves[-1]))
    sine, _, sines, *_ = _products(used, waves)
    strength = sine**2 / np.maximum(sines, 1e-12)
    return [float(1 / waves[k]) for k in _highest_peaks(strength, waves, MIN_PEAK_DISTANCE / farthest, MAX_PERIODS)]


def _highest_peaks(strength: Array, waves: Array, apart: float, count: int) -> list[int]:
    """Indices of the highest points, at least ``apart`` from each other."""
    out: list[int] = []
    for k in np.argsort(-strength):
        if all(abs(waves[k] - waves[other]) > apart for other in out):
            out.append(int(k))
            if len(out) == count:
                break
    return out


def _products(used: Sequence[Trace], waves: Array) -> Array:
    """Inner products for a least-squares fit of sine and cosine of the position, each passed through the joint's
    response: with the error, with themselves and with each other, (5, nwaves)."""
    sums = np.zeros((5, len(waves)))
    for one in used:
        smooth = _smooth_errors(one.position[one.known])
        error = _residual(smooth, one.error[one.known])
        position = _filled(one.position)
        fastest = np.quantile(np.abs(np.diff(position)), FAST_QUANTILE)
        times = int(np.clip(np.ceil(POINTS_PER_PERIOD * fastest * waves[-1]), 1, MAX_POINTS_PER_ROW))
        share = 1 - (1 - one.share) ** (1 / times)
        turned = np.exp(2j * np.pi * waves[:, None] * _interpolated(position, times))
        wave = _joint_response(turned, share)[:, ::times][:, one.known]
        wave -= (wave @ smooth) @ smooth.T
        sine, cosine = wave.imag, wave.real
        products = ((sine, sine), (cosine, cosine), (sine, cosine))
        sums += [sine @ error, cosine @ error, *((a * b).sum(axis=1) for a, b in products)]
    return sums


def _filled(position: Array) -> Array:
    """Positions, (T,), gaps interpolated linearly, as an encoder may be read in every fourth row only."""
    measured = np.flatnonzero(np.isfinite(position))
    return np.interp(np.arange(len(position)), measured, position[measured])


def _interpolated(position: Array, times: int) -> Array:
    """Positions at ``times`` instants a row by cubic interpolation, (T,) to ((T - 1) · times + 1,)."""
    slope, share = np.gradient(position), (np.arange(times) / times)[:, None]
    first, last, rise, end = position[:-1], position[1:], slope[:-1], slope[1:]
    bend = share * (1 - share)
    inner = first + share * (last - first) + bend * ((1 - share) * (rise - last + first) - share * (end - last + first))
    return np.append(inner.T.ravel(), position[-1])


def _joint_response(force: Array, share: float) -> Array:
    """First-order response of a joint to a force over the rows, (..., T); in fast motion it lags a ripple by more than
    a quarter of its period."""
    if share == 1:
        return force
    begun = (1 - share / 2) * force[..., :1]  # it begins at rest
    out: Array = signal.lfilter([share / 2, share / 2], [1, share - 1], force, zi=begun)[0]
    return out


def _smooth_errors(position: Array) -> Array:
    """Orthonormal basis of errors of other causes: constant, proportional to position and to speed, (T, 3)."""
    return np.linalg.qr(np.stack([np.ones_like(position), position, np.gradient(position)], axis=1))[0]


def _residual(smooth: Array, error: Array) -> Array:
    """The error with its smooth part projected out, clipped."""
    rest = error - smooth @ (smooth.T @ error)
    limit = np.sqrt(MAX_SQUARE_RATIO * np.median(rest**2))
    bounded: Array = np.clip(rest, -limit, limit)
    return bounded
