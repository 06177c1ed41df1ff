"""Beside the best explanations another effect is sought: rounds of pairs and of triples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.search import extend, refinement, shortlist, starts
from tiago_mj.gap.search.screen import Screened

Array = NDArray[np.float64]

#: Explanations that are extended by another effect, and number of extensions that are fitted to all trials. Chosen by
#: hand; no ablation.
MAX_SEEDS: Final = 3
MAX_REFITTED_EXTENSIONS: Final = 3
#: Where an explanation is adequate, another effect is fitted beside it only where its predicted gain exceeds this
#: [nats]. Chosen by hand; no ablation.
MIN_GAIN_BESIDE_ADEQUATE_NATS: Final = 15.0
#: Explanations that are refitted when the sample weights change; the others are only reevaluated. Chosen by hand; no
#: ablation.
MAX_REFITTED: Final = 2
#: Largest discrepancy at which a single effect counts as adequate, above that of the nominal model because its form is
#: not exactly that of a real effect. Chosen by hand; no ablation.
ADEQUATE_SINGLE_DISCREPANCY: Final = 1.5
#: Smallest weight of a sample (square root) while another effect is sought: half of that of uncorrelated samples.
#: Residuals beside an explanation that lacks an effect are correlated by that effect, not by model error. Chosen by
#: hand; no ablation.
MIN_WEIGHT_WHILE_UNEXPLAINED: Final = 0.5 / refinement.SAMPLES_PER_INDEPENDENT**0.5


@dataclass(frozen=True)
class Search:
    """Where a search stands.

    Attributes:
        few: fits to the trials of the first pass.
        everywhere: fits to all trials.
        fits: explanations of all trials.
        at: nominal numbers of the nominal model at its best, as :attr:`everywhere` has them.
        here: the nominal model in the first pass.
        base: its prediction there, (ntrials, T, C).
    """

    few: Fitter
    everywhere: Fitter
    fits: list[Fitted]
    at: Array
    here: Point
    base: Array

    def with_weight(self, weight: Array) -> Search:
        """This search with other sample weights, (C,); explanations that were fitted before keep their evidence."""
        few, everywhere = replace(self.few, weight=weight), replace(self.everywhere, weight=weight)
        return replace(self, few=few, everywhere=everywhere)

    def best(self) -> Fitted:
        """The best explanation."""
        return shortlist.by_evidence(self.fits)[0]


def is_warranted(search: Search, size: int) -> bool:
    """Whether explanations by ``size`` effects are sought: not where the best one explains hardly more than the nominal
    model and leaves no gap, and three effects only where the best two leave a gap."""
    best = search.best()
    if best.evidence - shortlist.best_nominal(
        search.fits
    ).evidence < extend.MIN_PREDICTED_GAIN_NATS and not refinement.leaves_gap(best):
        return False
    return size == 2 or (refinement.leaves_gap(best) and len(best.parts) == size - 1)


def with_further_effect(search: Search, size: int, promising: Sequence[Screened]) -> Search | None:
    """The search with explanations by so many effects, found beside those by one less; None where nothing promises
    anything.

    Beside what an effect leaves out errors last, so that samples tell little; beside all that acts they need not. So
    pairs are sought as if samples told more, and all is judged by what they tell beside the best that was found.
    """
    weight, out_of_time = search.everywhere.weight, search.everywhere.out_of_time
    upweighted = search.with_weight(np.maximum(weight, MIN_WEIGHT_WHILE_UNEXPLAINED))
    found = _explanations_of_size(upweighted, size, promising)
    if not found:
        return None
    leader = shortlist.by_evidence([f for f in found if len(f.parts) == size] or found)[0]
    prediction = search.everywhere.predictions([starts.point_of(leader)])[0]
    search = search.with_weight(np.maximum(weight, refinement.sample_weight(search.everywhere.data, prediction)))
    everywhere, fits = search.everywhere, search.fits
    if not np.allclose(everywhere.weight, weight):
        fits = _reweighted(everywhere, shortlist.by_evidence(refinement.nominal_and_best(fits)))
    fits = [*fits, *_reweighted(everywhere, found)]
    if not out_of_time():
        fits = refinement.relinearized(everywhere, fits, size)
    if not out_of_time():
        fits += refinement.refined(everywhere, [f for f in fits if len(f.parts) == size], fits)
    fits += everywhere.fit_all([] if out_of_time() else starts.absorbed_by_nuisances(fits, everywhere))
    return replace(search, fits=fits)


def _expected_to_add(on_few: Sequence[Fitted], seed: Fitted, few: Fitter, everywhere: Fitter) -> bool:
    """Whether the best explanation of some trials by one more effect can be expected to add what makes it worth showing
    when all trials are met as well; by what samples tell beside it."""
    if not on_few or not set(few.trials) <= set(everywhere.trials):
        return bool(on_few)
    rows = [everywhere.trials.index(trial) for trial in few.trials]
    prediction = few.predictions([starts.point_of(on_few[0])])[0]
    few = replace(few, weight=np.maximum(few.weight, refinement.sample_weight(few.data, prediction)))
    alone = Start(seed.parts, seed.values, everywhere.of(rows, seed.nuisance))
    more, fewer = few.fit_all([starts.restart(on_few[0]), alone])
    times = len(everywhere.trials) / len(few.trials)
    return (
        shortlist.extrapolated_evidence(more, times)
        > shortlist.extrapolated_evidence(fewer, times) + shortlist.MIN_EVIDENCE_GAIN_NATS
    )


def _reweighted(everywhere: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations, best first, by what samples count for here: the best fitted anew, the others where they are."""
    where_they_are = replace(everywhere, iterations=0)
    restarts = [starts.restart(f) for f in fits]
    return everywhere.fit_all(restarts[:MAX_REFITTED]) + where_they_are.fit_all(restarts[MAX_REFITTED:])


