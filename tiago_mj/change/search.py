"""Explanations of a change, ranked by evidence: the search of a diagnosis, with effects that act in one set alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.change.fitters import DifferenceFitter, JointFitter, differences
from tiago_mj.change.reference import Reference, better_explained, nominal, searched, spread, with_what_is_left
from tiago_mj.effects import EFFECTS
from tiago_mj.gap.analysis import promises
from tiago_mj.gap.compared import Compared
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.inference import hypotheses, likelihood, noise_model
from tiago_mj.gap.inference.fit import NUISANCE_STEP, Start
from tiago_mj.gap.search import beginning, ranking, select
from tiago_mj.gap.search.screen import worst_predicted
from tiago_mj.gap.search.state import MIN_WEIGHT_WHILE_UNEXPLAINED, Question, Ranked
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.io.deadline import Deadline
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]

#: Makes a fitter of a change (:data:`tiago_mj.gap.search.select.Begin`).
Begin = Callable[[Question, Callable[[], bool]], tuple[JointFitter | DifferenceFitter, NDArray[np.bool_]]]

#: Commands are repeated where they differ by no more than this share of their range, and rows by this [s].
SAME_COMMANDS: Final = 1e-6
SAME_ROWS: Final = 2e-3
#: Trials of each set that changes are fitted to. Halved and doubled, none of 12 answers about pairs of sessions
#: changes (varied_pairs.json).
FITTED_TRIALS: Final = 5
#: Share of a diagnosis's physics steps that the search for a change may take: a comparison has two searches, and is
#: to take seconds, too. Halved and doubled, none of 12 answers about pairs of sessions changes (varied_pairs.json).
SHARE: Final = 0.4
#: Effects that may have changed at once. Halved and doubled, none of 12 answers about pairs of sessions changes
#: (varied_pairs.json).
MOST: Final = 2


@dataclass(frozen=True)
class Found:
    """What a search for a change has found.

    Attributes:
        ranked: explanations of the change, the one without any among them.
        paired: how many pairs of recordings repeat the same commands.
        fitter: of the sets.
    """

    ranked: Ranked
    paired: int
    fitter: JointFitter | DifferenceFitter

    @property
    def explained(self) -> bool:
        """Whether the best explanation of the difference leaves nothing to explain."""
        best = ranking.by_evidence(self.ranked.fits)[0]
        return ranking.is_adequate(best, ranking.ADEQUATE_WITH_EFFECTS if best.parts else ranking.ADEQUATE_DISCREPANCY)

    @property
    def fails(self) -> bool:
        """Whether the best explanation fails, as a verdict judges it, and does not take up the larger part of the
        difference either."""
        fits = self.ranked.fits
        left = ranking.discrepancy(ranking.by_evidence(fits)[0])
        nothing = ranking.discrepancy(next(fit for fit in fits if not fit.parts))
        most = verdict.calibration(replays=self.ranked.predict.replays).fails
        return left > most and left >= (1 - promises.LARGER_PART) * nothing


def repeated(trials: Sequence[Trial], one: Sequence[int], other: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of trials of two sets that have the same commands, each trial in one pair at most."""
    free, out = list(other), []
    for k in one:
        match = next((j for j in free if _same_commands(trials[k], trials[j])), None)
        if match is not None:
            free.remove(match)
            out.append((k, match))
    return out


def _same_commands(one: Trial, other: Trial) -> bool:
    if not one.commands or set(one.commands) != set(other.commands) or len(one.time) != len(other.time):
        return False
    if np.abs(np.diff(one.time) - np.diff(other.time)).max(initial=0.0) > SAME_ROWS:
        return False
    for name, sent in one.commands.items():
        again = other.commands[name]
        size = np.nanmax(np.abs(sent), initial=0.0) if np.isfinite(sent).any() else 0.0
        if not np.allclose(sent, again, rtol=0, atol=SAME_COMMANDS * size, equal_nan=True):
            return False
    return True


def explained(compared: Compared, sets: Sequence[Sequence[int]], deadline: Deadline) -> tuple[int, Reference, Found]:
    """What explains the difference of two sets: which is the reference, what both have in common, the explanations.

    Differences of recordings of the same commands need no explanation of what both have, as long as something explains
    the differences; all else does. A change is what more acts in the other set than in the reference, and many effects
    have one sign: where no change explains the larger part beside the better explained set, the other is the reference.

    Args:
        compared: both sets beside the nominal model.
        sets: indices of their trials.
        deadline: of the search.
    """
    sides = nominal(compared, sets, deadline)
    better = better_explained(sides)
    if not sides[better].explained:
        for k in (better, 1 - better):
            if _paired(compared, sides[k], sets[1 - k]):
                found = changes(compared, sides[k], sets[1 - k], deadline, most=1)
                if found.explained:
                    return k, sides[k], found
                if not found.fails:
                    break
        sides[better] = searched(sides[better], deadline)
    found = changes(compared, sides[better], sets[1 - better], deadline, most=MOST)
    if not found.fails or deadline.over():
        return better, sides[better], found
    other = searched(sides[1 - better], deadline)
    again = changes(compared, other, sets[better], deadline, most=MOST)
    return (better, sides[better], found) if again.fails else (1 - better, other, again)


