"""What a load cell reads without contact: its noise, its bias, and the threshold that follows.

Rest is found in the recordings themselves: rows in which no command changes, before the reading first leaves where it
began. The noise is the median absolute deviation from the medians of the windows, so that a few glitches or a missed
onset do not count; its interval follows from that deviation's efficiency (37 % of a standard deviation's) and the
number of independent readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tiago_mj.io.quantities import NINETY
from tiago_mj.recordings import robust
from tiago_mj.recordings.autocorrelation import integrated_time
from tiago_mj.recordings.recording import Array, RecordingError, Trial

#: Share of readings without contact that may exceed the threshold: 5 standard deviations of a normal distribution, the
#: simulated sensor's default. The paper's code had 3 (one reading in 740), which is several false contacts an episode.
FALSE_CONTACTS: Final = float(stats.norm.sf(5))
#: Relative standard error of a standard deviation that is estimated by the median absolute deviation, times √n.
MAD_ERROR: Final = 1.166
#: Shortest stretch that counts as rest [rows], and readings that a noise needs in all.
MIN_REST_ROWS, MIN_READINGS = 10, 30
#: An onset of contact: the median of so many rows this many deviations from where the reading began.
ONSET_ROWS, ONSET = 5, 6.0
#: Rest ends so long before an onset [s]: the pad touches before it is seen to.
MARGIN: Final = 0.05
#: A window that lies farther from the others' median than this many deviations was not rest.
STRAY: Final = 10.0


@dataclass(frozen=True)
class Rest:
    """Statistics of one load cell without contact.

    Attributes:
        sensor: name.
        noise: standard deviation of a reading [sensor units].
        noise_interval, bias_interval: 90 %.
        bias: median reading [sensor units].
        readings: how many.
        independent: how many independent ones they are worth.
        windows: stretches of rest, in how many recordings they may be.
        above: how many rest readings lie more than 3 deviations above the bias; a normal distribution has 1 in 740.
        stray: stretches left out as their level is not the others'.
    """

    sensor: str
    noise: float
    noise_interval: tuple[float, float]
    bias: float
    bias_interval: tuple[float, float]
    readings: int
    independent: float
    windows: int
    above: int
    stray: int

    def threshold(self, false_contacts: float = FALSE_CONTACTS) -> tuple[float, tuple[float, float]]:
        """Reading that is exceeded without contact with a given probability, and its 90 % interval."""
        z = float(stats.norm.isf(false_contacts))
        value = self.bias + z * self.noise
        spread = np.hypot(
            (self.bias_interval[1] - self.bias_interval[0]) / 2,
            z * (self.noise_interval[1] - self.noise_interval[0]) / 2,
        )
        return value, (value - float(spread), value + float(spread))

    @property
    def heavy_tailed(self) -> bool:
        """Whether more readings lie above 3 deviations than a normal distribution explains (1 in 1000)."""
        return bool(stats.binom.sf(self.above - 1, self.readings, stats.norm.sf(3)) < 1e-3)


def at_rest(trials: Sequence[Trial], touched: Sequence[NDArray[np.bool_]] | None = None) -> tuple[Rest, ...]:
    """Statistics of every load cell without contact, from the stretches of rest in the recordings.

    Args:
        trials: recordings.
        touched: rows in which a pad is known to be pressed, (T,) a trial, from a simulation; None if nothing is known.

    Raises:
        RecordingError: there are no force readings, no rest, or a cell that reads one value; one line.
    """
    sensors = tuple(dict.fromkeys(name for trial in trials for name in trial.forces))
    if not sensors:
        raise RecordingError(
            f"{trials[0].source}: there is no load cell: name its readings force.right, force.left, or map them with "
            "--map"
        )
    return tuple(_sensor(name, trials, touched) for name in sensors)


def windows(trial: Trial, sensor: str, touched: NDArray[np.bool_] | None = None) -> list[Array]:
    """Readings in the stretches of rest of one recording.

    Args:
        trial: the recording.
        sensor: load cell.
        touched: rows in which the pad is known to be pressed, (T,).
    """
    values = trial.forces[sensor]
    rest = _still(trial) & np.isfinite(values)
    rest &= trial.time < _onset(trial.time, values) - MARGIN
    if touched is not None:
        rest &= ~touched
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rest.astype(int), [0]])))
    return [values[a:b] for a, b in edges.reshape(-1, 2) if b - a >= MIN_REST_ROWS]


def _still(trial: Trial) -> NDArray[np.bool_]:
    """Mask of the rows whose command equals that before; all rows without commands."""
    still = np.ones(len(trial.time), dtype=bool)
    for sent in trial.commands.values():
        known = np.isfinite(sent)
        if not known.any():
            continue
        last = np.maximum.accumulate(np.where(known, np.arange(len(sent)), -1))
        held = np.where(last >= 0, sent[np.maximum(last, 0)], sent[known][0])
        slack = 1e-6 * float(np.ptp(sent[known])) + 1e-12
        still[1:] &= np.abs(np.diff(held)) <= slack
    return still


def _onset(time: Array, values: Array) -> float:
    """Time of the first onset of contact [s]; infinity without one."""
    known = np.isfinite(values)
    y, t = values[known], time[known]
    if len(y) < MIN_REST_ROWS + ONSET_ROWS:
        return float("inf")
    level = float(np.median(y[:MIN_REST_ROWS]))
    steps = np.diff(y)
    spread = max(robust.deviation(steps) / np.sqrt(2), robust.deviation(y[:MIN_REST_ROWS]))
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(y, ONSET_ROWS), axis=1)
    away = np.flatnonzero(np.abs(smooth - level) > ONSET * spread)
    return float(t[away[0]]) if len(away) else float("inf")


def _sensor(name: str, trials: Sequence[Trial], touched: Sequence[NDArray[np.bool_]] | None) -> Rest:
    found = [
        window
        for k, trial in enumerate(trials)
        if name in trial.forces
        for window in windows(trial, name, None if touched is None else touched[k])
    ]
    count = sum(len(window) for window in found)
    if count < MIN_READINGS:
        raise RecordingError(
            f"{trials[0].source}{' and the others' if len(trials) > 1 else ''}: force.{name}: no rest: {count} "
            f"readings while no command changes and before contact, {MIN_READINGS} are needed; record some seconds "
            "with the fingers open before the grasp"
        )
    kept, stray = _alike(found)
    parts = [(w - np.median(w)) * np.sqrt(len(w) / (len(w) - 1)) for w in kept]
    left, values = np.concatenate(parts), np.concatenate(kept)
    levels = np.unique(values)
    if len(levels) == 1:
        raise RecordingError(
            f"{trials[0].source}: force.{name} reads {levels[0]:.4g} throughout rest, without any noise: check the "
            "sensor and its cable"
        )
    quantum = float(np.diff(levels).min()) if len(levels) < 0.2 * len(values) else 0.0
    noise = max(robust.deviation(left, about_zero=True), quantum / float(np.sqrt(12)))
    independent = len(left) / integrated_time(parts)
    error = MAD_ERROR / np.sqrt(independent)
    bias = float(np.median(values))
    medians = np.array([np.median(w) for w in kept])
    spread = float(np.sqrt(np.pi / 2) * noise / np.sqrt(independent))
    if len(medians) > 1:
        spread = max(spread, float(medians.std(ddof=1) / np.sqrt(len(medians))))
    return Rest(
        sensor=name,
        noise=noise,
        noise_interval=(noise * float(np.exp(-NINETY * error)), noise * float(np.exp(NINETY * error))),
        bias=bias,
        bias_interval=(bias - NINETY * spread, bias + NINETY * spread),
        readings=len(values),
        independent=independent,
        windows=len(kept),
        above=int(np.sum(left > 3 * noise)),
        stray=stray,
    )


def _alike(found: Sequence[Array]) -> tuple[list[Array], int]:
    """Windows near the median level, and the number of the others: a recording may begin with a loaded pad."""
    medians = np.array([np.median(w) for w in found])
    spreads = np.array([robust.deviation(w) for w in found])
    level, spread = float(np.median(medians)), float(np.median(spreads))
    apart = robust.deviation(medians)
    kept = [
        w for w, m in zip(found, medians, strict=True) if abs(m - level) <= STRAY * max(spread, apart) or spread == 0
    ]
    return kept, len(found) - len(kept)
