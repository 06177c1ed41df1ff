"""Verdict with calibrated probabilities from the evidence for explanations.

    log odds = log likelihood / T + log prior

The log likelihood (``met`` of :class:`tiago_mj.gap.result.FitQuality`) is that at the fitted magnitudes and nuisances
[nats]. The log prior (``price``) holds the prior of the nuisances, the Occam factor of the magnitudes and how rare
effects are. The log likelihood that a second effect adds counts for less than that of the first. T, this discount, and
the thresholds are calibrated on simulated recordings whose effect is known: ``verdict.json``, which says how.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import number_of_effects
from tiago_mj.gap.result import Explanation, FitQuality
from tiago_mj.gap.search.state import Ranked

Array = NDArray[np.float64]

#: Prior odds of one effect against none, spread over the library, and of another one beside it; and of one target
#: against all.
PRIOR_ODDS_FIRST_EFFECT: Final = 1.0
PRIOR_ODDS_FURTHER_EFFECT: Final = 0.5
PRIOR_ODDS_SINGLE_TARGET: Final = 0.5
#: An adequate explanation refutes an inadequate one where its discrepancy beyond 1 is less than this share of the
#: other's. Halved and doubled, none of 16 answers about hinges changes (varied.json).
REFUTING_RATIO: Final = 0.6
#: An explanation stands only where the trials agree on its effects at least so far: of 29 hinges with one effect or two
#: (seeds 931 and 932) all right answers had 1; of twelve grasps at 25 Hz two without any effect were given one with
#: 0.77 and 0.88 (seed 941).
MIN_AGREEMENT: Final = 0.9
#: Largest factor by which the temperature rises with the misfit of the best explanation. Halved and doubled, none of
#: 16 answers about hinges changes (varied.json).
MAX_TEMPERATURE_FACTOR: Final = 4.0
CALIBRATION: Final = "verdict.json"
SCHEMA: Final = "tiago_mj.verdict/1"


@dataclass(frozen=True)
class Doubt:
    """Log odds that an answer is wrong however strong the evidence: an effect that the library lacks, or has in another
    form, may look like one that it has.

    Attributes:
        nothing: where nothing is named.
        named: where an effect is.
        several: the same again where more than one is.
        left: for each factor e by which more is left than noise.
        split: for what trials lose by an effect, as a share of what they gain and lose together.
    """

    nothing: float = -3.0
    named: float = -3.0
    several: float = 0.0
    left: float = 0.0
    split: float = 0.0


@dataclass(frozen=True)
class Calibration:
    """Temperature, thresholds and error rates that turn evidence into a verdict.

    Attributes:
        temperature: divisor of the log likelihood: two simulators differ by more than noise, so that their errors are
            not independent draws.
        further: a further divisor of the log likelihood that another effect adds to the best explanation with fewer:
            where the form of one effect differs from reality's, the residual looks like another effect.
        stands: the nominal model stands at this probability over the best explanation's, unless it leaves a gap.
        rival: explanations at least this probable beside the best are not ruled out.
        fails: mean square of the worst channel's error, over blocks or sample by sample, in units of what it should
            scatter by, above which even the best explanation fails.
        remains: and above which a part of the gap is said to remain.
        widens: a magnitude is known to so many deviations of its fit, beside what no recording tells of it: deviations
            count errors that last as many.
        doubt: how many answers are wrong however sure the evidence is; explanations share the rest.
    """

    temperature: float
    stands: float
    rival: float
    fails: float
    remains: float
    widens: float = 2.0
    further: float = 1.0
    doubt: Doubt = Doubt()


@cache
def calibration(*, replays: bool = True) -> Calibration:
    """The calibration that is shipped.

    Args:
        replays: whether commands were replayed; else efforts were compared along a motion.
    """
    data = json.loads(resources.files("tiago_mj.gap.decision").joinpath(CALIBRATION).read_text(encoding="utf-8"))
    return calibration_of(data if replays else data | data.get("along_a_motion", {}))


def calibration_of(data: Mapping[str, Any]) -> Calibration:
    """The calibration of a mapping, as its file holds it."""
    numbers = {name: float(data[name]) for name in Calibration.__dataclass_fields__ if name != "doubt"}
    return Calibration(**numbers, doubt=Doubt(**data["doubt"]))


@cache
def measured_on(name: str, *, replays: bool = True) -> int:
    """Number of cases from which a number of the calibration was determined; ``replays`` as of :func:`calibration`."""
    data = json.loads(resources.files("tiago_mj.gap.decision").joinpath(CALIBRATION).read_text(encoding="utf-8"))
    alone = {} if replays else data["calibration"].get("along_a_motion", {})
    return int({**data["calibration"]["carried_by"], **alone}[name])


@dataclass(frozen=True)
class Option:
    """An explanation as far as the verdict depends on it.

    Attributes:
        effects: by name and targets, without those measured on the readings alone; none for the nominal model.
        classes: of all its effects.
        evidence: for it.
    """

    effects: frozenset[tuple[str, tuple[str, ...] | None]]
    classes: frozenset[str]
    evidence: FitQuality


@dataclass(frozen=True)
class Judged:
    """A verdict: its kind, probabilities and rivals.

    Attributes:
        kind: ``no_gap``, ``effect``, ``ambiguous`` or ``unknown``.
        probability: of every explanation, up to its classes, (n,); they leave a share to what is none of them.
        rivals: indices of the explanations that are not ruled out, the best first.
        remains: whether a gap is left after the best.
        sure: share of the answers like it that are right, however sure the evidence is.
    """

    kind: str
    probability: Array
    rivals: tuple[int, ...]
    remains: bool
    sure: float = 1.0


def judge(ranked: Ranked, *, strange: bool = False, refuted: NDArray[np.bool_] | None = None) -> Judged:
    """Verdict on ranked explanations, best first.

    Args:
        ranked: explanations.
        strange: the readings show what no effect of the library does.
        refuted: explanations that are refuted by what they predict of the validation trials, (n,).
    """
    options = [option(fit, ranked) for fit in ranked.fits]
    by = calibration(replays=ranked.predict.replays)
    said = decide(options, by, measured_on_readings=ranked.known > 0, refuted=refuted)
    return replace(said, kind="unknown") if strange else said


def option(fit: Fitted, ranked: Ranked) -> Option:
    """Effects, classes and evidence of a fit."""
    count = len(fit.parts) - ranked.known
    evidence = FitQuality(
        met=fit.evidence - fit.prior,
        price=fit.prior + _log_prior(fit, ranked),
        misfit=fit.misfit,
        lasting=fit.lasting,
        edge=any(part.at_edge(float(v)) for part, v in zip(fit.parts[:count], fit.values, strict=False)),
        sharp=fit.sharp,
        agreement=fit.agreement,
    )
    return Option(frozenset(part.label for part in fit.parts[:count]), classes_of(fit), evidence)


def decide(
    options: Sequence[Option],
    by: Calibration,
    *,
    measured_on_readings: bool = False,
    refuted: NDArray[np.bool_] | None = None,
) -> Judged:
    """Verdict from the evidence for explanations.

    Args:
        options: one of them the nominal model.
        by: calibration.
        measured_on_readings: whether an effect was measured on the readings alone, whichever explanation holds.
        refuted: explanations that are refuted, (n,); not all of them. None: none is.
    """
    single = probabilities(options, by, measured_on_readings=measured_on_readings, refuted=refuted)
    classes = [one.classes for one in options]
    pooled = np.array([single[[c == classes[k] for c in classes]].sum() for k in range(len(classes))])
    nominal = next(k for k, one in enumerate(options) if not one.effects)
    best = max((k for k in range(len(single)) if k != nominal), key=lambda k: single[k], default=nominal)
    nominal_discrepancy = discrepancy(options[nominal])
    stands = single[nominal] >= (1.0 if nominal_discrepancy > by.remains else by.stands) * single[best]
    if best == nominal or (stands and nominal_discrepancy <= by.fails):
        best, rivals = nominal, [nominal]
    else:
        rivals = _not_ruled_out(options, single, by.rival * single[best], nominal)
        fails = bool(rivals) and discrepancy(options[rivals[0]]) > by.fails
        if not rivals or single[rivals[0]] < (1.0 if fails else by.rival) * single[nominal]:
            rivals = [nominal]  # which fails, but what fails, too, or hardly stands, is no better
        best = rivals[0]
    if discrepancy(options[best]) > by.fails or options[best].evidence.edge:
        kind = "unknown"  # what has to be as large as an effect can be stands for something else
    elif best == nominal and not measured_on_readings:
        kind = "no_gap"
    elif any(classes[k] != classes[best] for k in rivals):
        kind = "ambiguous"
    else:
        kind = "effect"
    sure = 1 - wrong(number_of_effects(options[best].effects), options[best].evidence, by.doubt)
    return Judged(kind, sure * pooled, tuple(rivals), discrepancy(options[best]) > by.remains, sure)


def wrong(effects: int, evidence: FitQuality, by: Doubt) -> float:
    """Probability that an answer of this kind is wrong, however strong the evidence.

    Args:
        effects: how many it names.
        evidence: for it.
        by: calibrated.
    """
    left = max(evidence.lasting, evidence.misfit) if evidence.sharp is None else evidence.sharp
    log_odds = by.left * np.log(max(left, 1.0))
    if effects:
        agreement = 1.0 if evidence.agreement is None else evidence.agreement
        log_odds += by.named + by.several * (effects > 1) + by.split * (1 - agreement)
    else:
        log_odds += by.nothing
    return float(1 / (1 + np.exp(-log_odds)))


def most_probable(one: Explanation, *, replays: bool = True) -> float:
    """Largest probability that an explanation can have, that without any rival; 1 where its evidence is not known.

    Args:
        one: explanation.
        replays: as of :func:`calibration`.
    """
    return 1.0 if one.evidence is None else 1 - wrong(_number(one), one.evidence, calibration(replays=replays).doubt)


def _number(one: Explanation) -> int:
    """Of effects."""
    return number_of_effects((effect.name, None) for effect in one.effects)


def discrepancy(one: Option) -> float:
    """Reduced chi-square of an explanation, per sample or over blocks, whichever is larger (1 is expected)."""
    return max(one.evidence.lasting, one.evidence.misfit)


def _refuted(options: Sequence[Option], by: Calibration) -> NDArray[np.bool_]:
    """Mask of the explanations that fail where another stands with much smaller reduced chi-square, (n,).

    The residual of a missing effect is correlated and counts as few samples, so that evidence alone would not refute
    them.
    """
    discrepancies = np.array([discrepancy(one) for one in options])
    least = min((x for x, one in zip(discrepancies, options, strict=True) if one.effects), default=np.inf)
    out: NDArray[np.bool_] = (
        (discrepancies > by.fails) & (least <= by.fails) & (least - 1 < REFUTING_RATIO * (discrepancies - 1))
    )
    return out


def probabilities(
    options: Sequence[Option],
    by: Calibration,
    *,
    measured_on_readings: bool = False,
    refuted: NDArray[np.bool_] | None = None,
) -> Array:
    """Probability of every explanation, (n,), by softmax of the log odds; arguments as of :func:`decide`."""
    temperature = temperature_of([one.evidence.misfit for one in options], by)
    scores = _discounted_log_likelihood(options, by.further, measured_on_readings) / temperature + np.array(
        [one.evidence.price for one in options]
    )
    ruled_out = _refuted(options, by)
    if refuted is not None:  # what stands on the trials that were fitted may fail on the others: these count
        ruled_out = refuted if (ruled_out | refuted).all() else ruled_out | refuted
    split = np.array([(one.evidence.agreement or 0.0) < MIN_AGREEMENT for one in options])
    split &= [one.evidence.agreement is not None for one in options]
    ruled_out = ruled_out if (ruled_out | split).all() else ruled_out | split
    scores[ruled_out] = -np.inf
    weights = np.exp(scores - scores.max())
    out: Array = weights / weights.sum()
    return out


def _discounted_log_likelihood(options: Sequence[Option], further: float, measured_on_readings: bool) -> Array:
    """Log likelihood of every explanation [nats], (n,), with less for what a further effect adds to the best
    explanation with fewer.

    Among explanations with as many effects the order is kept. With an effect measured on the readings, every other one
    counts as a further effect.
    """
    out = np.array([one.evidence.met for one in options])
    sizes = [number_of_effects(one.effects) for one in options]
    for k in np.argsort(sizes):
        fewer = [j for j, size in enumerate(sizes) if (size or measured_on_readings) and size < sizes[k]]
        if fewer:
            before = max(fewer, key=lambda j: options[j].evidence.met)
            added = options[k].evidence.met - options[before].evidence.met
            out[k] = out[before] + (added / further if added > 0 else added)
    return out


def temperature_of(misfits: Sequence[float], by: Calibration) -> float:
    """Temperature by which log likelihoods are divided, given the reduced chi-squares of the explanations.

    The residual of the best explanation is model error, which is correlated and counts repeatedly, so the temperature
    rises with it; the order of explanations stays.
    """
    return by.temperature * min(max(1.0, min(misfits)), MAX_TEMPERATURE_FACTOR)


def classes_of(fit: Fitted) -> frozenset[str]:
    """Classes of the effects of an explanation."""
    return frozenset(EFFECTS[part.effect].gap_class for part in fit.parts)


def _not_ruled_out(options: Sequence[Option], probability: Array, least: float, nominal: int) -> list[int]:
    """Indices of the explanations with at least the probability ``least``, by decreasing probability; of the same
    effects on several targets the best."""
    out: dict[frozenset[str], int] = {}
    for k in np.argsort(-probability):
        if k != nominal and probability[k] >= least:
            out.setdefault(frozenset(name for name, _ in options[k].effects), int(k))
    return list(out.values())


def _log_prior(fit: Fitted, ranked: Ranked) -> float:
    """Log prior of the effects: prior odds of each, spread over the library, and of a single target against all."""
    parts = fit.parts[: len(fit.parts) - ranked.known]
    count = number_of_effects(part.label for part in parts)
    share = sum(
        np.log((PRIOR_ODDS_FURTHER_EFFECT if k or ranked.known else PRIOR_ODDS_FIRST_EFFECT) / ranked.pool)
        for k in range(count)
    )
    return float(share + sum(np.log(PRIOR_ODDS_SINGLE_TARGET) for part in parts if part.target is not None))