def _paired(compared: Compared, known: Reference, changed: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of trials of both sets that repeat the same commands; none where most of the set has no partner, or where
    commands are lost: each recording has its own losses, and what is not decoded of them does not cancel."""
    if known.delivered is not None:
        return []
    pairs = repeated(compared.session.trials, changed, known.trials) if compared.predict.replays else []
    return pairs if 2 * len(pairs) >= len(changed) else []


def changes(
    compared: Compared, known: Reference, changed: Sequence[int], deadline: Deadline, *, most: int = 1
) -> Found:
    """What explains the difference of a set of trials from the reference set.

    Args:
        compared: both sets beside the nominal model.
        known: what they have in common.
        changed: indices of the other set.
        deadline: of the search.
        most: effects of one explanation at most.
    """
    predict, trials = replace(compared.predict, deadline=deadline), compared.session.trials
    pool = tuple(replace(candidate, tolerance=0.0) for candidate in compared.proposed.pool)
    if known.delivered is not None:  # and how many were lost in each set is counted (lost.counted)
        predict = predict.with_delivered(known.delivered)
        pool = tuple(candidate for candidate in pool if not EFFECTS[candidate.effect].loses_commands)
    pairs = _paired(compared, known, changed)
    everything = list(range(len(trials)))
    common = predict.all_trials([known.common], everything, keep=True)[0]
    data = compared.proposed.data
    steps = replay.physics_steps(compared.session.plant, predict.on) if predict.replays else data.value.shape[1]
    limits: Any = {
        "steps": steps,
        "already": predict.tally["physics_steps"],
        "beyond": False,
        "share": SHARE,
        "most": most,
    }
    terms, motion = hypotheses.terms(compared.session.plant), compared.proposed.servo_motion
    if pairs:
        pairs = [pairs[k] for k in spread(range(len(pairs)), FITTED_TRIALS)]
        apart = differences(data, common, pairs)
        one, other = (Subset.of(pair[k] for pair in pairs) for k in (0, 1))
        asked = Question(predict, apart, one, pool, (), common[one] - common[other], motion=motion, **limits)
        begin = _of_differences(dict(pairs), known)
    else:
        residual = likelihood.residual(data, common)
        wide = with_what_is_left(data, residual, known.trials)
        mine = Subset.of(sorted([*spread(known.trials, FITTED_TRIALS), *spread(changed, FITTED_TRIALS)]))
        part = noise_model.select_trials(wide, mine)
        asked = Question(predict, part, mine, pool, terms, common[mine], motion=motion, **limits)
        begin = _of_both(frozenset(changed), known)
    ranked = select.select(asked, deadline=deadline, begin=begin)
    fitter, _ = begin(asked, deadline.over)
    return Found(ranked, len(pairs), replace(fitter, weight=ranked.weight))


def gains_of_change(found: Found, which: Sequence[int]) -> list[float]:
    """By how much the evidence for each of some changes exceeds that for the same effects in both sets [nats].

    A set that moves more may show what both have. Both are fitted with equal effort to the same recordings.

    Args:
        found: of the search.
        which: indices of explanations.
    """
    fits = [found.ranked.fits[k] for k in which]
    begin = [Start(fit.parts, fit.values) for fit in fits]
    changed, both = (fitter.fit_all(begin) for fitter in (found.fitter, found.fitter.of_both()))
    return [one.evidence - other.evidence for one, other in zip(changed, both, strict=True)]


def _of_differences(partner: dict[int, int], known: Reference) -> Begin:
    """Makes the fitter of differences."""

    def begin(asked: Question, over: Callable[[], bool]) -> tuple[JointFitter | DifferenceFitter, NDArray[np.bool_]]:
        chosen = worst_predicted(asked.base, asked.data, asked.fitted_trials)
        data, base = noise_model.select_trials(asked.data, chosen), asked.base[chosen]
        trials = asked.trials.at(chosen)
        weight = np.maximum(ranking.sample_weight(data, base), MIN_WEIGHT_WHILE_UNEXPLAINED)
        fitter = DifferenceFitter(
            asked.predict,
            trials,
            data,
            weight,
            (),
            np.zeros((0, *data.value.shape)),
            known.common,
            out_of_time=over,
            partner=partner,
        )
        return fitter, np.zeros(0, dtype=bool)

    return begin


def _of_both(changed: frozenset[int], known: Reference) -> Begin:
    """Makes the fitter of both sets, with the trials of each that are predicted worst, and the nuisances to which they
    are sensitive."""

    def begin(asked: Question, over: Callable[[], bool]) -> tuple[JointFitter | DifferenceFitter, NDArray[np.bool_]]:
        rows: list[int] = []
        for mine in (True, False):
            index = [k for k, trial in enumerate(asked.trials) if (trial in changed) is mine]
            some = noise_model.select_trials(asked.data, index)
            rows += [index[k] for k in worst_predicted(asked.base[index], some, asked.fitted_trials)]
        rows = sorted(rows)
        data, base = noise_model.select_trials(asked.data, rows), asked.base[rows]
        trials = asked.trials.at(rows)
        terms = tuple(sorted(asked.terms, key=lambda term: term.per_trial))
        weight = ranking.sample_weight(data, base)
        moved = asked.predict.all_trials([(*known.common, term.entry(NUISANCE_STEP)) for term in terms], trials)
        responses = (moved - base) / NUISANCE_STEP
        white = likelihood.whiten(data, likelihood.mean_visible_change(data, responses), weight)
        sensitive = (white**2).sum(axis=(1, 2, 3)) > 2 * beginning.NEAR_ZERO_RESPONSE_NATS
        shared = sensitive[[not term.per_trial for term in terms]]
        fitter = JointFitter(
            asked.predict,
            trials,
            data,
            weight,
            tuple(term for term, tells in zip(terms, sensitive, strict=True) if tells),
            responses[sensitive],
            known.common,
            out_of_time=over,
            changed=changed,
        )
        return fitter, shared

    return begin
