"""Starting points of fits. Gauss-Newton ends in the nearest local optimum, so several are tried."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Label, Term
from tiago_mj.gap.search.screen import Screened

Array = NDArray[np.float64]
#: A further start of the same candidates: magnitudes and nuisances.
Pair = tuple[Array, Array]

#: A nuisance moved farther than this may stand for an effect on the same number [deviations]; and most of them that are
#: followed up. Chosen by hand; no ablation.
FAR_NUISANCE_DEVIATIONS: Final = 1.5
MAX_FAR_NUISANCES: Final = 2


def point_of(there: Fitted | Start) -> Point:
    """Where a fit ended, or begins."""
    assert there.nuisance is not None
    return Point(there.parts, there.values, there.nuisance)


def start_at(there: Point) -> Start:
    """Start at a point."""
    return Start(there.parts, there.values, there.nuisance)


def restart(fit: Fitted) -> Start:
    """Start where a fit ended."""
    return Start(fit.parts, fit.values, fit.nuisance)


def with_replaced_candidates(fit: Fitted, others: Mapping[Label, Candidate]) -> Start:
    """Start where a fit ended, some of its candidates replaced by others with the first magnitude of their grids."""
    parts = tuple(others.get(part.label, part) for part in fit.parts)
    values = [p.grid[0] if p.label in others else v for p, v in zip(parts, fit.values, strict=True)]
    return Start(parts, np.array(values), fit.nuisance)


def start_of_screened(s: Screened, few: Fitter, at: Array) -> Start:
    """Start for some trials of what the first pass found: with the nominal numbers beside which it was found, with what
    those have of the effect given back to it, or, where they were moved far, without them."""
    values = np.array([s.value])
    freed = _nuisances_moved_to_effect((s.candidate,), values, few, at)
    return Start((s.candidate,), values, at, (freed, *with_zero_nuisances(values, at)))


def with_zero_nuisances(values: Array, at: Array) -> tuple[Pair, ...]:
    """The magnitudes with all nuisances 0 as an alternative start where a nuisance was moved far; else empty."""
    return ((values, np.zeros_like(at)),) if np.abs(at).max(initial=0.0) > FAR_NUISANCE_DEVIATIONS else ()


def start_on_all_trials(fit: Fitted, everywhere: Fitter, at: Array) -> Start:
    """Start for all trials of what was fitted to some: with its nuisances, as far as trials share them; with those of
    the nominal model, or without them where these were moved far; or with an effect that has not begun, which is no
    worse than none, with what the nominal numbers have of the effect given back to it."""
    count = len(everywhere.shared)
    nuisance = np.concatenate([fit.nuisance[:count], at[count:]])
    begun = np.array([p.identity if np.isfinite(p.identity) else p.high for p in fit.parts])
    return Start(
        fit.parts,
        fit.values,
        nuisance,
        (
            (fit.values, at),
            _nuisances_moved_to_effect(fit.parts, fit.values, everywhere, nuisance),
            _nuisances_moved_to_effect(fit.parts, begun, everywhere, at),
            *with_zero_nuisances(fit.values, at),
        ),
    )


def _nuisances_moved_to_effect(parts: Sequence[Candidate], values: Array, fitter: Fitter, nuisance: Array) -> Pair:
    """The same, with what numbers of the nominal model have of an effect given back to it: fits of the nominal model
    moved them as far as they go."""
    values, nuisance = values.copy(), nuisance.copy()
    for k, part in enumerate(parts):
        mine = _nuisances_of(fitter, part)
        if not mine or not np.isfinite(part.identity):
            continue
        mean = float(np.mean([nuisance[there].mean() * term.deviation for there, term in mine]))
        values[k] = values[k] * np.exp(mean) if mine[0][1].factor else values[k] + mean
        values[k] = min(max(values[k], part.low), part.high)
        for there, term in mine:
            nuisance[there] -= mean / term.deviation
    return values, nuisance


def _nuisances_of(fitter: Fitter, part: Candidate) -> list[tuple[list[int], Term]]:
    """Of the nuisances, those that are the number that an effect changes: indices (of each trial's, where every trial
    has its own), term."""
    return [
        (fitter.nuisance_indices(k), term)
        for k, term in enumerate(fitter.terms)
        if term.effect == part.effect
        and term.parameter == part.parameter
        and (part.target is None or term.target == part.target)
    ]


def effects_of_far_nuisances(fitter: Fitter, nuisance: Array, among: Collection[Label]) -> list[Label]:
    """Effects, by label, that change a number of the nominal model which was moved far: on all targets, or on that one
    where the others' was not."""
    far: dict[str, list[Term]] = {}
    places = [fitter.nuisance_indices(k) for k in range(len(fitter.terms))]
    moves = [abs(nuisance[there].mean()) * len(there) ** 0.5 for there in places]  # of all trials together
    for k in np.argsort(moves)[::-1]:
        if moves[k] > FAR_NUISANCE_DEVIATIONS:
            far.setdefault(fitter.terms[k].effect, []).append(fitter.terms[k])
    out: list[Label] = []
    for effect, terms in far.items():
        alone: Label = (effect, terms[0].target if len(terms) == 1 else None)
        out += [label for label in (alone, (effect, None)) if label in among][:1]
    return out[:MAX_FAR_NUISANCES]


def starts_on_far_nuisances(fit: Fitted, fitter: Fitter, among: Sequence[Candidate]) -> list[Start]:
    """Starts with another effect, each on a number of the nominal model that the explanation moved far: the effect
    begins with what the number was moved by."""
    by_label = {candidate.label: candidate for candidate in reversed(among)}
    out = []
    for label in effects_of_far_nuisances(fitter, fit.nuisance, by_label):
        part = by_label[label]
        if label not in {one.label for one in fit.parts} and np.isfinite(part.identity):
            parts = (*fit.parts, part)
            values = np.append(fit.values, part.identity)
            out.append(Start(parts, *_nuisances_moved_to_effect(parts, values, fitter, fit.nuisance)))
    return out


def absorbed_by_nuisances(fit: Fitted, fitter: Fitter) -> Start | None:
    """Start without effects that are no more than a nominal number a little off, which takes that value instead; None
    where no effect of the explanation is.

    Fits end in the nearest valley: where an effect found a better one than the explanation without it, that goes on
    from there. Only where nothing but the number itself is beyond what it is known to.
    """
    nuisance, kept = fit.nuisance.copy(), []
    for k, part in enumerate(fit.parts):
        mine = _nuisances_of(fitter, part)
        taken = [nuisance[there] + term.deviations(fit.values[k]) for there, term in mine]
        if mine and max(np.abs(m).max() for m in taken) < likelihood.NUISANCE_BOUND:
            for (there, _), m in zip(mine, taken, strict=True):
                nuisance[there] = m
        else:
            kept.append(k)
    if len(kept) == len(fit.parts):
        return None
    return Start(tuple(fit.parts[k] for k in kept), fit.values[kept], nuisance)
