"""The trials with the most motion: what is looked at on a grid is looked at in them first."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

#: Rows that are looked at, and a trial in any case. Twelve trials of five seconds, at 50 Hz, have half as many. At
#: 500 Hz the twelve of an arm of six joints took 27 minutes of a processor, 5 % of that for simulations; now 4.
MAX_ROWS: Final = 6000


def liveliest(moved: ArrayLike, rows: ArrayLike, most: int = MAX_ROWS) -> list[int]:
    """Indices, ascending, of the trials that moved most: as many as have no more than so many rows, and one at least.

    Args:
        moved: by each trial, (ntrials,).
        rows: of each trial, (ntrials,).
        most: rows.
    """
    order = np.argsort(-np.asarray(moved, dtype=float), kind="stable")
    count = int((np.cumsum(np.asarray(rows)[order]) <= most).sum())
    return sorted(order[: max(count, 1)].tolist())
