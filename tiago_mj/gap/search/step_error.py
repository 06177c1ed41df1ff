"""Whether predictions are corrected for the integration error of the physics step, decided beside an explanation.

A recording made in the very simulator that replays it has the same integration error, a real robot has not. Beside the
nominal model this cannot be decided: the change by a missing effect is larger than the integration error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.inference.whitening import Whitening
from tiago_mj.gap.search import starts

#: The other way has to meet the recordings better by this much, or the first guess stays [nats]: a Bayes factor of 3.
MIN_COST_DROP_NATS: Final = 1.1


def better_step_correction(fitter: Fitter, fits: Sequence[Fitted]) -> Predictor | None:
    """The predictor with the correction for integration error switched; None where the present choice is the more
    likely one.

    Args:
        fitter: of the trials.
        fits: explanations of them, the likeliest first.
    """
    other = fitter.predict.with_other_step_correction()
    if other is None or not fits:
        return None
    # By the noise alone: what the step gets wrong is part of the tolerance, which would hide it.
    noise = np.broadcast_to(fitter.data.noise, fitter.data.value.shape)
    on = Whitening(replace(fitter.data, sigma=noise, common=np.zeros_like(noise)), fitter.weight)

    def cost(by: Fitter, fit: Fitted) -> float:
        point = Point.of(fit)
        return on.cost(by.predictions([point])[0], point.nuisance)

    there = replace(fitter, predict=other)
    # Each way has its own best magnitudes: a late command and a late step look alike.
    (refitted,) = there.fit_all([starts.restart(fits[0])])
    return other if cost(fitter, fits[0]) - cost(there, refitted) > MIN_COST_DROP_NATS else None
