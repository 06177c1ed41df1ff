"""Periods of a force that repeats over position, read off what the nominal model leaves.

No gradient leads from one period to another: a few per cent off, a ripple is out of step after some turns. But a servo
gives way to such a force by what it is stiff, so that the error of the position has the same period over position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.effects import EFFECTS
from tiago_mj.gap.floor import Data
from tiago_mj.gap.hypotheses import Candidate
from tiago_mj.gap.plant import Plant

Array = NDArray[np.float64]

RIPPLE: Final = "motor_cogging"
#: Periods that are looked at, evenly in what a travel holds of them, so many to one more, from the longest on; those
#: that are simulated.
OVERSAMPLING: Final = 6
MOST: Final = 2000
BEST: Final = 4
#: Peaks closer than this share of a period per travel are one.
APART: Final = 0.4
#: Between rows that are farther apart than a period over this, positions are interpolated, to so many a row at most;
#: farther apart are all but a few.
WITHIN: Final = 4.0
FINEST: Final = 12
FAST: Final = 0.95
#: A squared error counts no more than so many times the median one: onsets say nothing of ripples.
FAR: Final = 9.0


def with_periods(
    plant: Plant, data: Data, base: Array, free: NDArray[np.bool_], share: Array, pool: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """The pool, in which ripples have the periods that the error of the position shows.

    Args:
        plant: the nominal simulator.
        data: measured.
        base: nominal predictions, (ntrials, T, C).
        free: rows in which nothing is touched, (ntrials, T).
        share: of the way to where a force pushes a joint, that it covers from one row to the next, (njoints,).
        pool: candidates.
    """
    if not any(c.effect == RIPPLE for c in pool):
        return tuple(pool)
    declared = EFFECTS[RIPPLE]
    names = plant.wiring.targets.names("joint")
    columns = {data.part[c]: c for c, kind in enumerate(data.kinds) if kind == "position"}
    out = [c for c in pool if c.effect != RIPPLE]
    found: dict[object, Candidate] = {c.label: c for c in pool if c.effect == RIPPLE}
    for candidate in found.values():
        joints = [names.index(name) for name in candidate.target or names]
        side = 0 if plant.wiring.targets.slides[joints[0]] else 1
        low, high = declared.parameters["period"].bounds[side]
        traces = [
            Trace(data.value[t, :, columns[j]], (data.value - base)[t, :, columns[j]], free[t], float(share[j]))
            for j in joints
            if j in columns
            for t in range(len(data.value))
        ]
        settings = peaks(traces, low, high) or [dict(candidate.fixed)["period"]]
        out += [replace(candidate, fixed=(("period", period),)) for period in settings]
    return tuple(out)


@dataclass(frozen=True)
class Trace:
    """One joint in one trial: its position, the error of that, which rows count, each (T,), and how far it follows a
    force from one row to the next."""

    position: Array
    error: Array
    counts: NDArray[np.bool_]
    share: float = 1.0

    @property
    def known(self) -> NDArray[np.bool_]:
        """Rows that count and were measured."""
        known: NDArray[np.bool_] = self.counts & np.isfinite(self.position) & np.isfinite(self.error)
        return known


def peaks(traces: Sequence[Trace], low: float, high: float) -> list[float]:
    """Periods of the strongest ripples, strongest first; low and high in the unit of the position."""
    used = [one for one in traces if one.known.sum() > 16 and np.ptp(one.position[one.known]) > low]
    if not used:
        return []
    travel = max(float(np.ptp(one.position[one.known])) for one in used)
    count = int(np.clip(OVERSAMPLING * travel / low, 2 * OVERSAMPLING, MOST))
    waves = np.linspace(1 / high, min(1 / low, 1 / high + count / (OVERSAMPLING * travel)), count)
    low = float(1 / waves[-1])
    power, size = np.zeros(count), np.zeros(count)
    for one in used:
        error = _rest(one.position[one.known], one.error[one.known])
        times = int(np.clip(np.ceil(WITHIN * np.nanquantile(np.abs(np.diff(one.position)), FAST) / low), 1, FINEST))
        between, share = _between(np.nan_to_num(one.position), times), 1 - (1 - one.share) ** (1 / times)
        sine = _followed(np.sin(2 * np.pi * waves[:, None] * between), share)[:, ::times][:, one.known]
        power += sine @ error
        size += (sine * sine).sum(axis=1)
    strength = power**2 / np.maximum(size, 1e-12)
    order = np.argsort(-strength)
    out: list[float] = []
    for k in order:
        if all(abs(waves[k] - 1 / other) * travel > APART for other in out):
            out.append(float(1 / waves[k]))
            if len(out) == BEST:
                break
    return out


def _between(position: Array, times: int) -> Array:
    """Positions at so many instants a row, (T,) to ((T - 1) · times + 1,): cubics between rows, with their slopes."""
    slope, share = np.gradient(position), (np.arange(times) / times)[:, None]
    first, last, rise, end = position[:-1], position[1:], slope[:-1], slope[1:]
    bend = share * (1 - share)
    inner = first + share * (last - first) + bend * ((1 - share) * (rise - last + first) - share * (end - last + first))
    return np.append(inner.T.ravel(), position[-1])


def _followed(force: Array, share: float) -> Array:
    """Where a joint is that follows a force over the rows, (..., T): in fast motion it is behind a ripple by more than
    a quarter of it."""
    out = force.copy()  # it begins at rest
    for k in range(1, force.shape[-1]):
        pushed = force[..., k] if share == 1 else (force[..., k - 1] + force[..., k]) / 2
        out[..., k] = out[..., k - 1] + share * (pushed - out[..., k - 1])
    return out


def _rest(position: Array, error: Array) -> Array:
    """The error without what is constant or grows with the position or the speed, bounded."""
    smooth = np.stack([np.ones_like(position), position, np.gradient(position)], axis=1)
    rest = error - smooth @ np.linalg.lstsq(smooth, error, rcond=None)[0]
    limit = np.sqrt(FAR * np.median(rest**2))
    bounded: Array = np.clip(rest, -limit, limit)
    return bounded
