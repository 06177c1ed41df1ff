"""What the robot was doing in every row: from the command and the nominal prediction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.result import PHASES
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Signals

Array = NDArray[np.float64]

REST, FREE, REVERSAL, ONSET, LOADING, HOLD, RELEASE = range(len(PHASES))

#: A joint moves that is faster than this share of its limit, or of the fastest it was.
MOVING_SHARE: Final = 0.02
#: A pad is in contact above this [N]; its force changes above this share of the largest, per second.
CONTACT_NEWTONS: Final = 0.05
CHANGING_SHARE: Final = 0.3
#: What counts as around an onset or a reversal [s].
AROUND_SECONDS: Final = 0.06


def phases(plant: Plant, nominal: Signals) -> NDArray[np.int_]:
    """Phase of every row, (ntrials, T), as indices into :data:`PHASES`.

    Args:
        plant: that was replayed.
        nominal: one row a trial.
    """
    speed = np.abs(nominal.velocity)
    fastest = np.maximum(speed.max(axis=(0, 1)), 1e-9)
    moving = (speed > MOVING_SHARE * fastest).any(axis=2)
    out = np.where(moving, FREE, REST)
    near = max(round(AROUND_SECONDS / plant.period), 1)
    direction = np.sign(np.where(speed > MOVING_SHARE * fastest, nominal.velocity, 0.0))
    for k in range(out.shape[0]):
        for joint in range(direction.shape[2]):
            last = 0.0
            for row in np.nonzero(direction[k, :, joint])[0]:
                if last and direction[k, row, joint] != last:
                    out[k, max(row - near // 2, 0) : row + near] = REVERSAL
                last = direction[k, row, joint]
    if nominal.newtons.shape[2] == 0:
        return out
    force = nominal.newtons
    contact = force > CONTACT_NEWTONS
    strongest = max(float(force.max()), 1.0)
    rate = np.gradient(force, axis=1) / plant.period
    loading = (contact & (rate > CHANGING_SHARE * strongest)).any(axis=2)
    falling = (rate < -CHANGING_SHARE * strongest).any(axis=2)
    out[contact.any(axis=2)] = HOLD
    out[loading] = LOADING
    out[falling] = RELEASE
    for k in range(out.shape[0]):
        for pad in range(contact.shape[2]):
            begins = np.nonzero(np.diff(contact[k, :, pad].astype(int)) == 1)[0] + 1
            for row in begins:
                out[k, row : row + near] = ONSET
    return out


def still(nominal: Sequence[Array] | Array) -> NDArray[np.bool_]:
    """Rows in which a predicted channel stands still, same shape (ntrials, T)."""
    values = np.asarray(nominal)
    span = float(np.ptp(values))
    change: NDArray[np.bool_] = np.abs(np.gradient(values, axis=1)) <= 2e-4 * span
    return change
