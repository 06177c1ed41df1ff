"""The motion of the menu that best tells explanations apart which the recordings cannot.

Every explanation is simulated along every motion, at what was fitted. Between the predictions of r, if that is the true
one, and of s lies the distance that remains once s has adjusted its magnitudes δ and the nominal model's numbers ν, as
far as these are uncertain (T-optimality, Atkinson & Fedorov 1975, doi:10.1093/biomet/62.1.57; linearised about s):

    d² = min over δ, ν of |p_r − p_s − J δ − A ν|² + ν'ν        in units of floor and tolerance, thinned.

If r is true, the motion adds evidence for r over s that is normal, d²/2 on average with variance d². A verdict divides
evidence by T and rules s out once it is less probable than a share ρ of r, so that with the probabilities p of today

    P(r rules out s) = Φ((d²/2 − T (log 1/ρ − log p_r/p_s)) / d),

and the expected probability to resolve is Σ p_r max(0, 1 − Σ_s (1 − P(r rules out s))), over s of other classes than r.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from tiago_mj.gap import floor, hypotheses, motions, replay, score
from tiago_mj.gap.effects.spec import Entry
from tiago_mj.gap.fit import NUDGE, REACH, Fitted
from tiago_mj.gap.floor import Data
from tiago_mj.gap.hypotheses import Term
from tiago_mj.gap.motions.menu import OPEN, items
from tiago_mj.gap.plant import Plant
from tiago_mj.gap.predict import Predictor
from tiago_mj.gap.record.motion import Motion, read_motion
from tiago_mj.gap.recording import Trial
from tiago_mj.gap.result import NextMotion
from tiago_mj.gap.traces import MEASURES
from tiago_mj.gap.verdict import RIVAL, TEMPERATURE, classes_of
from tiago_mj.models import names

Array = NDArray[np.float64]
Worth = tuple[int, float]

#: Longest motion that is considered [s], and seconds of motion of all that are looked at closely.
LONGEST: Final = 6.5
CLOSELY: Final = 15.0
#: Explanations that are compared, the most probable first.
RIVALS: Final = 4
#: Errors of a model last for at least so long [s], whatever the recordings' noise: samples in between count once.
CORRELATED: Final = 0.1
#: Fingers that begin farther than this from where the menu's motions begin are opened first [m].
ELSEWHERE: Final = 1e-3
#: A motion is not proposed if the servos would press harder than this share of their limits.
PRESS: Final = 0.85
#: A magnitude may be anywhere within its bounds: weight of its distance, in units of them, beside a nuisance's.
FREE: Final = 1e-6
#: A pair is said to be resolved from this probability on.
LIKELY: Final = 0.5


@dataclass(frozen=True)
class _Tried:
    """A motion with the predictions of the rivals, whitened, (nrivals, n)."""

    file: str
    motion: Motion
    predict: Predictor
    data: Data
    white: Array

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return float(self.motion.time[-1])


def next_motion(
    plant: Plant,
    like: Trial,
    data: Data,
    weight: Array,
    rivals: Sequence[Fitted],
    probability: Sequence[float],
    *,
    seed: int = 0,
    threads: int = 0,
    until: float | None = None,
) -> NextMotion | None:
    """The motion of the menu with the best chance to resolve.

    Args:
        plant: the nominal simulator.
        like: a recording: its object and start are those of the motion; the fingers begin open.
        data: channels and noise of the recordings.
        weight: square root of the share of independent samples of each channel, (C,).
        rivals: explanations, the most probable first.
        probability: of each, up to its classes; only their ratios matter.
        seed: of effects that draw at random.
        threads: of the simulations; the answer does not depend on it.
        until: instant of ``time.monotonic()`` at which the best so far is given.

    Returns:
        The motion; None where the rivals are all of one class, or no motion of the menu fits the robot, or none has any
        chance.
    """
    rivals, share = list(rivals[:RIVALS]), np.array(probability[:RIVALS], dtype=float)
    if len({classes_of(fit) for fit in rivals}) < 2 or plant.relative or not share.sum() > 0:
        return None
    classes = [classes_of(fit) for fit in rivals]
    share = share / [classes.count(c) for c in classes]  # what a class has is shared by its members
    share = share / share.sum()
    weight = np.minimum(weight, np.sqrt(min(plant.period / CORRELATED, 1.0)))
    temperature = TEMPERATURE * max(1.0, min(fit.misfit for fit in rivals))
    terms = [term for term in hypotheses.terms(plant) if not term.per_trial]
    tried: list[tuple[Worth, _Tried]] = []
    plant = _opened(plant, like)
    for file, motion in _applicable(plant):
        if _late(until):
            break
        one = _try(plant, like, data, weight, rivals, terms, file, motion, seed, threads)
        tried.append((_worth(_apart(one), share, temperature, rivals), one))
    tried.sort(key=lambda item: item[0], reverse=True)
    best: tuple[Worth, _Tried, Array] | None = None
    spent = 0.0
    for bound, one in tried:
        # What refitting leaves is at most what there was before it.
        if (best is not None and bound <= best[0]) or spent > CLOSELY or (best is not None and _late(until)):
            break
        if not _safe(plant, one, rivals, terms, seed, threads):
            continue
        spent += one.seconds
        distance = _remaining(one, weight, rivals, terms)
        worth = _worth(distance, share, temperature, rivals)
        if best is None or worth > best[0]:
            best = worth, one, distance
    if best is None or best[0][0] <= 0:
        return None
    chance = _chance(best[2], share, temperature, rivals)
    return NextMotion(best[1].file, _resolved(best[2], share, temperature, rivals), chance)


def _late(until: float | None) -> bool:
    return until is not None and time.monotonic() > until


# Motions -------------------------------------------------------------------------------------------------------------


def _applicable(plant: Plant) -> list[tuple[str, Motion]]:
    """Motions of the menu for the plant's joints and interface, at the rate nearest to its own."""
    rate = min(motions.RATES, key=lambda r: abs(np.log(r * plant.period)))
    out = []
    for item in items():
        if item.interface != plant.wiring.interface or item.seconds > LONGEST:
            continue
        if set(item.shapes) <= set(plant.actuators):
            file = motions.file_name(item.name, rate)
            out.append((file, read_motion(motions.FOLDER / file)))
    return out


