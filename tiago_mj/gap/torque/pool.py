"""Explanations that the verdict decides on, made of what the search found, and the evidence for them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.decision.verdict import Option
from tiago_mj.gap.result import Evidence as Told
from tiago_mj.gap.torque.evidence import Evidence
from tiago_mj.gap.torque.search import EQUAL, Scored, Search, classes, clearly

Array = NDArray[np.float64]

#: What is this far behind in BIC is out: "very strong" evidence (Kass & Raftery 1995).
HOPELESS: Final = 10.0
#: What a nominal model's own numbers are known to, one standard deviation: a share of the motor's constant and of the
#: joint's inertia (:attr:`tiago_mj.effects.Effect.nominal_prior`), and how level a base stands [rad]: a spirit
#: level shows a tenth of a degree. A name is given beyond so many deviations.
OWN: Final = {"torque_constant": 0.04, "armature": 0.03, "gravity_tilt": 0.002}
OF_ALL: Final = ("gravity_tilt",)
CERTAIN: Final = 2.5


@dataclass(frozen=True)
class Candidate:
    """An explanation.

    Attributes:
        named: with those effects alone that go beyond what the nominal model's own numbers are known to: what is told.
        fitted: as it was found, with the others, too, which are the nominal model's own numbers.
        option: as the verdict sees it.
    """

    named: Scored
    fitted: Scored
    option: Option


def pool(search: Search, found: Iterable[Scored], without: Collection[str] = ()) -> list[Candidate]:
    """Explanations with different names, the nominal model among them, the best first.

    Args:
        search: what scores them.
        found: by the search.
        without: effects that are not to be named: each explanation is what is left of it.

    What adds effects to another one and does not predict clearly better is left out, and so is one that has a magnitude
    at its bound where it does hardly worse without.
    """
    e = search.evidence
    best: dict[tuple[str, ...], Candidate] = {}
    for scored in (*found, search.score(())):
        for one in _variants(search, scored, without):
            if not np.isfinite(one.bic):
                continue
            own = {k for k in one.terms if not _is_beyond(e, k, one.strengths[k])}
            named = search.score(k for k in one.terms if k not in own) if own else one
            candidate = Candidate(named, one, _option(search, named, one, own))
            names = search.names(named)
            if names not in best or _total(candidate) > _total(best[names]):
                best[names] = candidate
    return sorted(_needed(search, list(best.values())), key=lambda c: -_total(c))


def residual(evidence: Evidence, scored: Scored, *, with_tolerance: bool = True) -> Array:
    """Residual under an explanation, (T, c) [N, N·m]; what the nominal model's tolerance explains taken out."""
    evidence.refresh(scored.strengths, scored.terms)
    values = evidence.measured - evidence.predicted(scored.strengths)
    if with_tolerance:
        for amount, column in zip(own_numbers(evidence, scored), evidence.tolerance_columns, strict=True):
            values = values - amount * column
    return values


def own_numbers(evidence: Evidence, scored: Scored) -> Array:
    """How far the nominal model's numbers were moved beside an explanation, [deviations], as its tolerance columns; the
    columns are those of the last renewal."""
    active = [*scored.terms, *evidence.tolerance]
    found: Array = evidence.normal.fit(active, evidence.fitted)[len(scored.terms) + len(evidence.given) :]
    return found


def misfit(evidence: Evidence, left: Array, rows: NDArray[np.bool_]) -> float:
    """Mean square of the worst channel's residual (T, c) in some rows (T, c), in units of what the most flexible model
    leaves."""
    squares = [
        float(np.mean(left[rows[:, c], c] ** 2)) / evidence.floor.spread[c] ** 2
        for c in range(left.shape[1])
        if rows[:, c].any()
    ]
    return max(squares, default=0.0)


def _variants(search: Search, scored: Scored, without: Collection[str]) -> list[Scored]:
    """An explanation without the names that are not to be given; also without what is at its bound, and no more as it
    is where that does hardly worse."""
    terms = search.evidence.terms
    if any(terms[k].effect in without for k in scored.terms):
        scored = search.prune(search.score(k for k in scored.terms if terms[k].effect not in without))
    inside = [k for k in scored.terms if not terms[k].at_edge(scored.strengths[k])]
    if len(inside) == len(scored.terms):
        return [scored]
    less = search.prune(search.score(inside))
    return [less] if less.bic < scored.bic + HOPELESS else [scored, less]


def _option(search: Search, named: Scored, fitted: Scored, own: Collection[int]) -> Option:
    """The nominal model's own numbers cost what their prior says, effects what BIC says."""
    e = search.evidence
    terms = e.terms
    targets = {
        name: tuple(sorted({terms[k].target for k in named.terms if terms[k].effect == name}))
        for name in search.names(named)
    }
    moved = sum((fitted.strengths[k] / _deviation(e, k)) ** 2 for k in own)
    rows = e.moving & e.fitted_rows[:, None]
    worst = misfit(e, residual(e, fitted), rows)
    evidence = Told(
        met=-0.5 * (fitted.bic - search.penalty(fitted.terms)),
        price=-0.5 * (search.penalty(named.terms) + moved),
        misfit=worst,
        lasting=worst,
        edge=any(terms[k].at_edge(fitted.strengths[k]) for k in fitted.terms),
    )
    return Option(frozenset(targets.items()), classes(targets), evidence)


def _total(candidate: Candidate) -> float:
    return candidate.option.evidence.met + candidate.option.evidence.price


def _needed(search: Search, found: Sequence[Candidate]) -> list[Candidate]:
    """Without those that add to another one and do not predict clearly better: BIC does not rule the shorter one out,
    nor do the blocks that were left out."""

    def adds_nothing(one: Candidate) -> bool:
        names = set(search.names(one.named))
        return any(
            set(search.names(o.named)) < names
            and o.named.terms
            and o.fitted.bic < one.fitted.bic + HOPELESS
            and not clearly(o.fitted.left_out - one.fitted.left_out, EQUAL)
            for o in found
        )

    return [one for one in found if not adds_nothing(one)]


def _is_beyond(evidence: Evidence, term: int, strength: float) -> bool:
    """Whether a strength goes beyond what the nominal model's own number of that kind is known to."""
    declared = evidence.terms[term]
    if declared.effect not in OWN or (declared.joint is None and declared.effect not in OF_ALL):
        return True
    return abs(strength) > CERTAIN * _deviation(evidence, term)


def _deviation(evidence: Evidence, term: int) -> float:
    """Of the nominal model's own number of an effect's kind."""
    declared = evidence.terms[term]
    own = 1.0
    if declared.effect == "armature" and declared.joint is not None:
        own = evidence.torques.inertia(declared.joint)
    return OWN[declared.effect] * own
