"""How far servos are behind their set points, beside how far joints move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]


def share_of_range(plant: Plant, trials: Sequence[Trial], joint: int, values: Array) -> Array:
    """Range of a joint's distance from its commanded position over the range of its motion, (ntrials,), at most 1; 1
    where no position is commanded.

    A servo takes a joint to its set point in any simulator: how two of them differ is a share of how far it is behind.
    Asked for only where readings show less than is assumed of an encoder: what was calibrated is left as it is.
    """
    found = np.ones(len(trials))
    targets = plant.wiring.targets
    sent = [name for name, j in zip(targets.command, targets.actuated, strict=True) if j == joint]
    if plant.wiring.interface != "position" or plant.relative or len(sent) != 1:
        return found
    for k, trial in enumerate(trials):
        behind = trial.commands.get(sent[0], np.empty(0))[: len(trial.time)] - values[k, : len(trial.time)]
        known = np.isfinite(behind)
        moved = float(np.ptp(values[k, : len(trial.time)][known])) if known.any() else 0.0
        if moved > 0:
            found[k] = min(float(np.ptp(behind[known])) / moved, 1.0)
    return found
