"""The verdict: what is named, what cannot be told apart, and whether something unnamed is left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.torque.evidence import Evidence
from tiago_mj.gap.torque.search import EQUAL, Scored, Search, classes, clearly, weights

Array = NDArray[np.float64]

#: Named effects must close this share of what they and unnamed structure together could, else the gap is unknown.
KNOWN_SHARE: Final = 0.5
#: Alternatives this far behind in BIC are not worth a reader's time: "very strong" evidence (Kass & Raftery 1995).
HOPELESS: Final = 10.0
#: An explanation that is likelier than this is never kept from the reader.
LIKELY: Final = 0.05
#: Squared residual over squared noise above which a gap remains.
ABOVE: Final = 4.0
#: What a nominal model's own numbers are known to, one standard deviation: a share of the motor's constant and of the
#: joint's inertia (:data:`tiago_mj.gap.inference.hypotheses.NUISANCES`), and how level a base stands [rad]: a spirit
#: level shows a tenth of a degree. A name is given beyond so many deviations.
OWN: Final = {"torque_constant": 0.04, "armature": 0.03, "gravity_tilt": 0.002}
OF_ALL: Final = ("gravity_tilt",)
CERTAIN: Final = 2.5
#: Structure in place of a named effect: of position or time, which no effect that is named there would be.
RIVALS: Final = ("position", "time")


@dataclass(frozen=True)
class Verdict:
    """What was decided.

    Attributes:
        kind: as in the diagnosis.
        null, best: the nominal model, and the best explanation (the nominal one where nothing is named).
        alternatives: explanations as good as the best, the best first; empty where there are none.
        ranking: everything worth showing, likeliest first.
        probability: of each of the ranking.
        unnamed: the best explanation with the unnamed structure that pays.
        remains: channels on which a gap is left, (c,).
        unsupported: effects that unnamed structure explains better.
    """

    kind: str
    null: Scored
    best: Scored
    alternatives: tuple[Scored, ...]
    ranking: tuple[Scored, ...]
    probability: Array
    unnamed: Scored
    remains: NDArray[np.bool_]
    unsupported: tuple[str, ...]


def judge(search: Search, seed: int) -> Verdict:
    """Search, compare and decide."""
    null = search.score(())
    best, others = search.alternatives(search.forward())
    unsupported = _unsupported(search, best)
    unnamed = search.unnamed(best)
    supported = _share(null, best, unnamed) >= KNOWN_SHARE
    best, equal = _simplest(search, best, others, seed)
    if unsupported:  # what stands in its place is unnamed, and remains
        equal = [one for one in equal if not set(unsupported) & set(search.names(one))]
        best = search.prune(search.score(k for k in best.terms if search.evidence.terms[k].effect not in unsupported))
        unnamed = search.unnamed(best)
        closes = _share(null, best, min(unnamed, search.unnamed(null), key=lambda s: s.bic))
        supported = closes >= KNOWN_SHARE and _closes_each(search.evidence, best)
        if closes < KNOWN_SHARE:
            best, unnamed, equal = null, search.unnamed(null), []
    beyond = [k for k in best.terms if _is_beyond(search.evidence, k, best.strengths[k])]
    within = len(beyond) < len(best.terms)
    if within:  # what a nominal model's own numbers are known to is no effect
        best = search.score(beyond)
        equal = [one for one in equal if all(_is_beyond(search.evidence, k, one.strengths[k]) for k in one.terms)]
    remains = _remains(search.evidence, best)
    if not best.terms and within and supported:
        kind, equal = "no_gap", []
        remains &= False
    elif not best.terms:
        generic = search.unnamed(null)
        kind = "unknown" if unsupported or clearly(null.left_out - generic.left_out, EQUAL) else "no_gap"
        remains &= kind == "unknown"
    elif not supported:
        kind = "unknown"
    else:
        kind = "ambiguous" if equal else "effect"
    more = (o for o in others if all(o is not x for x in (best, *equal)))
    shown = [best, *equal, *more, *([null] if best.terms else [])][:12]
    probability = weights(shown, seed)
    kinds = [classes(search.names(one)) for one in shown]
    together = np.array([probability[[k == kind_ for k in kinds]].sum() for kind_ in kinds])
    if kind == "ambiguous":
        first = max(range(1 + len(equal)), key=lambda k: (together[k], probability[k]))
        best, equal = shown[first], [one for k, one in enumerate(shown[: 1 + len(equal)]) if k != first]
        unnamed, remains = search.unnamed(best), _remains(search.evidence, best)
    order = sorted(range(len(shown)), key=lambda k: (shown[k] is not best, -together[k], -probability[k]))
    listed = tuple(shown[k] for k in order)
    return Verdict(
        kind,
        null,
        best,
        tuple(one for one in listed if one is best or any(one is x for x in equal)) if kind == "ambiguous" else (),
        listed,
        probability[order],
        unnamed,
        remains | (np.full(remains.shape, kind == "unknown") & _worst(search.evidence, best)),
        unsupported,
    )


def _simplest(search: Search, best: Scored, others: list[Scored], seed: int) -> tuple[Scored, list[Scored]]:
    """The best explanation without what does not pay clearly, and others as good that do not merely add to it.

    As good are those whose left-out misfit is within the error of the best one's, unless BIC rules them out, and those
    that hold a share of the probability that a reader should not lose.
    """
    everything = [best, *others]
    share = dict(zip(map(id, everything), weights(everything, seed), strict=True))

    def as_good(than: Scored) -> list[Scored]:
        near = [o for o in everything if o.bic < than.bic + HOPELESS and not clearly(o.left_out - than.left_out, EQUAL)]
        likely = [o for o in everything if share[id(o)] > LIKELY and all(o is not n for n in near)]
        return [o for o in (*near, *likely) if o is not than]

    while True:
        names = set(search.names(best))
        fewer = [o for o in as_good(best) if o.terms and set(search.names(o)) < names]
        if not fewer:
            break
        best = min(fewer, key=lambda o: (len(search.names(o)), o.bic))
    names = set(search.names(best))
    return best, [o for o in as_good(best) if o.terms and not set(search.names(o)) >= names]


def up_to_class(verdict: Verdict, search: Search, scored: Scored) -> float:
    """Probability of an explanation and of those that name the same classes; of the best, also of those that merely add
    to it."""
    wanted, names = classes(search.names(scored)), set(search.names(scored))
    listed = [set(search.names(one)) for one in verdict.alternatives]
    total = 0.0
    for other, probability in zip(verdict.ranking, verdict.probability, strict=True):
        adds = (
            scored is verdict.best
            and bool(names)
            and set(search.names(other)) > names
            and set(search.names(other)) not in listed
        )
        if classes(search.names(other)) == wanted or adds:
            total += float(probability)
    return min(total, 1.0)


def residual(evidence: Evidence, scored: Scored, *, with_tolerance: bool = True) -> Array:
    """Residual under an explanation, (T, c) [N, N·m]; what the nominal model's tolerance explains taken out."""
    evidence.refresh(scored.strengths, scored.terms)
    values = evidence.measured - evidence.predicted(scored.strengths)
    if with_tolerance:
        active = [*scored.terms, *evidence.tolerance]
        fitted = evidence.normal.fit(active, evidence.fitted)[len(scored.terms) + len(evidence.given) :]
        for amount, column in zip(fitted, evidence.tolerance_columns, strict=True):
            values = values - amount * column
    return values


