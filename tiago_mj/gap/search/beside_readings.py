"""Explanations beside the effects that are measured on the readings alone, which every explanation has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.detectors.readings import Known
from tiago_mj.gap.inference.fit import Fitted

Array = NDArray[np.float64]


def with_readings(fit: Fitted, known: Sequence[Known], sensitive: NDArray[np.bool_]) -> Fitted:
    """The fit with the effects measured on the readings appended, and the nuisances that were not fitted set to 0."""
    shared, wide, count = np.zeros(len(sensitive)), np.ones(len(sensitive)), int(sensitive.sum())
    shared[sensitive] = fit.nuisance[:count]
    deviations, correlation = fit.nuisance_deviations, fit.correlation
    if deviations is not None:  # of those that were not fitted nothing is known beyond their priors
        wide[sensitive] = deviations[:count]
        deviations = np.concatenate([wide, deviations[count:]])
    if correlation is not None:
        order = [*np.flatnonzero(sensitive), *range(len(sensitive), len(sensitive) + len(fit.nuisance) - count)]
        correlation = (
            _apart(correlation[0], range(len(fit.values)), len(fit.values) + len(known)),
            _apart(correlation[1], order, len(sensitive) + len(fit.nuisance) - count),
        )
    return replace(
        fit,
        nuisance=np.concatenate([shared, fit.nuisance[count:]]),
        parts=(*fit.parts, *(k.candidate for k in known)),
        values=np.concatenate([fit.values, [k.value for k in known]]),
        deviations=np.concatenate([fit.deviations, [k.deviation for k in known]]),
        nuisance_deviations=deviations,
        correlation=correlation,
    )


def _apart(correlation: Array, places: Sequence[int], size: int) -> Array:
    """A correlation among more numbers, (size, size), which have none with those that stand at ``places``."""
    out = np.eye(size)
    out[np.ix_(places, places)] = correlation
    return out
