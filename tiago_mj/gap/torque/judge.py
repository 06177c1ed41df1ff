"""The verdict: what is named, what cannot be told apart, and whether something unnamed is left.

Decided as where commands are replayed (:func:`tiago_mj.gap.decision.verdict.decide`), from evidence of the same kind:
how well an explanation meets the recordings, what it costs, and what it leaves in units of what the most flexible model
leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.analysis import promises
from tiago_mj.gap.decision.verdict import Judged, calibration, decide, discrepancy
from tiago_mj.gap.result import Evidence as Told
from tiago_mj.gap.result import Shrink
from tiago_mj.gap.torque import held_out, tables
from tiago_mj.gap.torque.evidence import FARTHEST, TOLERANCE, Evidence
from tiago_mj.gap.torque.pool import HOPELESS, Candidate, pool, residual
from tiago_mj.gap.torque.search import EQUAL, Scored, Search, clearly

Array = NDArray[np.float64]

#: Squared residual over squared noise above which a gap remains.
ABOVE: Final = 4.0
#: Structure in place of a named effect: of position or time, which no effect that is named there would be.
RIVALS: Final = ("position", "time")
#: Explanations that are shown.
SHOWN: Final = 12


@dataclass(frozen=True)
class Verdict:
    """What was decided.

    Attributes:
        kind: as in the diagnosis.
        null, best: the nominal model, and the best explanation (the nominal one where nothing is named).
        alternatives: explanations as good as the best, the best first; empty where there are none.
        ranking: everything worth showing, likeliest first.
        probability: of each of the ranking, up to its classes.
        evidence: for each of the ranking.
        gains: drop of the validation blocks' mean squared residual of each of the ranking [squared noise].
        remains: channels on which a gap is left, (c,).
        unsupported: effects that unnamed structure explains better.
        shrink: before and after on the test blocks.
        said: sentences on what gave way.
    """

    kind: str
    null: Scored
    best: Scored
    alternatives: tuple[Scored, ...]
    ranking: tuple[Scored, ...]
    probability: Array
    evidence: tuple[Told, ...]
    gains: Array
    remains: NDArray[np.bool_]
    unsupported: tuple[str, ...]
    shrink: Shrink
    said: tuple[str, ...] = ()


def judge(search: Search, seed: int) -> Verdict:
    """Search, compare and decide."""
    e, by = search.evidence, calibration()
    search.begin("explaining")
    null = search.score(())
    first = search.forward()
    search.begin("rivals")
    best, others = search.alternatives(first)
    search.begin("deciding")
    found = [best, *others]
    candidates, judged, gains = _decided(search, found, (), seed)
    leads = candidates[judged.rivals[0]]
    unsupported: tuple[str, ...] = ()
    # Names that leave little need no other explanation. Where all fail, some may stand for something unnamed.
    if judged.kind == "unknown" and discrepancy(leads.option) > by.fails:
        unsupported, rest = _supported(search, leads.fitted)
        if unsupported:
            candidates, judged, gains = _decided(search, [rest, *found], unsupported, seed)
            left_over = [k for k, c in enumerate(candidates) if set(search.names(c.named)) <= set(search.names(rest))]
            judged = Judged("unknown", judged.probability, (max(left_over, key=lambda k: judged.probability[k]),), True)
    options = [c.option for c in candidates]
    if judged.kind == "no_gap" and (_too_much(e, null) or _something(search, null)):
        judged = Judged("unknown", judged.probability, judged.rivals, True)
    closing = tables.shrink(e, null, candidates[judged.rivals[0]].named, seed)
    said: tuple[str, ...] = ()
    if e.blocks.test:
        before = judged.rivals[0]
        judged, said = promises.aside(judged, held_out.aside(e, candidates[before].fitted, closing), options, by)
        if judged.rivals[0] != before:
            closing = tables.shrink(e, null, null, seed)
        closing = held_out.accounted(e, candidates[judged.rivals[0]].fitted, closing)
        said += held_out.spoiled(e, candidates[judged.rivals[0]].fitted, seed)
    fitted = candidates[judged.rivals[0]].fitted
    remains = _remains(e, fitted) & (judged.kind != "no_gap")
    if judged.remains and not remains.any():
        remains = _worst(e, fitted)
    return _told(judged, candidates, gains, remains, null, unsupported, closing, said)


def _decided(
    search: Search, found: Sequence[Scored], without: Sequence[str], seed: int
) -> tuple[list[Candidate], Judged, Array]:
    """Candidates made of what was found, the decision on them, and their gains on the validation blocks."""
    by = calibration()
    candidates = pool(search, found, without)
    named = [c.named for c in candidates]
    gains, beaten = held_out.validated(search.evidence, search.score(()), named, by.fails, seed)
    options = [c.option for c in candidates]
    return candidates, promises.standing(decide(options, by, refuted=beaten), options, by), gains


def _supported(search: Search, best: Scored) -> tuple[tuple[str, ...], Scored]:
    """Effects of an explanation that unnamed structure explains better, and the explanation without them."""
    gone: set[str] = set()
    while more := _unsupported(search, best):
        gone |= set(more)
        best = search.prune(search.score(k for k in best.terms if search.evidence.terms[k].effect not in gone))
    return tuple(sorted(gone)), best


def _told(
    judged: Judged,
    candidates: Sequence[Candidate],
    gains: Array,
    remains: NDArray[np.bool_],
    null: Scored,
    unsupported: tuple[str, ...],
    closing: Shrink,
    said: tuple[str, ...],
) -> Verdict:
    """A verdict with what is shown beside it: the best, what cannot be told from it, then by probability."""
    rivals = judged.rivals if judged.kind in ("ambiguous", "effect") else judged.rivals[:1]
    nominal = next(k for k, c in enumerate(candidates) if not c.named.terms)
    rest = sorted((k for k in range(len(candidates)) if k not in rivals), key=lambda k: -judged.probability[k])
    order = [*rivals, *rest][:SHOWN]
    if nominal not in order:
        order[-1] = nominal
    shown = tuple(candidates[k].named for k in order)
    return Verdict(
        judged.kind,
        null,
        shown[0],
        shown[: len(rivals)] if judged.kind == "ambiguous" else (),
        shown,
        judged.probability[order],
        tuple(candidates[k].option.evidence for k in order),
        gains[order],
        remains,
        unsupported,
        closing,
        said,
    )


def _unsupported(search: Search, best: Scored) -> tuple[str, ...]:
    """Effects of an explanation in whose place functions of position or time do clearly better: one by one, or all.

    An effect that still pays beside such functions is supported, however much they explain besides.
    """
    if not best.terms:
        return ()
    beside = search.unnamed(best, RIVALS)

    def instead(rest: Scored) -> bool:
        # Functions are chosen one by one, and end where the next does not pay: with and without the name are compared
        # with the same ones.
        functions = {(), beside.unnamed, search.unnamed(rest, RIVALS).unnamed}
        with_name = min(search.score(best.terms, chosen).bic for chosen in functions)
        rival = min((search.score(rest.terms, chosen) for chosen in functions), key=lambda one: one.bic)
        better = rival.bic < best.bic - HOPELESS and clearly(best.left_out - rival.left_out, EQUAL)
        return better and not with_name < rival.bic - HOPELESS

    if instead(search.score(())):
        return search.names(best)
    names = search.names(best)
    rests = [search.score(k for k in best.terms if search.evidence.terms[k].effect != name) for name in names]
    return tuple(name for name, rest in zip(names, rests, strict=True) if instead(rest))


def _something(search: Search, null: Scored) -> bool:
    """Whether functions that no effect has predict blocks that were left out better than the nominal model does."""
    return clearly(null.left_out - search.unnamed(null).left_out, EQUAL)


def _too_much(evidence: Evidence, null: Scored) -> bool:
    """Whether the nominal model leaves more of a channel than noise, and than its numbers may be off: then nothing at
    all may predict it, and yet there is a gap."""
    used = evidence.moving & evidence.fitted_rows[:, None]
    left_ = np.where(used, residual(evidence, null), 0.0)
    energy, count = (left_**2).sum(axis=0), np.maximum(used.sum(axis=0), 1)
    effort = np.where(used, evidence.measured**2, 0.0).sum(axis=0)
    beyond = (energy > (FARTHEST * TOLERANCE) ** 2 * effort) & (energy > ABOVE * count * evidence.floor.noise**2)
    return bool(beyond.any())


def _remains(evidence: Evidence, best: Scored) -> NDArray[np.bool_]:
    """Channels on which the residual stands above the noise, (c,)."""
    left_ = residual(evidence, best)
    used = evidence.moving & evidence.fitted_rows[:, None]
    squares = np.array([np.mean(left_[used[:, c], c] ** 2) for c in range(left_.shape[1])]) / evidence.floor.noise**2
    # A mean square of n effective samples is uncertain by sqrt(2 / n) of itself.
    least = squares * (1 - 1.64 * np.sqrt(2 / np.maximum(evidence.effective, 3)))
    return np.asarray(least > ABOVE, dtype=bool)


def _worst(evidence: Evidence, best: Scored) -> NDArray[np.bool_]:
    """The channel with the largest residual over its noise, (c,)."""
    left_ = np.where(evidence.moving & evidence.fitted_rows[:, None], residual(evidence, best), 0.0)
    energy = (left_**2).sum(axis=0) / evidence.floor.noise**2
    return np.asarray(energy >= energy.max(), dtype=bool)
