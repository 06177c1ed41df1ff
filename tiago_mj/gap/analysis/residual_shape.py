"""Shape of a channel's residual: the share of its sum of squares that each of a few functions explains,
cross-validated.

For each shape (:mod:`~tiago_mj.gap.analysis.regressors`) its functions are fitted to the residual of all segments but
one and evaluated on that one, in turn, so that functions which fit by chance explain nothing. A line at one frequency
has another phase in every segment: its share is that in a narrow band, which the other segments choose.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.analysis.regressors import Bools, Columns, Trajectory, columns

Array = NDArray[np.float64]

#: A shape explains at least this share of the residual's mean square, or else it is none: of 200 draws of white noise,
#: and as many of noise that is correlated over a tenth of a trial, less than 5 % have a shape. Of fewer trials than
#: :data:`ENOUGH_TRIALS` it takes more.
LEVEL: Final = 0.3
LEVEL_BELOW_ENOUGH_TRIALS: Final = 0.5
ENOUGH_TRIALS: Final = 4
#: Of shapes that explain as much to within this, the simpler one.
AS_GOOD: Final = 0.1
#: A shape helps in at least this share of the segments that it was not fitted to.
HELPS: Final = 2 / 3
#: One trial alone is cut into so many parts.
PARTS: Final = 4
#: A line has at least so many cycles in a segment; its band is so wide to either side, and at least so many bins.
CYCLES: Final = 4
BAND: Final = 0.1
BINS: Final = 1.5
#: A line is the motion's own, and no shape, where that has at least so large a part of the residual's share there.
OWN: Final = 0.5


@dataclass(frozen=True)
class Segment:
    """Rows of one trial that are left out together."""

    trial: int
    rows: slice


@dataclass(frozen=True)
class Share:
    """Share of a residual that a shape explains on left-out segments; ``at`` as in
    :class:`tiago_mj.gap.result.ResidualShape`."""

    shape: str
    share: float
    at: float | None = None


def shares(residual: Array, trajectory: Trajectory, sigma: Array | None = None) -> list[Share]:
    """Share of a channel's residual that each shape explains, in decreasing order; of equally good shapes the simplest
    first.

    Args:
        residual: in any unit, (ntrials, T), NaN where nothing was measured.
        trajectory: belonging to the channel.
        sigma: what each sample may be off by, in the same unit, (ntrials, T): the residual is counted in units of that;
            None: all alike.

    Returns:
        One row a shape that these trials can show.
    """
    seen = np.isfinite(residual)
    weight = np.where(seen, 1.0 if sigma is None else 1 / sigma, 0.0)
    filled = np.where(seen, residual, 0.0) * weight
    segments = [s for s in _segments(len(residual), seen) if np.any(filled[s.trial, s.rows])]
    if len(segments) < 2:
        return []
    found = []
    for shape, several in groupby(columns(trajectory, seen), key=lambda one: one.shape):
        found.append(_of_columns(shape, list(several), filled, weight, segments))
    line = _of_line(filled, trajectory, segments)
    found += [line] if line else []
    most = max((one.share for one in found), default=0.0)
    leading = next((one for one in found if one.share >= most - AS_GOOD), None)
    return sorted(found, key=lambda one: (one is not leading, -one.share))


def named(found: Sequence[Share], ntrials: int) -> Share:
    """The shape that is reported: the first of :func:`shares`, or ``irregular`` where its share is too small for so
    many trials."""
    if not found:
        return Share("irregular", 0.0)
    level = LEVEL if ntrials >= ENOUGH_TRIALS else LEVEL_BELOW_ENOUGH_TRIALS
    return found[0] if found[0].share >= level else Share("irregular", max(found[0].share, 0.0))


def _segments(ntrials: int, seen: Bools) -> Iterator[Segment]:
    """Segments: whole trials, or parts of a single one; seen is (ntrials, T)."""
    parts = 1 if ntrials > 1 else PARTS
    for trial in range(ntrials):
        measured = np.flatnonzero(seen[trial])
        for part in np.array_split(measured, parts):
            if len(part) > 1:
                yield Segment(trial, slice(int(part[0]), int(part[-1]) + 1))


def _of_columns(
    shape: str, several: Sequence[Columns], residual: Array, weight: Array, segments: Sequence[Segment]
) -> Share:
    """Cross-validated share of a shape; of several forms the other segments choose one.

    Args:
        shape: its name.
        several: forms, each of the same number of columns.
        residual: times its weight, (ntrials, T).
        weight: 0 where nothing was measured, (ntrials, T).
        segments: two at least.
    """
    forms = [_sums(one, residual, weight, segments) for one in several]
    own = np.array([residual[s.trial, s.rows] @ residual[s.trial, s.rows] for s in segments])
    gained = np.zeros(len(segments))
    for g in range(len(segments)):
        fitted = [_fitted(both.sum(axis=0) - both[g], products.sum(axis=0) - products[g]) for both, products in forms]
        best = int(np.argmax([explained for _, explained in fitted]))
        weights = fitted[best][0]
        gained[g] = 2 * weights @ forms[best][1][g] - weights @ forms[best][0][g] @ weights
    every = [_fitted(both.sum(axis=0), products.sum(axis=0))[1] for both, products in forms]
    return _share(shape, gained, own, several[int(np.argmax(every))].at)


def _share(shape: str, gained: Array, own: Array, at: float | None) -> Share:
    """Share from each segment's explained and own sum of squares, (nsegments,) each; 0 where most segments gain
    nothing."""
    helps = float(np.mean(gained > 0)) >= HELPS
    return Share(shape, float(gained.sum() / own.sum()) if helps else 0.0, at)


def _sums(one: Columns, residual: Array, weight: Array, segments: Sequence[Segment]) -> tuple[Array, Array]:
    """Normal equations by segment: products of columns, (nsegments, n, n), and with the residual, (nsegments, n); the
    residual is times its weight, (ntrials, T) both."""
    values = one.values * weight
    inside = [values[:, s.trial, s.rows] for s in segments]
    return (
        np.stack([x @ x.T for x in inside]),
        np.stack([x @ residual[s.trial, s.rows] for x, s in zip(inside, segments, strict=True)]),
    )


def _fitted(squares: Array, products: Array) -> tuple[Array, float]:
    """Least-squares weights, (n,), and the explained sum of squares; nearly collinear columns are damped."""
    ridge = 1e-6 * max(float(np.trace(squares)), 1e-12) * np.eye(len(products))
    weights = np.asarray(np.linalg.solve(squares + ridge, products), dtype=float)
    return weights, float(2 * weights @ products - weights @ squares @ weights)


def _of_line(residual: Array, trajectory: Trajectory, segments: Sequence[Segment]) -> Share | None:
    """Share of a spectral line, whose frequency is ``at`` [Hz]; None where no segment is long enough, or where motion
    and command have as much power there.

    Args:
        residual: times its weight, (ntrials, T).
        trajectory: belonging to the channel.
        segments: two at least.
    """
    length = max(s.rows.stop - s.rows.start for s in segments)
    frequency = np.fft.rfftfreq(length, trajectory.period)
    lowest = CYCLES / (length * trajectory.period)
    tried = np.flatnonzero((frequency >= lowest) & (frequency < frequency[-1]))
    if not len(tried):
        return None

    reach = np.maximum(BAND * frequency[tried], BINS * frequency[1])
    inside = np.abs(frequency - frequency[tried][:, None]) <= reach[:, None]
    there = _above_the_rest(residual, segments, length, inside)
    own = np.array([residual[s.trial, s.rows] @ residual[s.trial, s.rows] for s in segments])
    others = there.sum(axis=0) - there
    gained = there[np.arange(len(segments)), others.argmax(axis=1)]
    place = int(there.sum(axis=0).argmax())
    if place in (0, len(tried) - 1) and len(tried) > 1:  # it grows towards where nothing is tried: no line
        return None
    within = np.where(inside[place], _spectra(residual, segments, length).sum(axis=0), 0.0)
    found = _share("frequency", gained, own, float(frequency[within.argmax()]))
    for signal in (trajectory.position, trajectory.velocity, trajectory.command):
        still = signal - signal.mean(axis=1, keepdims=True)
        total = sum(float(still[s.trial, s.rows] @ still[s.trial, s.rows]) for s in segments)
        of_motion = _above_the_rest(still, segments, length, inside[[place]]).sum()
        if total > 0 and of_motion / total > OWN * found.share:
            return None
    return found


def _above_the_rest(signal: Array, segments: Sequence[Segment], length: int, inside: Bools) -> Array:
    """Sum of squares of every segment in bands, minus that of equally many frequencies at the mean power of the rest of
    the spectrum, (nsegments, nbands).

    Args:
        signal: (ntrials, T).
        segments: to be looked at.
        length: rows of the longest; shorter ones are filled with 0.
        inside: frequencies of each band, (nbands, length // 2 + 1).
    """
    spectra = _spectra(signal, segments, length)
    within = spectra @ inside.T
    count = inside.sum(axis=1)
    rest = spectra.sum(axis=1)[:, None] - within
    above: Array = within - rest * count / np.maximum(inside.shape[1] - count, 1)
    return above


def _spectra(signal: Array, segments: Sequence[Segment], length: int) -> Array:
    """Sum of squares of a signal, (ntrials, T), by frequency, (nsegments, length // 2 + 1), each segment padded with 0
    to a length."""
    spectra = np.stack([np.abs(np.fft.rfft(signal[s.trial, s.rows], length)) ** 2 for s in segments]) / length
    spectra[:, 1 : (length + 1) // 2] *= 2
    return spectra
