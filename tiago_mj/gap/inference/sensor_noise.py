"""Noise of a sensor from its readings alone.

One standard deviation of what it adds: from where it is quietest, by the median absolute deviation of differences, with
the quantum over √12, at least what no sensor is better than. Differences of order k cancel a motion that is a
polynomial of degree k - 1 over their samples, and make √(2k choose k) of noise: the first will do for a joint that
hardly moves, only the fourth for one that swings at four samples a radian.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import between
from tiago_mj.recordings import robust
from tiago_mj.recordings.grid import grid_step
from tiago_mj.recordings.recording import RecordingError, Trial

Array = NDArray[np.float64]

#: Smallest noise that is believed where neither a sidecar nor the readings tell less, (slide, hinge): 27 µm is what the
#: 2023 project took for the fingers' encoders (llach/learning_fc), 0.1 mrad a 14-bit encoder's step over √12;
#: velocities by the same over 50 ms.
MIN_NOISE: Final = {"position": (2.7e-5, 1e-4), "velocity": (5e-4, 2e-3), "force": (2e-3, 2e-3)}
#: No encoder is better: steps of 1 nm of linear and of 29 bits a turn of angle encoders (Heidenhain LIC 4100, RCN 8000)
#: over √12, (slide, hinge). Less is what a simulator or a file rounds by.
FINEST: Final = (1e-9 / math.sqrt(12), 2 * math.pi / 2**29 / math.sqrt(12))
#: Of two deviations one is clearly less below this share of the other: half of its mean square.
CLEARLY_LESS: Final = math.sqrt(0.5)
#: Noise is estimated from differences of orders 1 to this, over blocks of so many rows: white noise then shows
#: QUIETEST_SHARE of itself in the quietest third of the blocks of the best order (10 trials of 150 to 600 rows, drawn
#: 200 times).
MAX_DIFFERENCE_ORDER: Final = 4
NOISE_BLOCK_ROWS: Final = 16
QUIETEST_SHARE: Final = 0.81
#: A converter's lines, and what is predicted of so coarse a sensor, are off by this share of a step at least. Chosen:
#: on the SO-101's wrist (steps of 1.5 mrad) dry friction closes -6 % of the gap at 0, 63 % at 1/8 and 84 % at
#: 1/√12, where a force that is held 0.4 steps off its line would look like an error that lasts.
MIN_GRID_NOISE: Final = 1 / 8


def stated(trial: Trial, kind: str, channel: str) -> float:
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


def least(kind: str, values: Array, *, slide: bool) -> float:
    """Smallest noise of a channel that is believed where nothing is stated.

    Args:
        kind: ``position``, ``velocity`` or ``force``.
        values: (ntrials, T).
        slide: whether the joint slides, or it is a force.

    Returns:
        Of positions what their readings show by themselves, where that is clearly less than :data:`MIN_NOISE`; else
        that.
    """
    side = 0 if slide else 1
    fallback = MIN_NOISE[kind][side]
    told = white(values) if kind == "position" else None
    return fallback if told is None or not FINEST[side] <= told < CLEARLY_LESS * fallback else told


def white(values: Array) -> float | None:
    """One standard deviation of a channel's white noise by the differences of its readings; None where that cannot be
    told from the motion or from a grid.

    Differences of one order more leave white noise as it is, and of a motion of six rows a period or more a quarter of
    the mean square at most (|2 sin(ωT/2)|² · 20/70 from the third to the fourth). Where they leave more than half, two
    thirds of what is left are noise.

    Args:
        values: (ntrials, T), NaN where nothing was read: readings are compared with the next one that was made.
    """
    if step := grid_of(values):  # readings at rest that go to and fro between two lines
        return between.noise(without_extremes(values), step) or None
    read = np.full_like(values, np.nan)
    for k, row in enumerate(without_extremes(values)):
        known = row[np.isfinite(row)]
        read[k, : len(known)] = known
    third, fourth = (
        _quietest_deviation(np.diff(read, n=order, axis=1)) / math.sqrt(math.comb(2 * order, order))
        for order in (MAX_DIFFERENCE_ORDER - 1, MAX_DIFFERENCE_ORDER)
    )
    told = np.isfinite(third) and 0 < CLEARLY_LESS * third < fourth
    return fourth / QUIETEST_SHARE if told else None


def grid_of(values: Array) -> float:
    """Step of the grid that the readings of a channel lie on, (ntrials, T), NaN where nothing was measured; 0 if they
    lie on none. Two values that alternate are a grid, too."""
    return grid_step(values[np.isfinite(values)], least=2)


def beside_grid(values: Array, least: float, stated: float = 0.0, nominal: float = 0.0) -> float:
    """One standard deviation of a channel's noise, apart from its grid.

    Args:
        values: (ntrials, T).
        least: what is believed at least.
        stated: step of a grid that the sensor is said to have; noise may come after it.
        nominal: noise that the sensor is said to have: what a coarser grid hides is believed.
    """
    step = grid_of(values)
    if not step:  # what is rounded before noise comes in stands still under it
        return max(floor(values, least), MIN_GRID_NOISE * stated)
    seen = between.noise(without_extremes(values), step)
    if seen is None or seen > step / 2:  # it never rests, or spans many lines: rounding adds white noise of step² / 12
        seen = max(seen or 0.0, math.sqrt(max(by_differences(values) ** 2 - step**2 / 12, 0.0)))
    return max(seen, nominal if step > nominal else 0.0, MIN_GRID_NOISE * step, least)


def floor(values: Array, least: float) -> float:
    """One standard deviation of a channel's noise, from the quietest third of its differences, of the order that leaves
    least of the motion.

    Args:
        values: (ntrials, T).
        least: what is believed at least.
    """
    steps = np.diff(without_extremes(values), axis=1).ravel()
    steps = steps[np.isfinite(steps)]
    if len(steps) < 8:
        return least
    moving = np.nonzero(steps)[0]
    quantum = np.min(np.abs(steps[moving])) if len(moving) else 0.0
    repeated = quantum if len(np.unique(values[np.isfinite(values)])) < 0.2 * len(steps) else 0.0
    return float(max(by_differences(values), repeated / np.sqrt(12), least))


def without_extremes(values: Array) -> Array:
    """Set to NaN the readings at the extremes of all: below its threshold or at its limit a sensor shows no noise."""
    ends = (np.nanmin(values), np.nanmax(values)) if np.isfinite(values).any() else (np.nan, np.nan)
    at_an_end = np.isclose(values, ends[0], rtol=1e-9, atol=0) | np.isclose(values, ends[1], rtol=1e-9, atol=0)
    return np.where(at_an_end, np.nan, values)


def by_differences(values: Array) -> float:
    """One standard deviation of what is left of the quietest third of the differences, of the order that leaves
    least."""
    free = without_extremes(values)
    least = min(
        _quietest_deviation(np.diff(free, n=k, axis=1)) / np.sqrt(math.comb(2 * k, k))
        for k in range(1, MAX_DIFFERENCE_ORDER + 1)
    )
    return least / QUIETEST_SHARE if np.isfinite(least) else 0.0


def _quietest_deviation(differences: Array) -> float:
    """One standard deviation where they scatter least, (ntrials, T); infinite of too few."""
    known = differences[np.isfinite(differences)]
    count = len(known) // NOISE_BLOCK_ROWS
    if len(known) < NOISE_BLOCK_ROWS / 2:
        return np.inf
    if count < 3:
        return robust.deviation(known)
    blocks = known[: count * NOISE_BLOCK_ROWS].reshape(count, NOISE_BLOCK_ROWS)
    return float(np.quantile(robust.deviations(blocks, axis=1), 1 / 3))
