"""Mean difference of two controllers that play the same episodes, with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy import stats

#: Of the intervals.
LEVEL: Final = 0.95


def difference(ours: Sequence[float], theirs: Sequence[float]) -> dict[str, float]:
    """Mean of the paired differences, ours minus theirs, and its 95 % interval by Student's t.

    Args:
        ours, theirs: a number an episode, in the same order of seeds; at least two.

    Raises:
        ValueError: they are not as many, or fewer than two.
    """
    if len(ours) != len(theirs) or len(ours) < 2:
        raise ValueError(f"{len(ours)} and {len(theirs)} episodes: give the same ones of both, two or more")
    found = np.asarray(ours, dtype=float) - np.asarray(theirs, dtype=float)
    mean, error = float(found.mean()), float(found.std(ddof=1) / np.sqrt(len(found)))
    half = float(stats.t.ppf(0.5 + LEVEL / 2, len(found) - 1)) * error
    return {"mean": mean, "low": mean - half, "high": mean + half}
