"""Evidence for an explanation: the probability of the recordings under it, by Laplace's approximation.

The evidence integrates over magnitudes, whose prior is :meth:`Candidate.log_prior
<tiago_mj.gap.inference.hypotheses.Candidate.log_prior>`, so that an effect is penalised for its free parameters (the
Occam factor; MacKay 2003, chapter 28). The nuisance parameters are not integrated over but set to their best values,
since their prior is the same for all explanations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import scatter
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.whitening import Whitening

Array = NDArray[np.float64]

#: Penalty of an effect of magnitude 0, falling linearly to none where the magnitude reaches two deviations of the
#: nominal model's own number of that kind [nats]. Halved and doubled, none of 16 answers about hinges changes
#: (varied.json).
MAX_TOLERANCE_PENALTY_NATS: Final = 6.0


@dataclass(frozen=True)
class Responses:
    """Whitened responses around a point, of n samples.

    Attributes:
        columns: to each magnitude and nuisance, (n, k + p).
        seconds: to the logarithm of each second number, (n, s); None: there is none.
        added: what scatter of the predictions adds to the curvature of each magnitude, nuisance and second number,
            (k + p + s,); None: nothing.
    """

    columns: Array
    seconds: Array | None = None
    added: Array | None = None


@dataclass(frozen=True)
class LaplaceEvidence:
    """Evidence for an explanation at its best.

    Attributes:
        log_likelihood: log-likelihood, up to what is the same for all explanations [nats].
        prior: of nuisances and magnitudes, with the volume that the recordings leave to these [nats].
        deviations: of the magnitudes, (k,), one standard deviation.
        nuisance_deviations: of the nuisances, (p,), one standard deviation, in units of their prior's.
        correlation: of the magnitudes, (k, k), and of the nuisances, (p, p).
        second_deviations: of the logarithms of the second numbers, (s,).
        marginal: deviations of the magnitudes where the second numbers are as uncertain as that, (k,).
    """

    log_likelihood: float
    prior: float
    deviations: Array
    nuisance_deviations: Array
    correlation: tuple[Array, Array]
    second_deviations: Array
    marginal: Array


def log_evidence(
    on: Whitening,
    at: Point,
    predicted: Array,
    responses: Responses,
    twins: Sequence[int] = (),
) -> LaplaceEvidence:
    """Evidence at a point that was fitted.

    Args:
        on: whitening of the residuals, with the tolerance for the form of the effects; an explanation that fits without
            that tolerance is not penalised for it.
        at: candidates, magnitudes (k,) and nuisances (p,).
        predicted: there, (ntrials, T, C).
        responses: around it.
        twins: nuisances that are the same number as a magnitude. They are held for its deviation: it says how far the
            sum of both is from the nominal number.
    """
    parts, count = at.parts, len(at.parts)
    seconds, added = responses.seconds, responses.added
    exact = on.exact or on
    _, weighted = on.weighted(predicted, responses.columns)
    # A magnitude that the data do not bind is bound by its bounds.
    priors = np.array([*(1e-9 + 12 / (part.high - part.low) ** 2 for part in parts), *np.ones(len(at.nuisance))])
    curvature = _curvature(weighted, None if added is None else added[: len(priors)]) + np.diag(priors)
    _, logdet = np.linalg.slogdet(curvature)
    _, of_nuisances = np.linalg.slogdet(curvature[count:, count:])
    prior = -0.5 * float(at.nuisance @ at.nuisance) - 0.5 * (logdet - of_nuisances)
    log_likelihood = -min(on.cost(predicted, np.zeros(0)) + on.tolerance_cost, exact.cost(predicted, np.zeros(0)))
    for part, value in zip(parts, at.values, strict=True):
        prior += 0.5 * np.log(2 * np.pi) + part.log_prior(float(value))
        far = abs(np.log(value) if part.identity == 1 else value - part.identity)
        log_likelihood -= MAX_TOLERANCE_PENALTY_NATS * max(0.0, 1 - far / part.tolerance) if part.tolerance else 0.0
    deviations, correlation = _spread(curvature)
    rest = [k for k in range(len(curvature)) if k - count not in twins]
    curvature = curvature[np.ix_(rest, rest)]
    spread, among = _spread(curvature)
    of_magnitudes = spread[:count]
    if seconds is not None:
        _, chosen = on.weighted(predicted, seconds)
        ranges = [width for part in parts for width in part.second_numbers.values()]
        priors = np.concatenate([priors[rest], 12 / np.square(ranges)])
        mine = None if added is None else np.concatenate([added[rest], added[len(at.nuisance) + count :]])
        both = _curvature(np.concatenate([weighted[:, rest], chosen], axis=1), mine)
        spread, _ = _spread(both + np.diag(priors))
    return LaplaceEvidence(
        float(log_likelihood),
        float(prior),
        of_magnitudes,
        deviations[count:],
        (among[:count, :count], correlation[count:, count:]),
        spread[len(rest) :],
        spread[:count],
    )


def _curvature(weighted: Array, added: Array | None) -> Array:
    """Of the likelihood by responses, (n, k), without what scatter added to it, (k,); (k, k)."""
    curvature: Array = weighted.T @ weighted
    return curvature if added is None else scatter.taken_off(curvature, added)


def _spread(curvature: Array) -> tuple[Array, Array]:
    """Deviations (n,) and correlation (n, n) of a curvature."""
    covariance = np.linalg.inv(curvature)
    deviations = np.sqrt(np.diag(covariance))
    return deviations, covariance / np.outer(deviations, deviations)
