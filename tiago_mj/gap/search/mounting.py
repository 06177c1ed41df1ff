"""Where a load may hang on your robot: places of a payload, from the recordings, before effects are screened.

A load hangs where it was mounted, and not at the centre of mass of the link that carries it. Of one 0.2 m off an
arm's last axis the link's own centre shows so little that the masses of links, a few per cent off, explain more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tiago_mj.gap.inference import likelihood, placing
from tiago_mj.gap.inference.fit import Fitter, Point
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.whitening import Whitening

Array = NDArray[np.float64]

#: A mass below this share of what is possible has no place: its moments would be divided by next to nothing. Halved and
#: doubled, the answers about two real loads are the same.
LEAST_SHARE: Final = 1e-3


def proposed(fitter: Fitter, point: Point, pool: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Candidates of the pool that have a place, each at its likeliest one, where that is worth its price.

    Nothing on the package's own robots: what their grippers carry is known.

    Args:
        fitter: of the trials that are screened.
        point: the nominal model, with its numbers.
        pool: candidates.
    """
    if fitter.predict.plant.environment is not None:
        return ()
    found = (_placed(fitter, point, part) for part in pool if placing.details(part.effect))
    return tuple(part for part in found if part is not None)


def _placed(fitter: Fitter, point: Point, part: Candidate) -> Candidate | None:
    """A candidate with its likeliest place; None where its own centre of mass is as likely."""
    coordinates = placing.details(part.effect)
    found = []
    for place in (False, True):
        mass, *moments = _if_linear(fitter, point, part, place=place)
        if abs(mass) < LEAST_SHARE * (part.high - part.low):  # nothing to place
            return None
        at = zip(coordinates, np.divide(moments, mass), strict=False)
        fixed = tuple((d.name, float(np.clip(x, *d.bounds))) for d, x in at)
        begin = replace(part, fixed=(*part.fixed, *fixed))
        sought = placing.Sought(fitter, point.with_effect(begin, float(mass)), len(point.parts))
        found.append(sought.descend(place=place))
    centre, beside = found
    where = zip(coordinates, beside.parameters[1:], strict=False)
    placed = replace(part, fixed=(*part.fixed, *((d.name, float(x)) for d, x in where)))
    price = part.log_prior(beside.parameters[0]) - placed.log_prior(beside.parameters[0])
    return placed if centre.cost - beside.cost > price else None


def _if_linear(fitter: Fitter, point: Point, part: Candidate, *, place: bool) -> Array:
    """Mass, and with ``place`` its first moments about the body's centre of mass, that are likeliest beside the nominal
    numbers if all change predictions in proportion, (1 or 4,) [kg, kg·m]."""
    size, coordinates = part.grid[-1], placing.details(part.effect) if place else ()
    aside = [d.bounds[1] / 2 for d in coordinates]
    moved = [replace(part, fixed=(*part.fixed, (d.name, x))) for d, x in zip(coordinates, aside, strict=True)]
    points = [point, *(point.with_effect(one, size) for one in (part, *moved))]
    base, centre, *beside = fitter.predictions(points)
    changes = [centre - base, *((one - centre) / x for one, x in zip(beside, aside, strict=True))]
    on = Whitening(fitter.data, fitter.weight)
    of_terms = on.columns(fitter.responses, fitter.per_trial)
    columns = np.column_stack([on.white(np.stack(changes)).T / size, of_terms])
    wanted = np.concatenate([on.white(likelihood.residual(fitter.data, base)), -point.nuisance])
    known = np.eye(fitter.size, columns.shape[1], len(changes))
    bound = likelihood.NUISANCE_BOUND
    free = np.full(len(coordinates), np.inf)
    low = np.concatenate([[part.low], -free, -bound - point.nuisance])
    high = np.concatenate([[part.high], free, bound - point.nuisance])
    found = lsq_linear(np.vstack([columns, known]), wanted, bounds=(low, high), lsmr_tol="auto")
    out: Array = found.x[: len(changes)]
    return out
