"""From the evidence for explanations to a verdict that can be wrong only as often as it says.

    log odds = met / T + price

``met`` is how well an explanation meets the recordings [nats], ``price`` what it costs: how far nominal numbers had to
go for it, how much of what its effects might have been is left, and how rare they are. What a second effect adds to
``met`` counts for less than what the first one did. T, how much less, and the thresholds are calibrated on simulated
recordings whose effect is known: ``verdict.json``, which says how.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.result import Evidence
from tiago_mj.gap.search.select import Ranked

Array = NDArray[np.float64]

#: Prior odds of one effect against none, spread over the library, and of another one beside it; and of one target
#: against all.
ONE_EFFECT: Final = 1.0
ANOTHER_EFFECT: Final = 0.5
ONE_TARGET: Final = 0.5
#: An explanation that stands refutes one that fails where it leaves so much less of what is beyond the noise.
LESS: Final = 0.6
#: The temperature rises no further where all explanations fail.
HOTTEST: Final = 4.0
CALIBRATION: Final = "verdict.json"
SCHEMA: Final = "tiago_mj.verdict/1"


@dataclass(frozen=True)
class Calibration:
    """What turns evidence into a verdict.

    Attributes:
        temperature: how well the recordings are met is divided by this: two simulators never agree as closely as their
            noise, so their errors are no independent draws of it.
        further: what a further effect adds to how well the best by fewer met the recordings is divided by this, too:
            where the form of one effect is not quite reality's, what is left looks like another.
        stands: the nominal model stands at this probability over the best explanation's, unless it leaves a gap.
        rival: explanations at least this probable beside the best are not ruled out.
        fails: mean square of the worst channel's error, over blocks or sample by sample, in units of what it should
            scatter by, above which even the best explanation fails.
        remains: and above which a part of the gap is said to remain.
        widens: a magnitude is known to so many deviations of its fit, beside what no recording tells of it: deviations
            count errors that last as many.
        lapse: share of the answers that are wrong however sure the evidence is: what the library does not know, or
            knows in another form, may look like something that it knows. Explanations share the rest.
    """

    temperature: float
    stands: float
    rival: float
    fails: float
    remains: float
    widens: float = 2.0
    lapse: float = 0.05
    further: float = 1.0


@cache
def calibration() -> Calibration:
    """As shipped."""
    data = json.loads(resources.files("tiago_mj.gap.decision").joinpath(CALIBRATION).read_text(encoding="utf-8"))
    return Calibration(**{name: float(data[name]) for name in Calibration.__dataclass_fields__})


@cache
def measured_on(name: str) -> int:
    """Number of cases on whose answers a number of the calibration rests."""
    data = json.loads(resources.files("tiago_mj.gap.decision").joinpath(CALIBRATION).read_text(encoding="utf-8"))
    return int(data["calibration"]["carried_by"][name])


@dataclass(frozen=True)
class Option:
    """An explanation as the verdict sees it.

    Attributes:
        effects: by name and targets, without those measured on the readings alone; none for the nominal model.
        classes: of all its effects.
        evidence: for it.
    """

    effects: frozenset[tuple[str, tuple[str, ...] | None]]
    classes: frozenset[str]
    evidence: Evidence


@dataclass(frozen=True)
class Judged:
    """A verdict.

    Attributes:
        kind: ``no_gap``, ``effect``, ``ambiguous`` or ``unknown``.
        probability: of every explanation, up to its classes, (n,); they leave a share to what is none of them.
        rivals: indices of the explanations that are not ruled out, the best first.
        remains: whether a gap is left after the best.
    """

    kind: str
    probability: Array
    rivals: tuple[int, ...]
    remains: bool


def judge(ranked: Ranked, *, strange: bool = False, beaten: NDArray[np.bool_] | None = None) -> Judged:
    """Judge ranked explanations, best first.

    Args:
        ranked: explanations.
        strange: the readings show what no effect of the library does.
        beaten: explanations that are refuted by what they predict of the validation trials, (n,).
    """
    options = [option(fit, ranked) for fit in ranked.fits]
    said = decide(options, calibration(), betrayed=ranked.known > 0, beaten=beaten)
    return replace(said, kind="unknown") if strange else said


def option(fit: Fitted, ranked: Ranked) -> Option:
    """An explanation with its evidence."""
    count = len(fit.parts) - ranked.known
    evidence = Evidence(
        met=fit.evidence - fit.prior,
        price=fit.prior + _log_prior(fit, ranked),
        misfit=fit.misfit,
        lasting=fit.lasting,
        edge=any(part.at_edge(float(v)) for part, v in zip(fit.parts[:count], fit.values, strict=False)),
    )
    return Option(frozenset(part.label for part in fit.parts[:count]), classes_of(fit), evidence)


def decide(
    options: Sequence[Option], by: Calibration, *, betrayed: bool = False, beaten: NDArray[np.bool_] | None = None
) -> Judged:
    """The verdict on explanations.

    Args:
        options: one of them the nominal model.
        by: calibration.
        betrayed: whether an effect was measured on the readings alone, whichever explanation holds.
        beaten: explanations that are refuted, (n,); not all of them. None: none is.
    """
    single = probabilities(options, by, betrayed=betrayed, beaten=beaten)
    classes = [one.classes for one in options]
    pooled = np.array([single[[c == classes[k] for c in classes]].sum() for k in range(len(classes))])
    nominal = next(k for k, one in enumerate(options) if not one.effects)
    best = max((k for k in range(len(single)) if k != nominal), key=lambda k: single[k], default=nominal)
    leaves = left(options[nominal])
    stands = single[nominal] >= (1.0 if leaves > by.remains else by.stands) * single[best]
    if best == nominal or (stands and leaves <= by.fails):
        best, rivals = nominal, [nominal]
    else:
        rivals = _rivals(options, single, by.rival * single[best], nominal)
        fails = bool(rivals) and left(options[rivals[0]]) > by.fails
        if not rivals or single[rivals[0]] < (1.0 if fails else by.rival) * single[nominal]:
            rivals = [nominal]  # which fails, but what fails, too, or hardly stands, is no better
        best = rivals[0]
    if left(options[best]) > by.fails or options[best].evidence.edge:
        kind = "unknown"  # what has to be as large as an effect can be stands for something else
    elif best == nominal and not betrayed:
        kind = "no_gap"
    elif any(classes[k] != classes[best] for k in rivals):
        kind = "ambiguous"
    else:
        kind = "effect"
    return Judged(kind, (1 - by.lapse) * pooled, tuple(rivals), left(options[best]) > by.remains)


def left(one: Option) -> float:
    """What an explanation leaves: errors that last, or that are large."""
    return max(one.evidence.lasting, one.evidence.misfit)


def _refuted(options: Sequence[Option], by: Calibration) -> NDArray[np.bool_]:
    """Explanations that fail where another one stands, which leaves much less, (n,): what is left of an effect that
    they lack looks like few samples, which evidence alone would let pass."""
    lefts = np.array([left(one) for one in options])
    least = min((x for x, one in zip(lefts, options, strict=True) if one.effects), default=np.inf)
    out: NDArray[np.bool_] = (lefts > by.fails) & (least <= by.fails) & (least - 1 < LESS * (lefts - 1))
    return out


def probabilities(
    options: Sequence[Option], by: Calibration, *, betrayed: bool = False, beaten: NDArray[np.bool_] | None = None
) -> Array:
    """Of every explanation, (n,); arguments as of :func:`decide`."""
    temperature = temperature_of([one.evidence.misfit for one in options], by)
    scores = _met(options, by.further, betrayed) / temperature + np.array([one.evidence.price for one in options])
    out_of_it = _refuted(options, by)
    if beaten is not None:  # what stands on the trials that were fitted may fail on the others: these count
        out_of_it = beaten if (out_of_it | beaten).all() else out_of_it | beaten
    scores[out_of_it] = -np.inf
    weights = np.exp(scores - scores.max())
    out: Array = weights / weights.sum()
    return out


def _met(options: Sequence[Option], further: float, betrayed: bool) -> Array:
    """How well explanations meet the recordings [nats], (n,), with less for what a further effect adds to the best by
    fewer, so that of two by as many what meets them better stays ahead. Beside what the readings betray any is one."""
    out = np.array([one.evidence.met for one in options])
    sizes = [len(one.effects) for one in options]
    for k in np.argsort(sizes):
        fewer = [j for j, size in enumerate(sizes) if (size or betrayed) and size < sizes[k]]
        if fewer:
            before = max(fewer, key=lambda j: options[j].evidence.met)
            added = options[k].evidence.met - options[before].evidence.met
            out[k] = out[before] + (added / further if added > 0 else added)
    return out


def temperature_of(misfits: Sequence[float], by: Calibration) -> float:
    """What ``met`` is divided by, given the explanations' misfits.

    What the best one leaves is model error, which counts as often as it is repeated; but where nothing explains the
    recordings, what explains them least badly still goes first.
    """
    return by.temperature * min(max(1.0, min(misfits)), HOTTEST)


def classes_of(fit: Fitted) -> frozenset[str]:
    """Classes of the effects of an explanation."""
    return frozenset(EFFECTS[part.effect].gap_class for part in fit.parts)


def _rivals(options: Sequence[Option], probability: Array, least: float, nominal: int) -> list[int]:
    """What is not ruled out, most probable first; of the same effects on several targets the best."""
    out: dict[frozenset[str], int] = {}
    for k in np.argsort(-probability):
        if k != nominal and probability[k] >= least:
            out.setdefault(frozenset(name for name, _ in options[k].effects), int(k))
    return list(out.values())


def _log_prior(fit: Fitted, ranked: Ranked) -> float:
    """One of the effects is as likely as none; each has its share; one finger's half of both's."""
    count = len(fit.parts) - ranked.known
    parts = fit.parts[:count]
    share = sum(np.log((ANOTHER_EFFECT if k or ranked.known else ONE_EFFECT) / ranked.pool) for k in range(count))
    return float(share + sum(np.log(ONE_TARGET) for part in parts if part.target is not None))
