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

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.decision.verdict import calibration, classes_of, temperature_of
from tiago_mj.gap.design.rehearse import Rehearsal, rehearse, with_numerics
from tiago_mj.gap.inference import hypotheses, likelihood
from tiago_mj.gap.inference.differenced import MIN_MOVE_SHARE
from tiago_mj.gap.inference.fit import NUISANCE_STEP, Fitted
from tiago_mj.gap.inference.hypotheses import Term
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.result import NextMotion
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Run
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]
Effects = tuple[Entry, ...]
Worth = tuple[int, float]

#: Seconds of motion that are looked at closely, the most promising first.
CLOSELY: Final = 15.0
#: Explanations that are compared, the most probable first.
RIVALS: Final = 4
#: Errors of a model last for at least so long [s], whatever the recordings' noise: samples in between count once.
CORRELATED: Final = 0.1
#: A magnitude may be anywhere within its bounds: weight of its distance, in units of them, beside a nuisance's.
FREE: Final = 1e-6
#: A pair is said to be resolved from this probability on.
LIKELY: Final = 0.5


def next_motion(
    plant: Plant,
    like: Trial,
    data: Data,
    weight: Array,
    options: Sequence[tuple[Fitted, float]],
    how: Run,
) -> NextMotion | None:
    """The motion of the menu with the best chance to resolve.

    Args:
        plant: the nominal simulator.
        like: a recording: its object and start are those of the motion; the fingers begin open.
        data: channels and noise of the recordings.
        weight: square root of the share of independent samples of each channel, (C,).
        options: explanations, each with its probability up to its classes, the most probable first; only the ratios of
            probabilities matter.
        how: simulations are run; its deadline is that of the choice.

    Returns:
        The motion; None where the rivals are all of one class, no motion of the menu fits the robot, or none has any
        chance.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    rivals = [fit for fit, _ in options[:RIVALS]]
    share = np.array([probability for _, probability in options[:RIVALS]], dtype=float)
    if len({classes_of(fit) for fit in rivals}) < 2 or plant.relative or not share.sum() > 0:
        return None
    classes = [classes_of(fit) for fit in rivals]
    share = share / [classes.count(c) for c in classes]  # what a class has is shared by its members
    share = share / share.sum()
    weight = np.minimum(weight, np.sqrt(min(plant.period / CORRELATED, 1.0)))
    temperature = temperature_of([fit.misfit for fit in rivals], calibration())
    terms = [term for term in hypotheses.terms(plant) if not term.per_trial]
    explanations = [_entries(fit, terms) for fit in rivals]
    menu = rehearse(plant, like, data, explanations, how)
    if menu is None or not menu.harmless.any():
        return None
    menu = menu.only(np.nonzero(menu.harmless)[0])
    # What refitting leaves is at most what there was before it.
    bounds = [_worth(distance, share, temperature, rivals) for distance in _apart(menu, weight)]
    closely: list[int] = []
    for k in sorted(range(len(bounds)), key=lambda k: bounds[k], reverse=True):
        if sum(float(menu.motions[j].time[-1]) for j in closely) < CLOSELY:
            closely.append(k)
    menu = with_numerics(menu.only(closely))
    distances = _remaining(menu, weight, rivals, terms)
    worths = [_worth(distance, share, temperature, rivals) for distance in distances]
    best = max(range(len(worths)), key=lambda k: worths[k])
    if worths[best][0] <= 0:
        return None
    chance = _chance(distances[best], share, temperature, rivals)
    return NextMotion(menu.files[best], _resolved(distances[best], share, temperature, rivals), chance)


def _entries(fit: Fitted, terms: Sequence[Term]) -> Effects:
    """An explanation with its nuisances, as far as all trials share them."""
    entries = list(fit.effects())
    for k, term in enumerate(terms):
        if len(fit.nuisance) and fit.nuisance[k]:
            entries.append(term.entry(float(fit.nuisance[k])))
    return tuple(entries)


# Distances -----------------------------------------------------------------------------------------------------------


def _white(menu: Rehearsal, weight: Array, predicted: Array) -> Array:
    """Whitened, (nmotions, nexplanations, n)."""
    white = likelihood.whiten(menu.data, likelihood.mean_visible_change(menu.data, predicted), weight)
    return np.asarray(white.reshape(*white.shape[:2], -1).swapaxes(0, 1))


def _apart(menu: Rehearsal, weight: Array) -> list[Array]:
    """Squared distances before refitting, (nrivals, nrivals), by motion."""
    return [((p[:, None] - p[None]) ** 2).sum(axis=-1) for p in _white(menu, weight, menu.predicted)]


def _remaining(menu: Rehearsal, weight: Array, rivals: Sequence[Fitted], terms: Sequence[Term]) -> list[Array]:
    """Squared distances after the second of a pair was refitted to the first, (nrivals, nrivals), by motion.

    The responses to nuisances are those of the nominal simulator.
    """
    explanations: list[Effects] = []
    owner: list[int] = []
    scale: list[float] = []  # steps of magnitudes, in units of their bounds, then of the nuisances
    for r, fit in enumerate(rivals):
        for k, part in enumerate(fit.parts):
            if EFFECTS[part.effect].shows_as:
                continue  # the readings say by themselves how large it is
            span = part.high - part.low
            step = max(
                0.02 * abs(float(fit.values[k])), min(float(fit.deviations[k]), 0.1 * span), MIN_MOVE_SHARE * span
            )
            values = fit.values.copy()
            values[k] += step if values[k] + step <= part.high else -step
            explanations.append(_entries(replace(fit, values=values), terms))
            owner.append(r)
            scale.append(float(values[k] - fit.values[k]) / span)
    magnitudes = len(owner)
    explanations += [(term.entry(NUISANCE_STEP),) for term in terms]
    owner += [len(rivals)] * len(terms)
    scale += [NUISANCE_STEP] * len(terms)
    prior = np.array([*[FREE] * magnitudes, *[1.0] * len(terms)])
    out = []
    from_here = np.concatenate([menu.predicted, menu.nominal[None]])
    for here, there in zip(
        _white(menu, weight, from_here), _white(menu, weight, menu.predict(explanations)), strict=True
    ):
        columns = ((there - here[owner]) / np.array(scale)[:, None]).T
        distance = np.zeros((len(rivals), len(rivals)))
        for s in range(len(rivals)):
            own = [k for k in range(len(owner)) if k >= magnitudes or owner[k] == s]
            response, weights = columns[:, own], prior[own]
            difference = (here[: len(rivals)] - here[s]).T
            moved = np.linalg.solve(response.T @ response + np.diag(weights), response.T @ difference)
            left = difference - response @ moved
            distance[:, s] = (left**2).sum(axis=0) + (weights[:, None] * moved**2).sum(axis=0)
        out.append(distance)
    return out


# Chances -------------------------------------------------------------------------------------------------------------


def _rules_out(distance: Array, share: Array, temperature: float) -> Array:
    """Chance that a true r rules out s, (nrivals, nrivals)."""
    with np.errstate(divide="ignore"):
        odds = np.log(share[:, None] / share[None, :])
    needed = temperature * (np.log(1 / calibration().rival) - odds)
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