def _opened(plant: Plant, like: Trial) -> Plant:
    """The plant with the fingers where the menu's motions begin, unless the trial begins there anyway."""
    start = plant.starts[like.name]
    qpos, set_point = start.qpos.copy(), start.set_point.copy()
    for k, name in enumerate(plant.actuators):
        if name in names.FINGERS and abs(set_point[k] - OPEN) > ELSEWHERE:
            qpos[plant.wiring.qpos[plant.wiring.targets.actuated[k]]] = set_point[k] = OPEN
    return replace(plant, starts={**plant.starts, like.name: replace(start, qpos=qpos, set_point=set_point)})


def _trial(plant: Plant, like: Trial, motion: Motion) -> Trial:
    rate = 1 / plant.period
    steps = motion.steps(rate)
    commands = {name: np.append(values, np.nan) for name, values in motion.at(rate).items()}
    time = np.arange(steps + 1, dtype=np.float64) * plant.period
    return replace(like, time=time, commands=commands)


def _try(
    plant: Plant,
    like: Trial,
    data: Data,
    weight: Array,
    rivals: Sequence[Fitted],
    terms: Sequence[Term],
    file: str,
    motion: Motion,
    seed: int,
    threads: int,
) -> _Tried:
    on = replay.grid(plant, [_trial(plant, like, motion)])
    shape = (1, on.commands.shape[1] + 1, len(data.channels))
    rows = replace(data, value=np.zeros(shape), sigma=np.ones(shape), common=np.zeros(shape))
    predict = Predictor(plant, on, rows, threads, seed)
    predicted = predict.all_trials([(), *(_entries(fit, terms) for fit in rivals)], [0])
    sigma, common = floor.sigma(predicted[0], data.noise, data.channels, plant.period)
    rows = replace(rows, sigma=sigma, common=common)
    white = score.whiten(rows, predicted[1:], weight).reshape(len(rivals), -1)
    return _Tried(file, motion, predict, rows, white)


def _safe(plant: Plant, one: _Tried, rivals: Sequence[Fitted], terms: Sequence[Term], seed: int, threads: int) -> bool:
    """Whether no servo that the motion moves comes near its limit, whichever explanation is true."""
    explanations = [(), *(_entries(fit, terms) for fit in rivals)]
    true = replay.simulate(
        plant, one.predict.on, [(0, effects) for effects in explanations], threads=threads, seed=seed
    )
    moved = [plant.actuators.index(name) for name in one.motion.commands]
    servos = np.array(plant.wiring.actuators)[moved]
    limited = plant.model.actuator_forcelimited[servos] > 0
    limit = np.where(limited, plant.model.actuator_forcerange[servos, 1], np.inf)
    effort = np.abs(true.effort[:, :, np.array(plant.wiring.targets.actuated)[moved]]).max(axis=(0, 1))
    return bool((effort <= PRESS * limit).all())


def _entries(fit: Fitted, terms: Sequence[Term], nudged: int | None = None) -> tuple[Entry, ...]:
    """An explanation with its nuisances, as far as all trials share them; one of them a little further."""
    entries = list(fit.effects())
    for k, term in enumerate(terms):
        deviations = (float(fit.nuisance[k]) if len(fit.nuisance) else 0.0) + (NUDGE if k == nudged else 0.0)
        if deviations:
            entries.append(term.entry(deviations))
    return tuple(entries)


