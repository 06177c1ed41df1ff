"""The diagnosis's own search, with a pool of a few named effects instead of the library; and fits begun elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import score
from benchmarks.experiments.opened import Opened, judge, with_scatter
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Label
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.search import beginning, ranking, select, starts, state
from tiago_mj.gap.search.screen import worst_predicted
from tiago_mj.gap.search.state import Question, Ranked

Array = NDArray[np.float64]

#: Rounds of a fit around itself: as many as a search makes for its best explanations.
ROUNDS = 3
BRINGS = 1.0


@contextmanager
def _everything_shown() -> Iterator[None]:
    """A search then returns what it does not think worth showing, too: the experiments compare evidence."""
    with mock.patch.object(ranking, "reportable", lambda fits: list(fits)):
        yield


def searched(opened: Opened, labels: Collection[Label], **limits: Any) -> Ranked:
    """What the search finds when the library holds nothing but these effects on these targets."""
    data, base = opened.part()
    pool = [c for c in opened.pool if c.label in labels]
    with _everything_shown():
        asked = Question(
            opened.predict,
            data,
            opened.trials,
            pool,
            opened.terms,
            base,
            opened.known,
            opened.seen,
            opened.steps,
        )
        return select.select(asked, **limits)


def plain(fit: Fitted, known: int) -> Fitted:
    """Without what the readings betray, which a ranked explanation has as its last parts."""
    count = len(fit.parts) - known
    return replace(fit, parts=fit.parts[:count], values=fit.values[:count], deviations=fit.deviations[:count])


@dataclass(frozen=True)
class Compared:
    """Explanations that were found, to be compared on common ground.

    Attributes:
        by: the fitter that judges all.
        fits: of the search, by set of labels, each at its best.
    """

    by: Fitter
    fits: dict[frozenset[Label], Fitted]

    def nominal(self) -> Fitted:
        """Without an effect."""
        return self.fits[frozenset()]


def compared(opened: Opened, ranked: Ranked, wanted: Collection[frozenset[Label]] | None = None) -> Compared:
    """A search's explanations, each judged where it ended by one weight and one tolerance; the nominal model
    and those of some sets of effects, or of all."""
    trials = [t for t in _fitted_trials(opened, ranked) if t not in ranked.excluded]
    by = judge(opened, ranked.predict, ranked.weight, trials)
    fits = [plain(f, ranked.known) for f in ranked.fits]
    fits = [f for f in fits if len(f.nuisance) == by.size]
    nominal = max((f for f in fits if not f.parts), key=lambda f: f.evidence)
    if nominal.misfit < beginning.HOPELESS_NOMINAL_MISFIT:
        by = with_scatter(by, nominal)
    best: dict[frozenset[Label], Fitted] = {}
    for fit in sorted(fits, key=lambda f: -f.evidence):
        labels = frozenset(part.label for part in fit.parts)
        if wanted is None or not labels or labels in wanted:
            best.setdefault(labels, fit)
    return Compared(by, {labels: where_it_is(by, fit) for labels, fit in best.items()})


def _fitted_trials(opened: Opened, ranked: Ranked) -> list[int]:
    """Trials that the search fitted, chosen as it chooses them."""
    data, base = opened.part()
    count = min(max(state.FIT_STEPS // max(opened.steps, 1), state.FIT_TRIALS), len(opened.trials))
    return [opened.trials[k] for k in worst_predicted(base, data, count)]


def where_it_is(by: Fitter, fit: Fitted) -> Fitted:
    """Evidence of an explanation where it is, with the responses there."""
    return evaluated(by, fit.parts, fit.values, fit.nuisance)


def evaluated(by: Fitter, parts: tuple[Candidate, ...], values: Array, nuisance: Array) -> Fitted:
    """Evidence at a point."""
    there = replace(by.linearized_at(Point(parts, values, nuisance)), iterations=0)
    return there.fit_all([Start(parts, values, nuisance)])[0]


def begun_at(by: Fitter, start: Start, most: int = ROUNDS) -> Fitted:
    """A fit from a point, with responses around itself, and again as long as that brings something."""
    assert start.nuisance is not None
    (best,) = by.linearized_at(Point(start.parts, start.values, start.nuisance)).fit_all([start])
    for _ in range(most - 1):
        (again,) = by.linearized_at(starts.point_of(best)).fit_all([starts.restart(best)])
        gained, best = again.evidence - best.evidence, max(best, again, key=lambda f: f.evidence)
        if gained < BRINGS:
            break
    return best


def nuisances_alone(by: Fitter, parts: tuple[Candidate, ...], values: Array, nuisance: Array) -> Fitted:
    """Nominal numbers fitted, the magnitudes held where they are; evidence with the magnitudes' price."""
    entries = tuple(part.entry(float(v)) for part, v in zip(parts, values, strict=True))
    held = replace(by, given=(*by.given, *entries))
    fit = begun_at(held, Start((), np.zeros(0), nuisance))
    return evaluated(by, parts, values, fit.nuisance)


def decided(opened: Opened, fits: Sequence[Fitted]) -> dict[str, Any]:
    """The verdict on explanations, with the price that names have in the whole library."""
    best: dict[frozenset[Label], Fitted] = {}
    for fit in sorted(fits, key=lambda f: -f.evidence):
        best.setdefault(frozenset(part.label for part in fit.parts), fit)
    shown = ranking.reportable(list(best.values()))
    pool = len({c.effect for c in opened.pool})
    ranked = Ranked(tuple(shown), (), (), 0, pool, True, np.zeros(0), opened.predict)
    options = [verdict.option(fit, ranked) for fit in shown]
    by, betrayed = verdict.calibration(), bool(opened.known)
    said = verdict.decide(options, by, measured_on_readings=betrayed)
    parts = [*shown[said.rivals[0]].parts, *(k.candidate for k in opened.known)]
    named = sorted({score.class_of(part.effect) for part in parts})
    effects = [{"name": e.name} for e in opened.kept.case.effects]
    probability = float(verdict.probabilities(options, by, measured_on_readings=betrayed)[said.rivals[0]])
    right = said.kind != "unknown" and tuple(named) == score.classes(effects)
    return {"kind": said.kind, "named": named, "probability": round(probability, 3), "right": right}


def row(fit: Fitted) -> dict[str, Any]:
    """What of a fit is kept: enough to begin there again."""
    return {
        "parts": [[part.effect, part.target, dict(part.fixed)] for part in fit.parts],
        "evidence": round(fit.evidence, 1),
        "met": round(fit.evidence - fit.prior, 1),
        "prior": round(fit.prior, 1),
        "left": round(ranking.discrepancy(fit), 2),
        "values": [float(f"{v:.6g}") for v in fit.values],
        "farthest": round(float(np.abs(fit.nuisance).max(initial=0.0)), 2),
        "nuisance": [round(float(v), 3) for v in fit.nuisance],
    }


def counted(by: Fitter, fit: Fitted) -> Array:
    """What samples count for beside an explanation, (C,)."""
    return ranking.sample_weight(by.data, by.predictions([starts.point_of(fit)])[0])
