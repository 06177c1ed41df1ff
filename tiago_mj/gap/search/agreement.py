"""Whether the trials agree on an effect: some excite it far more than others, but few should speak against it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.search import ranking, starts

Array = NDArray[np.float64]


def with_agreement(everywhere: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations with how far the trials agree on them: what those gain that gain by an effect, over what these gain
    and the others lose [nats]; the least of all their effects."""
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
    """What trials gain of what they gain and lose together; all, where nothing is."""
    together = float(np.abs(gained).sum())
    return float(np.maximum(gained, 0.0).sum()) / together if together > 0 else 1.0


def _costs(everywhere: Fitter, predicted: Array) -> Array:
    """Half the sum of squares of each trial's softened residual, (n, ntrials) [nats]."""
    white = likelihood.whiten(everywhere.data, likelihood.residual(everywhere.data, predicted), everywhere.weight)
    out: Array = 0.5 * (likelihood.soften(white) ** 2).sum(axis=(2, 3))
    return out
