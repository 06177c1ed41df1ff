"""Centre of mass of a payload, fitted with its mass once a payload is the best explanation.

A short Gauss-Newton fit of mass, centre and nominal numbers. The centre is reported only where the evidence favours it
over the origin of the body, and only those coordinates that the motion determines.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.gap.decision import verdict
from tiago_mj.gap.inference import noise_model, placing
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point
from tiago_mj.gap.inference.hypotheses import Candidate, terms
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.search import ranking
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.subset import Subset

#: Smallest gain in evidence by a centre of mass [nats].
WORTH: Final = 3.0
#: Trials that are fitted at most.
TRIALS: Final = 4


def refined(plant: Plant, ranked: Ranked, data: Data, trials: Subset) -> Ranked:
    """Explanations: the best one, and those near it whose place was proposed, have the fitted centre of mass of their
    payload where the evidence favours that.

    Args:
        plant: the nominal simulator.
        ranked: explanations, best first.
        data: measured, of the trials that were fitted.
        trials: the session's, as the data has them.
    """
    least = ranked.fits[0].evidence - ranking.LOCAL_OPTIMUM_NATS
    near = [k for k, fit in enumerate(ranked.fits) if fit.evidence > least]
    own, proposed = terms(plant), [k for k in near if any(map(_is_placed, ranked.fits[k].parts))]
    replays = ranked.predict.replays
    places = [_which(fit, replays=replays) for fit in ranked.fits]
    nothing = places[0] is None and not proposed
    if nothing or not ranked.complete or any(term.per_trial for term in own):
        return ranked
    rows = [row for row, trial in enumerate(trials) if trial not in ranked.excluded][:TRIALS]
    selected = noise_model.select_trials(data, rows)
    flat = np.zeros((len(own), *selected.value.shape))
    fitter = Fitter(ranked.predict, trials.at(rows), selected, ranked.weight, own, flat)
    # A second effect may stand for an off-centre mass: the explanation by the payload alone is given a centre, too. So
    # is each whose place was only proposed: any of them may be told.
    alone = (k for k, fit in enumerate(ranked.fits) if len(fit.parts) == ranked.known + 1 and places[k] is not None)
    chosen = {0, next(alone, 0), *proposed}
    fits = [
        fit if k not in chosen or place is None else _placed(fitter, fit, place)
        for k, (fit, place) in enumerate(zip(ranked.fits, places, strict=True))
    ]
    return replace(ranked, fits=tuple(sorted(fits, key=lambda fit: -fit.evidence)))


def _is_placed(part: Candidate) -> bool:
    """Whether a candidate has a place of its own."""
    return placing.without_place(part) != part


def _which(fit: Fitted, *, replays: bool) -> int | None:
    """Index of the effect that has a place; None without one. Where commands are replayed, a place with a prior of its
    own was fitted all along."""
    return next(
        (k for k, part in enumerate(fit.parts) if any(not (replays and d.usual) for d in placing.details(part.effect))),
        None,
    )


def _placed(fitter: Fitter, fit: Fitted, which: int) -> Fitted:
    """The fit with its payload's place as it is likeliest, if that is worth its price. A place that the search proposed
    had the price of one among others; the width of its distribution takes the place of that."""
    sought = placing.Sought(fitter, Point.of(fit), which)
    held, beside = sought.descend(place=False), sought.descend(place=True)
    paid = placing.price(fit.parts[which], fit.values[which])
    gain, prior = held.cost - beside.cost, beside.prior - held.prior + paid
    if not paid and gain / verdict.calibration().temperature + prior < WORTH:
        return fit
    return sought.fitted(fit, beside, gain, prior)
