"""Rows in which the motors were off: nothing drives the robot there, so that nothing can be replayed.

Loggers go on while a robot is switched off, is held by an emergency stop or is moved by hand. A column that says so
takes such rows out of a recording; what is left in between is trials of their own, each with its own start. Of a
recording with an object only the first is left: nobody knows how the object stood later.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.recordings.read.clock import MIN_ROWS
from tiago_mj.recordings.recording import Array, Finding, RecordingError, Trial
from tiago_mj.recordings.trials import part

#: Its kind in a map file.
TORQUE: Final = "torque_on"
_NAMES: Final = re.compile(r"^(torque_(on|enabled?)|motors?_(on|enabled)|enabled|power_on)([._].+)?$", re.IGNORECASE)


def says_torque(column: str) -> bool:
    """Whether a column's name says that it holds whether the motors were on, all or (``torque_on.elbow``) one."""
    return _NAMES.match(column) is not None


def without_torque_off(trial: Trial, said: Mapping[str, Array]) -> tuple[list[Trial], list[Finding]]:
    """Parts of a trial in which the torque was on, and a finding on them.

    Args:
        trial: as read.
        said: by column, (T,): 0 where the torque was off, empty where nothing is said anew.

    Raises:
        RecordingError: it was never on for long enough, or a column holds other numbers than 0 and 1.
    """
    on = np.ones(len(trial.time), dtype=bool)
    for column, values in said.items():
        known = values[~np.isnan(values)]
        if not np.isin(known, (0.0, 1.0)).all():
            odd = float(known[~np.isin(known, (0.0, 1.0))][0])
            raise RecordingError(
                f"{trial.source}: column {column}: it reads {odd:g}, and whether the torque is on is 0 or 1: mend it, "
                "or map it to null"
            )
        on &= _held(values)
    if on.all():
        return [trial], []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    runs = list(zip(edges[::2], edges[1::2], strict=True))
    long = [(int(first), int(last)) for first, last in runs if last - first >= MIN_ROWS]
    columns = " and ".join(said)
    if not long:
        raise RecordingError(
            f"{trial.source}: column {columns} says that the torque was on in {int(on.sum())} of {len(on)} rows, never "
            f"for {MIN_ROWS} together: nothing was driven; leave the file out, or map the column to null"
        )
    placed = trial.sidecar.object is not None  # nobody knows how it stood after the first part
    later, long = (len(long) - 1, long[:1]) if placed else (0, long)
    lone = len(long) == 1
    trials = [
        part(trial, first, last, trial.name if lone else f"{trial.name}-{k + 1:02d}")
        for k, (first, last) in enumerate(long)
    ]
    off = np.flatnonzero(~on)
    short = len(runs) - len(long) - later
    message = (
        f"the torque was off in {len(off)} of {len(on)} rows, first at {trial.time[off[0]]:.4g} s: they are left out"
        + (f", and what is left is {len(long)} trials" if not lone else "")
        + (f"; {short} part{'s' if short > 1 else ''} below {MIN_ROWS} rows left out, too" if short else "")
        + ("; so is what follows, where nobody knows how the object stood" if later else "")
    )
    return trials, [Finding("time_gap", trial.source, columns, message, repaired=True)]


def _held(values: Array) -> NDArray[np.bool_]:
    """On or off in every row, each value held until the next; before the first as the first."""
    rows = np.flatnonzero(~np.isnan(values))
    if not len(rows):
        return np.ones(len(values), dtype=bool)
    last = rows[np.maximum(np.searchsorted(rows, np.arange(len(values)), side="right") - 1, 0)]
    return np.asarray(values[last] != 0)
