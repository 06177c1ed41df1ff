"""From the evidence for explanations to a verdict that can be wrong only as often as it says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.effects import EFFECTS
from tiago_mj.gap.fit import Fitted
from tiago_mj.gap.select import Ranked

Array = NDArray[np.float64]

#: How well the recordings are met is divided by this before it becomes a probability: two simulators never agree as
#: closely as their noise. How far the nominal numbers had to go for it counts in full. Chosen, not yet calibrated.
TEMPERATURE: Final = 10.0
#: Prior odds of one effect against none, spread over the library, and of another one beside it; and of one target
#: against all.
ONE_EFFECT: Final = 1.0
ANOTHER_EFFECT: Final = 0.5
ONE_TARGET: Final = 0.5
#: The nominal model stands at this probability or more, unless it plainly fails.
STANDS: Final = 1 / 3
#: Explanations at least this probable beside the best are not ruled out.
RIVAL: Final = 0.05
#: Mean squared residual of the worst channel, in units of floor and tolerance, above which even the best explanation
#: fails. The right one leaves 0.1 to 1.1 at 240 Hz and up to 2.5 at 25 Hz on recordings whose nominal parameters are 3
#: to 5 % off, the nearest wrong one of a library without it mostly 3 to 90. Not yet calibrated.
FAILS: Final = 3.0
#: And above which a part of the gap is said to remain.
REMAINS: Final = 2.0


@dataclass(frozen=True)
class Judged:
    """A verdict.

    Attributes:
        kind: ``no_gap``, ``effect``, ``ambiguous`` or ``unknown``.
        probability: of every explanation, up to its classes, (n,).
        rivals: indices of the explanations that are not ruled out, the best first.
        remains: whether a gap is left after the best.
    """

    kind: str
    probability: Array
    rivals: tuple[int, ...]
    remains: bool


def judge(ranked: Ranked) -> Judged:
    """Judge ranked explanations, best first."""
    prior = np.array([f.prior for f in ranked.fits])
    met = np.array([f.evidence for f in ranked.fits]) - prior
    # What the best explanation leaves is model error, which counts as often as it is repeated.
    temperature = TEMPERATURE * max(1.0, min(f.misfit for f in ranked.fits))
    scores = met / temperature + prior + np.array([_log_prior(f, ranked) for f in ranked.fits])
    order_free = np.exp(scores - scores.max())
    single = order_free / order_free.sum()
    classes = [classes_of(f) for f in ranked.fits]
    pooled = np.array([single[[c == classes[k] for c in classes]].sum() for k in range(len(classes))])
    nominal = next(k for k, f in enumerate(ranked.fits) if len(f.parts) == ranked.known)
    others = [k for k in range(len(single)) if k != nominal]
    best = max(others, key=lambda k: single[k], default=nominal)
    stands = single[nominal] >= STANDS * single[best] and ranked.fits[nominal].misfit <= FAILS
    if stands or best == nominal:
        best, rivals = nominal, [nominal]
    else:
        rivals = _rivals(ranked, single, best, nominal)
    misfit = ranked.fits[best].misfit
    if misfit > FAILS:
        kind = "unknown"
    elif not ranked.fits[best].parts:
        kind = "no_gap"
    elif any(classes[k] != classes[best] for k in rivals):
        kind = "ambiguous"
    else:
        kind = "effect"
    return Judged(kind, pooled, tuple(rivals), misfit > REMAINS)


def _rivals(ranked: Ranked, probability: Array, best: int, nominal: int) -> list[int]:
    """What is not ruled out beside the best, most probable first; of the same effects on several targets the best."""
    out: dict[frozenset[str], int] = {}
    for k in np.argsort(-probability):
        if k != nominal and probability[k] >= RIVAL * probability[best]:
            out.setdefault(frozenset(part.effect for part in ranked.fits[k].parts), int(k))
    return list(out.values())


def classes_of(fit: Fitted) -> frozenset[str]:
    """Classes of the effects of an explanation."""
    return frozenset(EFFECTS[part.effect].gap_class for part in fit.parts)


def _log_prior(fit: Fitted, ranked: Ranked) -> float:
    """One of the effects is as likely as none; each has its share; one finger's half of both's."""
    count = len(fit.parts) - ranked.known
    parts = fit.parts[:count]
    share = sum(np.log((ANOTHER_EFFECT if k else ONE_EFFECT) / ranked.pool) for k in range(count))
    return float(share + sum(np.log(ONE_TARGET) for part in parts if part.target is not None))