# Distances -----------------------------------------------------------------------------------------------------------


def _apart(one: _Tried) -> Array:
    """Squared distances before refitting, (nrivals, nrivals)."""
    return np.asarray(((one.white[:, None] - one.white[None]) ** 2).sum(axis=-1))


def _remaining(one: _Tried, weight: Array, rivals: Sequence[Fitted], terms: Sequence[Term]) -> Array:
    """Squared distances after the second of a pair was refitted to the first, (nrivals, nrivals)."""
    explanations: list[tuple[Entry, ...]] = []
    steps: list[list[float]] = []  # of each rival: of its magnitudes, in units of their bounds, then of the nuisances
    for fit in rivals:
        steps.append([])
        for k, part in enumerate(fit.parts):
            if part.effect in MEASURES:
                continue  # the readings say by themselves how large it is
            span = part.high - part.low
            step = max(0.02 * abs(float(fit.values[k])), min(float(fit.deviations[k]), 0.1 * span), REACH * span)
            values = fit.values.copy()
            values[k] += step if values[k] + step <= part.high else -step
            steps[-1].append(float(values[k] - fit.values[k]) / span)
            explanations.append(_entries(replace(fit, values=values), terms))
        explanations += [_entries(fit, terms, nudged=k) for k in range(len(terms))]
    predicted = one.predict.all_trials(explanations, [0])
    there = score.whiten(one.data, predicted, weight).reshape(len(explanations), -1)
    here = one.white
    out, used = np.zeros((len(rivals), len(rivals))), 0
    for s, magnitudes in enumerate(steps):
        free = len(magnitudes)
        scale = np.array([*magnitudes, *[NUDGE] * len(terms)])
        columns = ((there[used : used + len(scale)] - here[s]) / scale[:, None]).T
        used += len(scale)
        prior = np.array([*[FREE] * free, *[1.0] * len(terms)])
        difference = (here - here[s]).T
        moved = np.linalg.solve(columns.T @ columns + np.diag(prior), columns.T @ difference)
        out[:, s] = ((difference - columns @ moved) ** 2).sum(axis=0) + (prior[:, None] * moved**2).sum(axis=0)
    return out


# Chances -------------------------------------------------------------------------------------------------------------


def _rules_out(distance: Array, share: Array, temperature: float) -> Array:
    """Chance that a true r rules out s, (nrivals, nrivals)."""
    with np.errstate(divide="ignore"):
        odds = np.log(share[:, None] / share[None, :])
    needed = temperature * (np.log(1 / RIVAL) - odds)
    d = np.sqrt(np.maximum(distance, 1e-12))
    return np.asarray(norm.cdf((distance / 2 - needed) / d))


def _others(rivals: Sequence[Fitted]) -> NDArray[np.bool_]:
    classes = [classes_of(fit) for fit in rivals]
    return np.array([[a != b for b in classes] for a in classes])


def _chance(distance: Array, share: Array, temperature: float, rivals: Sequence[Fitted]) -> float:
    missed = np.where(_others(rivals), 1 - _rules_out(distance, share, temperature), 0.0).sum(axis=1)
    return float(share @ np.maximum(1 - missed, 0.0))


def _worth(distance: Array, share: Array, temperature: float, rivals: Sequence[Fitted]) -> Worth:
    """Chance to resolve, in per mille; of equal ones the larger distance between the pair that is hardest to tell."""
    hardest = np.where(_others(rivals), distance, np.inf).min()
    return round(1000 * _chance(distance, share, temperature, rivals)), float(hardest)


def _resolved(
    distance: Array, share: Array, temperature: float, rivals: Sequence[Fitted]
) -> tuple[tuple[str, str], ...]:
    """Names of what would probably be told apart: what two explanations do not have in common; at least one pair."""
    chance = _rules_out(distance, share, temperature)
    other = _others(rivals)
    pairs = []
    for r in range(len(rivals)):
        for s in range(r + 1, len(rivals)):
            if other[r, s]:
                mean = (share[r] * chance[r, s] + share[s] * chance[s, r]) / (share[r] + share[s])
                pairs.append((float(mean), _name(rivals[r], rivals[s]), _name(rivals[s], rivals[r])))
    pairs.sort(key=lambda pair: -pair[0])
    named = [(a, b) for mean, a, b in pairs if mean >= LIKELY] or [pairs[0][1:]]
    return tuple(dict.fromkeys(named))


def _name(fit: Fitted, rival: Fitted) -> str:
    others = {part.effect for part in rival.parts}
    return next((part.effect for part in fit.parts if part.effect not in others), fit.parts[0].effect)
