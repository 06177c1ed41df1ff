"""Agreement of the trials on an effect: trials may excite it to different degrees, but few should be explained worse
with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.search import ranking, step_error

Array = NDArray[np.float64]


def with_agreement(full: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations with their agreement: the summed gain of the trials that gain by an effect, over the summed absolute
    change of all trials; of several effects the smallest.

    A change is the difference of log likelihoods with and without the effect [nats].
    """
    if not fits:
        return []
    costs = _costs(full, np.stack([step_error.own(full, f, fits).predictions([Point.of(f)])[0] for f in fits]))
    out = []
    for k, fit in enumerate(fits):
        fewer = [j for j, other in enumerate(fits) if ranking.labels_of(other) < ranking.labels_of(fit)]
        nearest = [j for j in fewer if len(fits[j].parts) == len(fit.parts) - 1] or fewer[:1]
        shares = [_share(costs[j] - costs[k]) for j in nearest]
        out.append(replace(fit, agreement=min(shares, default=1.0)))
    return out


def _share(gained: Array) -> float:
    """Sum of the positive changes over the sum of absolute changes; 1 where nothing changes."""
    together = float(np.abs(gained).sum())
    return float(np.maximum(gained, 0.0).sum()) / together if together > 0 else 1.0


def _costs(full: Fitter, predicted: Array) -> Array:
    """Negative log likelihood of each trial (half the sum of squares of its softened residual), (n, ntrials) [nats]."""
    white = likelihood.whiten(full.data, likelihood.residual(full.data, predicted), full.weight)
    out: Array = 0.5 * (likelihood.soften(white) ** 2).sum(axis=(2, 3))
    return out