def _is_beyond(evidence: Evidence, term: int, strength: float) -> bool:
    """Whether a strength goes beyond what the nominal model's own number of that kind is known to."""
    declared = evidence.terms[term]
    deviation = OWN.get(declared.effect)
    if deviation is None or (declared.joint is None and declared.effect not in OF_ALL):
        return True
    own = 1.0
    if declared.effect == "armature" and declared.joint is not None:
        own = evidence.torques.inertia(declared.joint)
    return abs(strength) > CERTAIN * deviation * own


def _share(null: Scored, best: Scored, unnamed: Scored) -> float:
    """Share of the gap that names close, of what names and structure close together."""
    whole = float(null.left_out.sum() - min(unnamed.left_out.sum(), best.left_out.sum()))
    return float(null.left_out.sum() - best.left_out.sum()) / whole if whole > 0 else 0.0


def _closes_each(evidence: Evidence, best: Scored) -> bool:
    """Whether names close the share of the gap on every channel that has one: no effect had to give way there."""
    used = evidence.moving & evidence.fitted_rows[:, None]
    gap = np.where(used, evidence.measured - evidence.nominal, 0.0) / evidence.floor.noise
    left = np.where(used, residual(evidence, best), 0.0) / evidence.floor.noise
    there = (gap**2).sum(axis=0) > ABOVE * used.sum(axis=0)
    return bool(((left**2).sum(axis=0) <= (1 - KNOWN_SHARE) * (gap**2).sum(axis=0))[there].all())


def _unsupported(search: Search, best: Scored) -> tuple[str, ...]:
    """Effects of an explanation in whose place functions of position or time do clearly better: one by one, or all.

    An effect that still pays beside such functions is supported, however much they explain besides.
    """
    beside = search.unnamed(best, RIVALS)

    def instead(rest: Scored) -> bool:
        rival = search.unnamed(rest, RIVALS)
        better = rival.bic < best.bic - HOPELESS and clearly(best.left_out - rival.left_out, EQUAL)
        return better and not beside.bic < rival.bic - HOPELESS

    if instead(search.score(())):
        return search.names(best)
    names = search.names(best)
    rests = [search.score(k for k in best.terms if search.evidence.terms[k].effect != name) for name in names]
    return tuple(name for name, rest in zip(names, rests, strict=True) if instead(rest))


def _remains(evidence: Evidence, best: Scored) -> NDArray[np.bool_]:
    """Channels on which the residual stands above the noise, (c,)."""
    left = residual(evidence, best)
    used = evidence.moving & evidence.fitted_rows[:, None]
    squares = np.array([np.mean(left[used[:, c], c] ** 2) for c in range(left.shape[1])]) / evidence.floor.noise**2
    # A mean square of n effective samples is uncertain by sqrt(2 / n) of itself.
    least = squares * (1 - 1.64 * np.sqrt(2 / np.maximum(evidence.effective, 3)))
    return np.asarray(least > ABOVE, dtype=bool)


def _worst(evidence: Evidence, best: Scored) -> NDArray[np.bool_]:
    """The channel with the largest residual over its noise, (c,)."""
    left = np.where(evidence.moving & evidence.fitted_rows[:, None], residual(evidence, best), 0.0)
    energy = (left**2).sum(axis=0) / evidence.floor.noise**2
    return np.asarray(energy >= energy.max(), dtype=bool)
