"""Frequencies at which joints swing after a push, from a periodogram of the position error.

The likelihood has no useful gradient in a frequency: what is in step with a swing at first is out of step after some
periods. But what a mount that rocks does to the joints, the nominal simulator lacks at that frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data

Array = NDArray[np.float64]

#: How far joints that give way move the peaks of a swing, as a share of its frequency: the peaks within it are one. Of
#: two arms on hinges (4.4 and 7.8 Hz) the first is 0 and 1 % off, and 3 to 5 % where this is halved or doubled.
WIDTH: Final = 0.1
#: Frequencies that are looked at in each such share, and those that are simulated.
PER_WIDTH: Final = 4
MAX_FREQUENCIES: Final = 2
#: Highest frequency that is looked for, of what the rows can show (Nyquist's).
SHOWN: Final = 0.8


def with_frequencies(data: Data, base: Array, period: float, pool: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The pool, its swings at the frequencies that the position errors of all joints show.

    Args:
        data: measured.
        base: nominal predictions, (ntrials, T, C).
        period: between rows [s].
        pool: candidates.
    """
    found = {c.label: c for c in pool if EFFECTS[c.effect].swing_frequency}
    out = [c for c in pool if c.label not in found]
    for candidate in found.values():
        declared = EFFECTS[candidate.effect]
        name = declared.swing_frequency
        settings = peaks(data, base, period, *declared.parameters[name].bounds[0])
        out += [replace(candidate, fixed=((name, one),)) for one in settings or [dict(candidate.fixed)[name]]]
    return tuple(out)


def peaks(data: Data, base: Array, period: float, low: float, high: float) -> list[float]:
    """Frequencies with the most power of the errors' rate of change, strongest first, within bounds [Hz].

    Positions swing less the faster a base rocks that is pushed as hard, and errors of the model's own numbers are slow.
    """
    joints = [c for c, kind in enumerate(data.kinds) if kind == "position"]
    error = ((data.value - base) / data.reading_noise)[:, :, joints]
    high = min(high, SHOWN * 0.5 / period)
    power: Array | None = None
    for one in error.transpose(0, 2, 1).reshape(-1, error.shape[1]):
        known = np.flatnonzero(np.isfinite(one))
        if len(known) < 2 or (known[-1] - known[0]) * period * low < 1:
            continue
        rows = np.interp(np.arange(known[0], known[-1] + 1), known, one[known])
        of, there = signal.periodogram(rows, 1 / period, "hann", nfft=2 * error.shape[1], detrend="linear")
        power = there if power is None else power + there
    if power is None or high <= low:
        return []
    places = np.exp(np.arange(np.log(low), np.log(high), WIDTH / PER_WIDTH))
    near = np.exp(-0.5 * np.square(np.log(np.maximum(of, of[1]) / places[:, None]) / WIDTH))
    strength = (near @ (power * of**2)) / near.sum(axis=1)
    tops = [k for k in range(len(places)) if strength[k] == strength[max(k - PER_WIDTH, 0) : k + PER_WIDTH + 1].max()]
    return [float(places[k]) for k in sorted(tops, key=lambda k: -strength[k])[:MAX_FREQUENCIES]]