def _explanations_of_size(search: Search, size: int, promising: Sequence[Screened]) -> list[Fitted]:
    """Explanations by so many effects, and by fewer of theirs, fitted to all trials, the likeliest first."""
    few, everywhere, at = search.few, search.everywhere, search.at
    frame, best = refinement.frame(few, search.here), search.best()
    adequate = bool(best.parts) and refinement.is_adequate(best, ADEQUATE_SINGLE_DISCREPANCY)
    seeds = shortlist.unique_by_classes([f for f in shortlist.by_evidence(search.fits) if len(f.parts) == size - 1])
    seeds = seeds[: 1 if adequate else MAX_SEEDS]
    tried = extend.extensions(
        few, frame, seeds, promising, MIN_GAIN_BESIDE_ADEQUATE_NATS if adequate else extend.MIN_PREDICTED_GAIN_NATS
    )
    if size == 2 and not adequate:
        tried = extend.unique_by_labels([*extend.superposed_pairs(frame, search.base, promising), *tried])
    on_few = few.fit_all(tried)
    others = [s.candidate for s in promising]
    if seeds:
        on_few += extend.with_sensor_effect(few, everywhere, seeds[0], others)
    on_few = shortlist.unique_by_labels(shortlist.by_evidence(on_few))
    if seeds and not refinement.leaves_gap(seeds[0]) and not _expected_to_add(on_few, seeds[0], few, everywhere):
        return []
    extended = [starts.start_on_all_trials(f, everywhere, at) for f in on_few[:MAX_REFITTED_EXTENSIONS]]
    found: list[Fitted] = []
    if seeds:
        on_worst_trials = (
            [] if adequate else extend.with_effect_on_worst_trials(everywhere, seeds[0], len(few.trials), others, at)
        )
        extended = extend.unique_by_labels(
            [*on_worst_trials, *extended, *starts.starts_on_far_nuisances(seeds[0], everywhere, others)]
        )
        if not adequate and starts.with_zero_nuisances(
            seeds[0].values, at
        ):  # what they were moved for may be the other effect
            zeros = np.zeros_like(at)
            there = everywhere.linearized_at(Point(seeds[0].parts, seeds[0].values, zeros))
            found += there.fit_all(extend.with_effect_on_worst_trials(there, seeds[0], len(few.trials), others, zeros))
    found += everywhere.fit_all(extended)
    if not found:
        return []
    found += everywhere.fit_all(starts.without_insignificant(found))
    leader = shortlist.by_evidence(found)[0]
    alone = starts.leave_one_out(leader, [*search.fits, *found])
    found += everywhere.fit_all([*alone, *starts.on_all_targets(leader, everywhere)])
    return shortlist.unique_by_labels(shortlist.by_evidence(found))
