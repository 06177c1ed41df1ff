"""Clocks: gaps, jitter, and whether the rate is the one that the sidecar states. Judged stream by stream."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from tiago_mj.recordings.read.clock import RATE_FACTOR
from tiago_mj.recordings.recording import KINDS, Array, Finding, Trial, channel, channels

#: A step so many times the median is a gap.
GAP: Final = 5.0
#: Spread of 90 % of the steps over their median that counts as jitter.
JITTER: Final = 0.1
#: Difference of the stated and the real rate that is said.
RATE_SLACK: Final = 0.1


def check(trial: Trial) -> Iterator[Finding]:
    """Findings on the clocks of a trial."""
    file = trial.source
    for label, time in streams(trial).items():
        steps = np.diff(time)
        if len(steps) < 5:
            continue
        middle = float(np.median(steps))
        low, high = np.percentile(steps, [5, 95])
        gaps = np.flatnonzero(steps > GAP * middle)
        if len(gaps):
            at = int(gaps[np.argmax(steps[gaps])])
            yield Finding(
                "time_gap",
                file,
                label,
                f"{len(gaps)} gap{'s' if len(gaps) > 1 else ''}, the longest {steps[at]:.3g} s at {time[at]:.4g} s, "
                f"where steps are {middle:.4g} s: the command before it is held through it",
            )
        if high - low > JITTER * middle:
            yield Finding(
                "clock_jitter",
                file,
                label,
                f"steps vary from {1e3 * low:.4g} to {1e3 * high:.4g} ms (5 to 95 %): recorded times are used as they "
                "are, and delays shorter than that cannot be told",
            )
    yield from _rate(trial)


def streams(trial: Trial) -> dict[str, Array]:
    """Sample times of every group of channels with common samples, by the name of its first channel ("" for all)."""
    found: dict[bytes, tuple[str, Array]] = {}
    for name in channels(trial, kinds=tuple(KINDS)):
        there = ~np.isnan(channel(trial, name))
        if name.startswith("command.") and there[:-1].all():
            there[-1] = True  # nothing is sent in the last row
        found.setdefault(there.tobytes(), (name, trial.time[there]))
    whole = len(found) == 1
    return {"time" if whole else name: time for name, time in found.values()}


def _rate(trial: Trial) -> Iterator[Finding]:
    stated = trial.sidecar.rate_hz
    there = list(streams(trial).values())
    if stated <= 0 or not there:
        return
    real = [1 / float(np.median(np.diff(time))) for time in there if len(time) > 5]
    if not real:
        return
    nearest = min(real, key=lambda rate: abs(np.log(rate / stated)))
    if abs(nearest / stated - 1) > RATE_SLACK:
        far = max(nearest / stated, stated / nearest) > RATE_FACTOR
        yield Finding(
            "contradiction",
            trial.source,
            "time",
            f"the sidecar states rate_hz {stated:.6g}, the rows come at {nearest:.4g} Hz: "
            + ("mend rate_hz, or state the unit of time" if far else "the rows' own times are used"),
            refuses=far,
        )
