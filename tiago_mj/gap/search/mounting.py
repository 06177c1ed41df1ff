"""Where a load may hang on your robot: places of a payload along a motion, before effects are screened.

A load hangs where it was mounted, and not at the centre of mass of the link that carries it. Of one 0.2 m off an
arm's last axis the link's own centre shows so little that the masses of links, a few per cent off, explain more.
Efforts that hold a load are linear in its mass and moments, so that one least-squares fit tells about where it hangs,
and a short Gauss-Newton fit from there, with its inertia, the place. Positions that replayed commands lead to are not
linear in them: there a place is sought once a payload is the best explanation (:mod:`tiago_mj.gap.analysis.place`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tiago_mj.gap.inference import likelihood, placing
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.whitening import Whitening

Array = NDArray[np.float64]

#: A mass below this share of what is possible has no place: its moments would be divided by next to nothing. Halved and
#: doubled, the answers about two real loads are the same.
LEAST_SHARE: Final = 1e-3


def proposed(fitter: Fitter, point: Point, pool: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Candidates of the pool that have a place, each at its likeliest one, where that is worth its price.

    Args:
        fitter: of the trials that are screened.
        point: the nominal model, with its numbers.
        pool: candidates.
    """
    if fitter.predict.replays:
        return ()
    found = (_placed(fitter, point, part) for part in pool if placing.details(part.effect))
    return tuple(part for part in found if part is not None)


def placed_again(fitter: Fitter, fit: Fitted) -> Fitted:
    """The fit along a motion with its load at the place that is likeliest beside its other effects, where that gains
    evidence."""
    which = next((k for k, part in enumerate(fit.parts) if placing.without_place(part) != part), None)
    if which is None:
        return fit
    part, point = fit.parts[which], Point.of(fit)
    mass, *where = placing.Sought(fitter, point, which).descend(place=True).parameters
    parts, values = list(fit.parts), fit.values.copy()
    parts[which], values[which] = _at(part, where[: len(placing.details(part.effect))]), mass
    (found,) = fitter.fit_all([Start(tuple(parts), values, fit.nuisance)])
    return max(fit, found, key=lambda one: one.evidence)


def _placed(fitter: Fitter, point: Point, part: Candidate) -> Candidate | None:
    """A candidate with its likeliest place; None where its own centre of mass is as likely."""
    coordinates = placing.details(part.effect)
    columns, wanted = changes(fitter, point, part)
    of_moments = range(1, 1 + len(coordinates))
    centre, _ = _likeliest(fitter, point, part, np.delete(columns, of_moments, axis=1), wanted)
    beside, (mass, *moments) = _likeliest(fitter, point, part, columns, wanted)
    if abs(mass) < LEAST_SHARE * (part.high - part.low):  # nothing to place
        return None
    placed = at_moments(part, mass, moments)
    # What turns has an inertia that grows with the square of its distance, which the fit above lacks.
    sought = placing.Sought(fitter, Point((placed,), np.array([mass]), point.nuisance), 0)
    mass, *where = sought.descend(place=True).parameters[: 1 + len(coordinates)]
    placed = _at(part, where)
    return placed if centre - beside > placing.price(placed, mass) else None


def at_moments(part: Candidate, mass: float, moments: Sequence[float]) -> Candidate:
    """A candidate where its mass and moments say."""
    coordinates = placing.details(part.effect)
    return _at(part, [float(np.clip(m / mass, *d.bounds)) for d, m in zip(coordinates, moments, strict=True)])


def _at(part: Candidate, where: Sequence[float]) -> Candidate:
    """A candidate at a place."""
    names = [d.name for d in placing.details(part.effect)]
    place = tuple((name, float(x)) for name, x in zip(names, where, strict=True))
    return replace(placing.without_place(part), fixed=(*placing.without_place(part).fixed, *place))


def changes(fitter: Fitter, point: Point, part: Candidate) -> tuple[Array, Array]:
    """What a mass, its moments about the body's centre of mass and the nominal numbers change, whitened, (n, 4 + size)
    per kg, kg·m and deviation, and what is to be explained, (n,)."""
    size, coordinates = part.grid[-1], placing.details(part.effect)
    aside = [d.bounds[1] / 2 for d in coordinates]
    moved = [replace(part, fixed=(*part.fixed, (d.name, x))) for d, x in zip(coordinates, aside, strict=True)]
    base, centre, *beside = fitter.predictions([point, *(point.with_effect(one, size) for one in (part, *moved))])
    changes = [centre - base, *((one - centre) / x for one, x in zip(beside, aside, strict=True))]
    on = Whitening(fitter.data, fitter.weight)
    of_terms = on.columns(fitter.responses, fitter.per_trial)
    columns = np.column_stack([on.white(np.stack(changes)).T / size, of_terms])
    return columns, on.white(likelihood.residual(fitter.data, base))


def _likeliest(
    fitter: Fitter, point: Point, part: Candidate, columns: Array, wanted: Array
) -> tuple[float, Sequence[float]]:
    """The negative log likelihood [nats] of the likeliest mass and moments beside the nominal numbers, and these; each
    moment has a prior deviation of the largest mass at the bound of a place."""
    count = columns.shape[1] - fitter.size
    reach = [part.high * d.bounds[1] for d in placing.details(part.effect)][: count - 1]
    known = np.diag([0.0, *(1 / x for x in reach), *np.ones(fitter.size)])
    bound, free = likelihood.NUISANCE_BOUND, np.full(count - 1, np.inf)
    low = np.concatenate([[part.low], -free, -bound - point.nuisance])
    high = np.concatenate([[part.high], free, bound - point.nuisance])
    rows = np.concatenate([wanted, np.zeros(count), -point.nuisance])
    found = lsq_linear(np.vstack([columns, known]), rows, bounds=(low, high))
    return float(found.cost), found.x[:count].tolist()
