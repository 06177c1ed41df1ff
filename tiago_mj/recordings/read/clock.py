"""Time column: unit and origin are corrected where they are certain; an unusable clock is refused.

Certain are: steps of 300 and more are not seconds (a log at three rows per 1000 s), and a rate in the sidecar that the
steps match exactly in another unit.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tiago_mj.recordings.recording import Array, Finding, RecordingError
from tiago_mj.recordings.usable import check_span

#: Fewer rows tell neither noise nor motion.
MIN_ROWS: Final = 20
#: Units by the median step that a log at 3 Hz to 3 kHz has in them.
_PLAIN: Final = (("us", 1e-6, 3e2, 3e5), ("ns", 1e-9, 3e5, 3e8))
_UNITS: Final = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
#: A stated rate is met if the rows' rate lies within this factor of it. Dropped rows and jitter do not reach it.
RATE_FACTOR: Final = 1.5


def check_clock(time: Array, file: str) -> None:
    """Refuse a clock that cannot be used.

    Raises:
        RecordingError: too few rows, empty or infinite cells, or time that does not increase.
    """
    if len(time) == 0:
        raise RecordingError(
            f"{file}: the recording is empty, it has a header but no row: record again or leave it out"
        )
    if len(time) < MIN_ROWS:
        rows = f"{len(time)} rows are" if len(time) > 1 else "1 row is"
        raise RecordingError(f"{file}: {rows} too short a recording, at least {MIN_ROWS} are needed: leave it out")
    bad = ~np.isfinite(time)
    if bad.any():
        raise RecordingError(
            f"{file}: column time: row {int(np.argmax(bad)) + 1} is empty or not finite: delete the row"
        )
    step = np.diff(time)
    if (step <= 0).any():
        row = int(np.argmax(step <= 0)) + 2
        same = step[row - 2] == 0
        raise RecordingError(
            f"{file}: column time: {'repeats' if same else 'goes back'} at row {row} "
            f"({int((step <= 0).sum())} such rows; time_not_monotonic): "
            + ("delete the duplicated rows" if same else "sort the rows by time, or cut the recording there")
        )


def repair_clock(time: Array, rate_hz: float, file: str, *, declared: bool) -> tuple[Array, list[Finding]]:
    """Time in seconds from 0, and findings on the corrections.

    Args:
        time: (T,), as it stands in the file, strictly increasing; in seconds where ``declared``.
        rate_hz: that the sidecar states; 0 where it states none.
        file: for messages.
        declared: whether its unit was stated and has been applied.

    Raises:
        RecordingError: no unit fits, or the steps contradict the stated rate.
    """
    findings = []
    step = float(np.median(np.diff(time)))
    unit = 1.0
    if not declared:
        name, unit = _unit(step, rate_hz, file)
        if unit != 1.0:
            findings.append(
                Finding("time_unit", file, "time", f"its steps of {step:.4g} are {name}; read as such", repaired=True)
            )
    seconds = time * unit
    if seconds[0] != 0.0:
        findings.append(
            Finding("time_origin", file, "time", f"it starts at {seconds[0]:.9g} s; shifted to 0", repaired=True)
        )
        seconds = (time - time[0]) * unit
    check_span(float(seconds[-1]), file)
    return seconds, findings


def _unit(step: float, rate_hz: float, file: str) -> tuple[str, float]:
    if rate_hz > 0:
        for name, factor in _UNITS:
            if 1 / RATE_FACTOR < step * factor * rate_hz < RATE_FACTOR:
                return name, factor
        return "s", 1.0  # streams of several rates share the rows: judged by stream, in the lint
    for name, factor, low, high in _PLAIN:
        if low <= step < high:
            return name, factor
    if step >= 1.0:
        raise RecordingError(
            f"{file}: column time: its steps of {step:.4g} are no seconds of a robot's log (time_unit): state the "
            'unit, "units": {"time": "ms"} in the sidecar, or rate_hz'
        )
    return "s", 1.0
