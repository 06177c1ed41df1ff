"""Which set of effects explains the gap: forward with groups of joints, backward term by term, and again without each.

An explanation is scored by the misfit of blocks that were left out, and by BIC over the effective number of samples; a
step must improve both, the former by more than its standard error. What else explains the data is found by forbidding
every effect of the best explanation in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.torque.evidence import Evidence

Array = NDArray[np.float64]

#: Effects in one explanation, on however many joints.
MOST_EFFECTS: Final = 4
#: Steps that are refined before one is taken.
BEAM: Final = 3
#: Rounds of fitting and renewing what depends on the fit, at most: most end after two or three, but strengths that turn
#: back and forth (a time shift), or a gain that is fitted along, draw near more slowly.
ROUNDS: Final = 40
#: Penalty of one more joint for an effect that is on another.
SIBLING: Final = 2.0
#: Change of every strength, in units of its magnitude, at which the rounds end. An explanation that does not get there
#: contradicts itself (its columns belong to other strengths) and counts for nothing.
SETTLED: Final = 5e-3
#: BIC by which what leads must be ahead of the nominal model: "very strong" evidence (Kass & Raftery 1995).
LEADS: Final = 10.0
#: Standard errors within which two explanations are equally good.
EQUAL: Final = 2.0


@dataclass(frozen=True)
class Scored:
    """An explanation with its scores.

    Attributes:
        terms: indices of terms, ascending, without the given ones.
        strengths: of the terms and the given ones, from train and validation blocks.
        left_out: (B,) misfit of each of those blocks under the fit to the others.
        bic: Bayesian information criterion.
        unnamed: columns of unnamed structure beside the terms.
    """

    terms: tuple[int, ...]
    strengths: dict[int, float]
    left_out: Array
    bic: float
    unnamed: tuple[int, ...] = ()


class Search:
    """Search over the terms of some evidence; ``tick`` is told its stage at every explanation that is fitted.

    Attributes:
        evidence: that is searched.
        price: of an effect by BIC.
        tried: explanations that were scored, by their terms.
        looked_at: names of effects of which it is known what they would bring beside an explanation.
    """

    def __init__(self, evidence: Evidence, tick: Callable[[str], None] = lambda stage: None) -> None:
        self.evidence, self._tick, self._stage = evidence, tick, "explaining"
        self.price = float(np.log(max(evidence.effective.sum(), np.e)))
        self.tried: dict[tuple[int, ...], Scored] = {}
        self.looked_at: set[str] = set()

    def begin(self, stage: str) -> None:
        """Another stage of the search begins."""
        self._stage = stage
        self._tick(stage)

    def score(self, terms: Iterable[int], extra: Sequence[int] = ()) -> Scored:
        """Fit, renew what depends on the fit, and score; ``extra``: columns of structure beside the terms."""
        key = tuple(sorted(terms))
        if not extra and key in self.tried:
            return self.tried[key]
        self._tick(self._stage)
        e, fixed = self.evidence, [*self.evidence.tolerance, *extra]
        active = [*key, *fixed]
        strengths: dict[int, float] = {}
        relaxed: dict[int, float] = {}
        last: dict[int, float] = {}
        settled = False
        for _ in range(ROUNDS):
            e.check()
            e.refresh(strengths, key)
            before, fitted = strengths, e.normal.fit(active, e.fitted)
            moves = {k: float(v) - before.get(k, 0.0) for k, v in zip([*key, *e.given], fitted, strict=False)}
            if max((abs(move) / abs(e.terms[k].magnitude) for k, move in moves.items()), default=0.0) < SETTLED:
                settled = True
                strengths = {k: before.get(k, 0.0) + move for k, move in moves.items()}
                break
            for k, move in moves.items():  # a strength that turns back went too far: it goes half as far from then on
                relaxed[k] = relaxed.get(k, 1.0) * (0.5 if move * last.get(k, 0.0) < 0 else 1.0)
            strengths = {k: before.get(k, 0.0) + relaxed[k] * move for k, move in moves.items()}
            last = moves
        bic = e.normal.criterion(active, e.fitted) + self.penalty(key) + self.price * len(extra)
        found = Scored(
            key,
            strengths,
            e.normal.left_out(active, e.fitted),
            bic if settled or not any(e.stale(k) for k in (*key, *e.given)) else np.inf,
            tuple(extra),
        )
        if not extra:
            self.tried[key] = found
        return found

    def forward(self, start: Iterable[int] = (), banned: Iterable[str] = ()) -> Scored:
        """Add effects while it pays, drop terms that do not."""
        banned = set(banned)
        current = self.prune(self.score(start))
        while True:
            steps = sorted(self._steps(current, banned))[:BEAM]
            refined = [self.prune(self.score(terms)) for _, terms in steps]
            better = [s for s in refined if s.bic < current.bic and clearly(current.left_out - s.left_out, 1.0)]
            if not better:
                return current
            current = min(better, key=lambda s: s.bic)

    def prune(self, current: Scored) -> Scored:
        """Drop terms one by one while the criterion falls; what stands at its identity goes first."""
        while current.terms:
            e = self.evidence
            idle = [k for k in current.terms if abs(current.strengths[k]) < 1e-6 * abs(e.terms[k].magnitude)]
            e.refresh(current.strengths, current.terms)
            quick = [(self._quick(k for k in current.terms if k != gone), gone) for gone in current.terms]
            _, least = min(quick)
            shorter = self.score(set(current.terms) - {idle[0] if idle else least})
            if not idle and shorter.bic >= current.bic:
                break
            current = shorter
        return current

    def _quick(self, terms: Iterable[int]) -> float:
        """BIC with the columns as they are."""
        e, key = self.evidence, tuple(terms)
        return e.normal.criterion([*key, *e.tolerance], e.fitted) + self.penalty(key)

    def penalty(self, terms: Sequence[int]) -> float:
        """Penalty of BIC: the logarithm of the effective samples for each effect and shape.

        Where an effect is on one joint, its siblings are likely to have it, too: each costs no more than by AIC.
        """
        names = {self.evidence.terms[k].effect for k in terms}
        shapes = sum(len(self.evidence.terms[k].shape) for k in terms)
        return self.price * (len(names) + shapes) + SIBLING * (len(terms) - len(names))

    def alternatives(self, best: Scored) -> tuple[Scored, list[Scored]]:
        """The best explanation and others that name different effects, best first.

        Every effect, and every pair, of the best explanation is forbidden in turn, and the search goes on from what is
        left. Where that finds a better one, it takes its place.
        """
        for _ in range(MOST_EFFECTS):
            others = []
            names = self.names(best)
            for name in names:
                rest = [k for k in best.terms if self.evidence.terms[k].effect != name]
                others.append(self.forward(rest, {name}))
                others.append(self.prune(self.score(rest)))
            if len(names) > 1:
                others.append(self.forward((), set(names[:1])))
            others += self._swaps(best)
            rival = min(others, key=lambda s: s.bic, default=best)
            if rival.bic >= best.bic or not float((best.left_out - rival.left_out).sum()) > 0:
                break
            best = self.forward(rival.terms)
        distinct: dict[tuple[str, ...], Scored] = {}
        for other in sorted(others, key=lambda s: s.bic) if best.terms else []:
            if self.names(other) != self.names(best):
                distinct.setdefault(self.names(other), other)
        return best, list(distinct.values())

    def unnamed(self, base: Scored, families: Sequence[str] | None = None) -> Scored:
        """An explanation with the unnamed structure beside it that pays, function by function."""
        e = self.evidence
        chosen: list[int] = []
        current = base
        while True:
            active = [*base.terms, *e.tolerance, *chosen]
            gains = e.normal.gains(active, e.fitted)
            open_ = [k for k in e.structure(families) if k not in chosen]
            best = max(open_, key=lambda k: gains[k], default=None)
            if best is None or gains[best] < self.price:
                return current
            wider = self.score(base.terms, [*chosen, best])
            if not (wider.bic < current.bic and clearly(current.left_out - wider.left_out, 1.0)):
                return current
            current, chosen = wider, [*chosen, best]

    def leader(self) -> Scored:
        """The best of what was scored so far, the nominal model unless something else is better by :data:`LEADS`."""
        null = self.score(())
        best = min(self.tried.values(), key=lambda one: one.bic)
        return best if best.bic < null.bic - LEADS else null

    def names(self, scored: Scored) -> tuple[str, ...]:
        """Effects of an explanation, sorted."""
        return tuple(sorted({self.evidence.terms[k].effect for k in scored.terms}))

    def _swaps(self, best: Scored) -> list[Scored]:
        """One effect for another, wherever it reaches."""
        found = []
        for name in self.names(best):
            rest = [k for k in best.terms if self.evidence.terms[k].effect != name]
            base = self.score(rest)
            steps = [(bic, t) for bic, t in sorted(self._steps(base, {name}))][: 2 * BEAM]
            found += [self.prune(self.score(terms)) for _, terms in steps]
        return found

    def _steps(self, current: Scored, banned: set[str]) -> Iterable[tuple[float, tuple[int, ...]]]:
        """(BIC without renewal, terms) of each effect on all joints that call for it, and on each joint alone."""
        e = self.evidence
        e.refresh(current.strengths)
        active = [*current.terms, *e.tolerance]
        gains = e.normal.gains(active, e.fitted)
        self.looked_at |= {term.effect for term in e.terms} - banned
        present = {e.terms[k].key for k in current.terms}
        names = set(self.names(current))
        best: dict[tuple[str, str], int] = {}
        for k, term in enumerate(e.terms):
            if term.effect in banned or term.key in present or k in e.given:
                continue
            if term.effect not in names and len(names) >= MOST_EFFECTS:
                continue
            if term.key not in best or gains[k] > gains[best[term.key]]:
                best[term.key] = k
        groups: dict[str, list[int]] = {}
        for (name, _), k in best.items():
            if gains[k] > SIBLING:
                groups.setdefault(name, []).append(k)
        sets = {tuple(sorted((*current.terms, *members))) for members in groups.values()}
        sets |= {tuple(sorted((*current.terms, *(k for k in ks if gains[k] > self.price)))) for ks in groups.values()}
        sets |= {tuple(sorted((*current.terms, k))) for members in groups.values() for k in members}
        sets.discard(current.terms)
        for terms in sets:
            bic = self._quick(terms)
            if bic < current.bic:
                yield bic, terms


def clearly(gain: Array, errors: float) -> bool:
    """Whether a gain, block by block, is above 0 by so many standard errors."""
    if len(gain) < 2:
        return bool(gain.sum() > 0)
    return bool(gain.mean() > errors * gain.std(ddof=1) / np.sqrt(len(gain)))


def classes(names: Iterable[str]) -> frozenset[str]:
    """Confusion classes of effects."""
    return frozenset(EFFECTS[name].gap_class for name in names)
