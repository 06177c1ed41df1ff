"""In how many of the trials that tell of an effect an explanation gains by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.search import ranking, starts

Array = NDArray[np.float64]

#: A trial tells of an effect where its log-likelihood with and without differs by at least this [nats]: a factor of e.
TELLS_NATS: Final = 1.0


def with_agreement(everywhere: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations with the share of trials in which they meet what was measured better than without one of their
    effects, of those trials that tell; the least of all their effects."""
    if not fits:
        return []
    costs = _costs(everywhere, everywhere.predictions([starts.point_of(f) for f in fits]))
    out = []
    for k, fit in enumerate(fits):
        fewer = [j for j, other in enumerate(fits) if ranking.labels_of(other) < ranking.labels_of(fit)]
        nearest = [j for j in fewer if len(fits[j].parts) == len(fit.parts) - 1] or fewer[:1]
        shares = [_share(costs[j] - costs[k]) for j in nearest]
        out.append(replace(fit, agreement=min(shares, default=1.0)))
    return out


def _share(gained: Array) -> float:
    """Of the trials that tell, those that gain; all, where none tells."""
    tells = np.abs(gained) >= TELLS_NATS
    return float((gained[tells] > 0).mean()) if tells.any() else 1.0


def _costs(everywhere: Fitter, predicted: Array) -> Array:
    """Half the sum of squares of each trial's softened residual, (n, ntrials) [nats]."""
    white = likelihood.whiten(everywhere.data, likelihood.residual(everywhere.data, predicted), everywhere.weight)
    out: Array = 0.5 * (likelihood.soften(white) ** 2).sum(axis=(2, 3))
    return out
