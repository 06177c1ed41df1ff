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

#: Explanations that are extended by another effect, and their extensions that are fitted to all trials.
SEEDS: Final = 3
EXTENSIONS_AGAIN: Final = 3
#: Where an explanation leaves nothing to explain, another effect beside it must promise so much more [nats].
PLENTY: Final = 15.0
#: Explanations that are fitted anew where samples count for something else.
ANEW: Final = 2
#: What a single effect may leave for another one beside it to have to promise plenty: its form is not quite that of any
#: real one.
ENOUGH: Final = 1.5
#: What is correlated in time beside an explanation that lacks an effect is that effect, and no error of the simulator:
#: while another one is sought, samples count for so much at least (square root), half of what those of an explanation
#: that stands do.
UNEXPLAINED: Final = 0.5 / refinement.REPEATED**0.5


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

    def counting(self, weight: Array) -> Search:
        """The same with samples that count for something else; what was fitted before is not judged anew."""
        few, everywhere = replace(self.few, weight=weight), replace(self.everywhere, weight=weight)
        return replace(self, few=few, everywhere=everywhere)

    def likeliest(self) -> Fitted:
        """The best explanation."""
        return shortlist.ordered(self.fits)[0]


def worthwhile(search: Search, size: int) -> bool:
    """Whether explanations by so many effects are sought: where one effect hardly explains more than none, two would
    not be believed, and a third only where two leave a gap."""
    best = search.likeliest()
    if best.evidence - shortlist.nominal(search.fits).evidence < extend.PROMISES and not refinement.fails(best):
        return False
    return size == 2 or (refinement.fails(best) and len(best.parts) == size - 1)


def with_another(search: Search, size: int, promising: Sequence[Screened]) -> Search | None:
    """The search with explanations by so many effects, found beside those by one less; None where nothing promises
    anything.

    Beside what an effect leaves out errors last, so that samples tell little; beside all that acts they need not. So
    pairs are sought as if samples told more, and all is judged by what they tell beside the best that was found.
    """
    weight, out_of_time = search.everywhere.weight, search.everywhere.out_of_time
    hoping = search.counting(np.maximum(weight, UNEXPLAINED))
    found = _found(hoping, size, promising)
    if not found:
        return None
    leader = shortlist.ordered([f for f in found if len(f.parts) == size] or found)[0]
    left = search.everywhere.predictions([starts.point(leader)])[0]
    search = search.counting(np.maximum(weight, refinement.counts(search.everywhere.data, left)))
    everywhere, fits = search.everywhere, search.fits
    if not np.allclose(everywhere.weight, weight):
        fits = _judged(everywhere, shortlist.ordered(refinement.again(fits)))
    fits = [*fits, *_judged(everywhere, found)]
    if not out_of_time():
        fits = refinement.renewed(everywhere, fits, size)
    if not out_of_time():
        fits += refinement.refined(everywhere, [f for f in fits if len(f.parts) == size], fits)
    fits += everywhere.fit_all([] if out_of_time() else starts.absorbed(fits, everywhere))
    return replace(search, fits=fits)


def _adds(on_few: Sequence[Fitted], seed: Fitted, few: Fitter, everywhere: Fitter) -> bool:
    """Whether the best explanation of some trials by one more effect can be expected to add what makes it worth showing
    when all trials are met as well; by what samples tell beside it."""
    if not on_few or not set(few.trials) <= set(everywhere.trials):
        return bool(on_few)
    rows = [everywhere.trials.index(trial) for trial in few.trials]
    left = few.predictions([starts.point(on_few[0])])[0]
    few = replace(few, weight=np.maximum(few.weight, refinement.counts(few.data, left)))
    alone = Start(seed.parts, seed.values, everywhere.of(rows, seed.nuisance))
    more, fewer = few.fit_all([starts.again(on_few[0]), alone])
    times = len(everywhere.trials) / len(few.trials)
    return shortlist.expected(more, times) > shortlist.expected(fewer, times) + shortlist.ADDS


def _judged(everywhere: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Explanations, best first, by what samples count for here: the best fitted anew, the others where they are."""
    where_they_are = replace(everywhere, iterations=0)
    again = [starts.again(f) for f in fits]
    return everywhere.fit_all(again[:ANEW]) + where_they_are.fit_all(again[ANEW:])


def _found(search: Search, size: int, promising: Sequence[Screened]) -> list[Fitted]:
    """Explanations by so many effects, and by fewer of theirs, fitted to all trials, the likeliest first."""
    few, everywhere, at = search.few, search.everywhere, search.at
    frame, best = refinement.frame(few, search.here), search.likeliest()
    done = bool(best.parts) and refinement.done(best, ENOUGH)
    seeds = shortlist.distinct([f for f in shortlist.ordered(search.fits) if len(f.parts) == size - 1])
    seeds = seeds[: 1 if done else SEEDS]
    tried = extend.extensions(few, frame, seeds, promising, PLENTY if done else extend.PROMISES)
    if size == 2 and not done:
        tried = extend.once_each([*extend.superposed(frame, search.base, promising), *tried])
    on_few = few.fit_all(tried)
    others = [s.candidate for s in promising]
    if seeds:
        on_few += extend.reading_otherwise(few, everywhere, seeds[0], others)
    on_few = shortlist.once_each(shortlist.ordered(on_few))
    if seeds and not refinement.fails(seeds[0]) and not _adds(on_few, seeds[0], few, everywhere):
        return []
    extended = [starts.carried(f, everywhere, at) for f in on_few[:EXTENSIONS_AGAIN]]
    found: list[Fitted] = []
    if seeds:
        beside = [] if done else extend.beside(everywhere, seeds[0], len(few.trials), others, at)
        extended = extend.once_each([*beside, *extended, *starts.given_back(seeds[0], everywhere, others)])
        if not done and starts.unmoved(seeds[0].values, at):  # what they were moved for may be the other effect
            nothing = np.zeros_like(at)
            there = everywhere.around(Point(seeds[0].parts, seeds[0].values, nothing))
            found += there.fit_all(extend.beside(there, seeds[0], len(few.trials), others, nothing))
    found += everywhere.fit_all(extended)
    if not found:
        return []
    found += everywhere.fit_all(starts.fewer(found))
    leader = shortlist.ordered(found)[0]
    alone = starts.subsets(leader, [*search.fits, *found])
    found += everywhere.fit_all([*alone, *starts.merged(leader, everywhere)])
    return shortlist.once_each(shortlist.ordered(found))
