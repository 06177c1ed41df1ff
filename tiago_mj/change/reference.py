"""The set of recordings that the nominal model explains better, and its explanation: what both sets have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.compared import Compared
from tiago_mj.gap.detectors import readings
from tiago_mj.gap.detectors.readings import Known
from tiago_mj.gap.inference import hypotheses, likelihood, noise_model
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.search import beginning, ranking, select
from tiago_mj.gap.search.state import Question
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.io.deadline import Deadline

Array = NDArray[np.float64]

#: Trials of each set that the common explanation is fitted to: it is not what is asked for. Halved and doubled, none
#: of 12 answers about pairs of sessions changes (varied_pairs.json).
FITTED_TRIALS: Final = 4
#: Share of a diagnosis's physics steps that its search may take. Halved and doubled, none of 12 answers about pairs
#: of sessions changes (varied_pairs.json).
SHARE: Final = 0.4
#: Effects that both sets are said to have at most. Halved and doubled, none of 12 answers about pairs of sessions
#: changes (varied_pairs.json).
MOST: Final = 2


@dataclass(frozen=True)
class Reference:
    """What both sets have in common.

    Attributes:
        trials: indices of the reference set.
        fit: its explanation.
        common: that as effects: what was found, and the nominal model's own numbers as they were fitted.
        found: of these what was found.
        question: what was asked of the reference set.
        sought: whether effects were sought in it.
        delivered: where both sets lose commands, those that arrived, (ntrials, T - 1, nactuators) of all trials.
    """

    trials: Subset
    fit: Fitted
    common: tuple[Entry, ...]
    found: tuple[Entry, ...]
    question: Question
    sought: bool = False
    delivered: Array | None = None

    @property
    def explained(self) -> bool:
        """Whether its explanation leaves nothing to explain."""
        return ranking.is_adequate(self.fit)


def question(compared: Compared, trials: Subset, deadline: Deadline) -> Question:
    """What explains some of the trials, beside the nominal model. Which commands were lost is decoded for all."""
    predict, proposed = compared.predict, compared.proposed
    base = predict.all_trials([()], trials)[0]
    steps = replay.physics_steps(compared.session.plant, predict.on) if predict.replays else base.shape[1]
    return Question(
        replace(predict, deadline=deadline),
        noise_model.select_trials(proposed.data, trials),
        trials,
        proposed.pool,
        hypotheses.terms(compared.session.plant),
        base,
        measured_on_readings(compared, trials),
        proposed.servo_motion,
        steps,
        beyond=False,
    )


def measured_on_readings(compared: Compared, trials: Sequence[int]) -> tuple[Known, ...]:
    """Effects that the readings of some trials show by themselves; none along a motion."""
    predict, plant = compared.predict, compared.session.plant
    if not predict.replays:
        return ()
    base = predict.all_trials([()], trials)[0]
    part = noise_model.select_trials(predict.data, trials)
    hums = {tone.channel for tone in compared.proposed.tones}
    marks = [mark for mark in readings.of_channels(plant, part, base) if mark.channel not in hums]
    return readings.measured_on_readings(marks, compared.proposed.pool)


def nominal(compared: Compared, sets: Sequence[Sequence[int]], deadline: Deadline) -> list[Reference]:
    """Each set as the reference: the nominal model with its own numbers fitted to :data:`FITTED_TRIALS` of it."""
    out = []
    for trials in sets:
        asked = question(compared, Subset.of(spread(trials, FITTED_TRIALS)), deadline)
        state = beginning.with_nominal(beginning.fitter(asked, deadline.over)[0], asked.first_trials)
        own = _own_numbers(state.full.terms, state.nominal)
        out.append(Reference(Subset.of(trials), state.nominal, own, (), asked))
    return out


def better_explained(sides: Sequence[Reference]) -> int:
    """Which of the sets is explained better: by what is left; where nothing is left of either, by fewer effects, and
    then by the prior probability of the numbers that explain it.

    What is left below :data:`tiago_mj.gap.search.ranking.ADEQUATE_DISCREPANCY` is noise, and tells nothing. A hinge
    whose damping had grown by 0.1 N·m·s/rad left 0.353 with own numbers up to 1.9 deviations off, and before that
    0.369 with numbers up to 0.4 off (seed 4141, pair 56).
    """

    def badness(side: Reference) -> tuple[float, int, float]:
        left = max(ranking.discrepancy(side.fit), ranking.ADEQUATE_DISCREPANCY)
        return left, ranking.size(side.fit), -side.fit.prior

    return min(range(len(sides)), key=lambda k: badness(sides[k]))


def searched(known: Reference, deadline: Deadline) -> Reference:
    """What both sets have in common, where the nominal model does not explain the reference set: what a diagnosis finds
    in it, whether that explains all of it or not. The rest is what the model gets wrong of both. Unchanged where the
    nominal model explains it, or this was sought before."""
    if known.explained or known.sought:
        return known
    asked = replace(known.question, share=SHARE, most=MOST, already=known.question.predict.tally["physics_steps"])
    ranked = select.select(asked, deadline=deadline)
    best = ranking.by_evidence(ranked.fits)[0]
    terms = tuple(sorted(asked.terms, key=lambda term: term.per_trial))
    own = _own_numbers(terms, best)
    loses = any(EFFECTS[entry.name].loses_commands for entry in best.effects())
    delivered = ranked.predict.on.delivered if loses else None
    common = (*best.effects(), *own)
    return replace(known, fit=best, common=common, found=best.effects(), sought=True, delivered=delivered)


def _own_numbers(terms: Sequence[hypotheses.Term], fit: Fitted) -> tuple[Entry, ...]:
    """The nominal model's own numbers that all trials share, as they were fitted."""
    shared = [term for term in terms if not term.per_trial]
    return tuple(term.entry(float(d)) for term, d in zip(shared, fit.nuisance, strict=False) if d)


def spread(trials: Sequence[int], count: int) -> list[int]:
    """At most so many of the trials, evenly spread over them."""
    picked = np.unique(np.linspace(0, len(trials) - 1, min(count, len(trials))).round().astype(int))
    return [trials[k] for k in picked]


def with_what_is_left(data: Data, residual: Array, trials: Sequence[int]) -> Data:
    """With a tolerance, in all trials, of what the common explanation leaves of the reference set.

    Args:
        data: measured, of all trials.
        residual: measured less the common explanation, (ntrials, T, C).
        trials: of the reference set.
    """
    some, left = noise_model.select_trials(data, trials), residual[list(trials)]
    square = np.nan_to_num(likelihood.scaled(some, left) ** 2)
    known = np.isfinite(some.value)
    apart = np.maximum((square.sum(axis=(0, 1)) / np.maximum(known.sum(axis=(0, 1)), 1)) - 1, 0.0)
    lasting = np.maximum(np.nan_to_num(likelihood.lasting(some, left)) - 1, 0.0)
    rms = np.sqrt(np.nanmean(np.where(known, some.sigma**2, np.nan), axis=(0, 1)))
    means = np.sqrt(lasting) * np.sqrt(data.noise**2 / data.block + np.nanmean(some.common**2, axis=(0, 1)))
    alike = np.minimum(means, np.sqrt(apart) * rms) if data.block > 1 else means * 0
    return replace(
        data,
        sigma=np.sqrt(data.sigma**2 + apart * rms**2),
        common=np.sqrt(data.common**2 + alike**2),
    )
