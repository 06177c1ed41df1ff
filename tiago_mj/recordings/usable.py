"""Conditions on every recording, whoever made it: an increasing clock, and values within physical bounds."""

from __future__ import annotations

from typing import Any, Final, TypeGuard

import numpy as np

from tiago_mj.io.quoting import is_number
from tiago_mj.recordings.recording import KINDS, Array, RecordingError, Trial, channel, channels

#: Stamps in nanoseconds since 1970 are 2e18; what is larger is no number that was measured.
LARGEST: Final = 1e20
#: Of a recording [s]: eleven days. What is longer has a gap in it, or another unit.
LONGEST: Final = 1e6
#: Rates of robots [Hz].
SLOWEST, FASTEST = 1e-3, 1e6
RATE: Final = f"write a number from {SLOWEST:g} to {FASTEST:g} [Hz]"


def is_rate(value: Any) -> TypeGuard[float]:
    """Whether a number is a plausible sampling rate [Hz]."""
    return is_number(value) and SLOWEST <= value <= FASTEST


def check_span(seconds: float, file: str) -> None:
    """Refuse a recording that spans weeks.

    Raises:
        RecordingError: says how long it is.
    """
    if not seconds <= LONGEST:
        raise RecordingError(
            f"{file}: column time spans {seconds:.3g} s, more than {LONGEST:g}: cut the recording at its gap, or state "
            "the unit"
        )


def check_values(values: Array, column: str, file: str) -> None:
    """Refuse values beyond those of any sensor; NaN is an empty cell.

    Raises:
        RecordingError: says the column and its row.
    """
    absurd = np.abs(values) > LARGEST
    if absurd.any():
        row = int(np.argmax(absurd))
        said = "is infinite" if np.isinf(values[row]) else f"reads {values[row]:.4g}, which no sensor measures"
        raise RecordingError(f"{file}: column {column}: row {row + 1} {said}: empty the cell or delete the row")


def check_trial(trial: Trial) -> None:
    """Refuse a trial with an unusable clock or unusable values.

    Raises:
        RecordingError: its time does not increase, or a number is beyond what is measured; one line.
    """
    check_values(trial.time, "time", trial.source)
    for name in channels(trial, kinds=tuple(KINDS)):
        check_values(channel(trial, name), name, trial.source)
    if not (np.diff(trial.time) > 0).all():  # of NaN neither
        row = int(np.argmin(np.diff(trial.time) > 0)) + 2
        raise RecordingError(f"{trial.source}: column time does not increase at row {row}: delete the row")
    check_span(float(trial.time[-1] - trial.time[0]) if len(trial.time) else 0.0, trial.source)
    if len(trial.time) < 2:
        raise RecordingError(f"{trial.source}: it has {len(trial.time)} rows: leave it out")
