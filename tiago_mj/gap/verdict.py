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

#: Evidence is divided by this before it becomes a probability: two simulators never agree as closely as their noise, so
#: a Bayes factor of exp(10) is counted as exp(1). Chosen, not yet calibrated.
TEMPERATURE: Final = 10.0
#: Prior odds of one effect against none, spread over the library, and of a second one.
ONE_EFFECT: Final = 1.0
SECOND_EFFECT: Final = 0.2
#: Explanations at least this probable beside the best are not ruled out.
RIVAL: Final = 0.05
#: Mean squared residual of the worst channel, in units of floor and tolerance, above which even the best explanation
#: fails. The right one leaves 0.1 to 0.5 on the simulator's own recordings, the nearest wrong one of a library without
#: it 1.4 to 40 (tests/gap/test_diagnose.py has cases). Not yet calibrated on recordings of another simulator.
FAILS: Final = 2.0
#: And above which a part of the gap is said to remain.
REMAINS: Final = 1.0


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
    scores = ranked.evidence / TEMPERATURE + np.log([_prior(f) for f in ranked.fits])
    order_free = np.exp(scores - scores.max())
    single = order_free / order_free.sum()
    classes = [classes_of(f) for f in ranked.fits]
    pooled = np.array([single[[c == classes[k] for c in classes]].sum() for k in range(len(classes))])
    best = int(np.argmax(single))
    rivals = sorted((k for k in range(len(single)) if single[k] >= RIVAL * single[best]), key=lambda k: -single[k])
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


def classes_of(fit: Fitted) -> frozenset[str]:
    """Classes of the effects of an explanation."""
    return frozenset(EFFECTS[part.effect].gap_class for part in fit.parts)


def _prior(fit: Fitted) -> float:
    return (1.0, ONE_EFFECT, ONE_EFFECT * SECOND_EFFECT)[len(fit.parts)]
