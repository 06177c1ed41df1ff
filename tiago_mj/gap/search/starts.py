"""Starting points of Gauss-Newton fits; several are tried, as a fit ends in the nearest local optimum."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Label, OwnNumber, Term
from tiago_mj.gap.search.screen import Screened

Array = NDArray[np.float64]
#: A further start of the same candidates: magnitudes and nuisances.
Pair = tuple[Array, Array]

#: A nuisance moved farther than this may stand for an effect on the same number [deviations]; and most of them that
#: are followed up. Halved and doubled, none of 31 answers about hinges changes (varied.json).
FAR_NUISANCE_DEVIATIONS: Final = 1.5
MAX_FAR_NUISANCES: Final = 2


def start_at(there: Point) -> Start:
    """Start at a point."""
    return Start(there.parts, there.values, there.nuisance)


def restart(fit: Fitted) -> Start:
    """Start at the end point of a fit."""
    return Start(fit.parts, fit.values, fit.nuisance)


def with_replaced_candidates(fit: Fitted, others: Mapping[Label, Candidate]) -> Start:
    """Start at the end point of a fit, some candidates replaced by others at the first magnitude of their grids."""
    parts = tuple(others.get(part.label, part) for part in fit.parts)
    values = [p.grid[0] if p.label in others else v for p, v in zip(parts, fit.values, strict=True)]
    return Start(parts, np.array(values), fit.nuisance)


def start_of_screened(s: Screened, screening: Fitter, nuisance: Array) -> Start:
    """Start on the screening trials from a screened candidate.

    Alternative starts transfer to the effect what the nuisances of the same parameter absorbed, or set nuisances that
    moved far to 0.
    """
    values = np.array([s.value])
    freed = _nuisances_moved_to_effect((s.candidate,), values, screening, nuisance)
    return Start((s.candidate,), values, nuisance, (freed, *with_zero_nuisances(values, nuisance)))


def with_zero_nuisances(values: Array, nuisance: Array) -> tuple[Pair, ...]:
    """The magnitudes with all nuisances 0 as an alternative start where a nuisance moved far; else empty."""
    return ((values, np.zeros_like(nuisance)),) if np.abs(nuisance).max(initial=0.0) > FAR_NUISANCE_DEVIATIONS else ()


def start_on_all_trials(fit: Fitted, full: Fitter, nominal_nuisance: Array) -> Start:
    """Start on all trials from a fit to the screening trials, with its shared nuisances.

    Alternative starts have the nuisances of the nominal model, transfer to the effect what nuisances of the same
    parameter absorbed (at the fitted magnitude, and from the value without effect, so that the fit is no worse than
    that without), or set nuisances that moved far to 0.
    """
    count = len(full.shared)
    nuisance = np.concatenate([fit.nuisance[:count], nominal_nuisance[count:]])
    begun = np.array([p.identity if np.isfinite(p.identity) else p.high for p in fit.parts])
    return Start(
        fit.parts,
        fit.values,
        nuisance,
        (
            (fit.values, nominal_nuisance),
            _nuisances_moved_to_effect(fit.parts, fit.values, full, nuisance),
            _nuisances_moved_to_effect(fit.parts, begun, full, nominal_nuisance),
            *with_zero_nuisances(fit.values, nominal_nuisance),
        ),
    )


def _nuisances_moved_to_effect(parts: Sequence[Candidate], values: Array, fitter: Fitter, nuisance: Array) -> Pair:
    """Magnitudes and nuisances with the mean change of the nuisances of the same parameter transferred to the
    effect."""
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
    """Nuisances on the parameter that an effect changes: indices (one for every trial where each trial has its own) and
    term."""
    return [
        (fitter.nuisance_indices(k), term)
        for k, term in enumerate(fitter.terms)
        if term.effect == part.effect
        and term.parameter == part.parameter
        and (part.target is None or term.target == part.target)
    ]


def effects_of_far_nuisances(fitter: Fitter, nuisance: Array, among: Collection[Label]) -> list[Label]:
    """Labels of effects on parameters whose nuisance moved far: on all targets, or on one where only its nuisance
    did."""
    far: dict[str, list[Term]] = {}
    places = [fitter.nuisance_indices(k) for k in range(len(fitter.terms))]
    moves = [abs(nuisance[there].mean()) * len(there) ** 0.5 for there in places]  # of all trials together
    for k in np.argsort(moves)[::-1]:
        if moves[k] > FAR_NUISANCE_DEVIATIONS and not isinstance(fitter.terms[k], OwnNumber):
            far.setdefault(fitter.terms[k].effect, []).append(fitter.terms[k])
    out: list[Label] = []
    for effect, terms in far.items():
        alone: Label = (effect, terms[0].target if len(terms) == 1 else None)
        out += [label for label in (alone, (effect, None)) if label in among][:1]
    return out[:MAX_FAR_NUISANCES]


def starts_on_far_nuisances(fit: Fitted, fitter: Fitter, among: Sequence[Candidate]) -> list[Start]:
    """Starts that add an effect on a parameter whose nuisance moved far; the effect begins with that change."""
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
    """Start without the effects that lie within the prior range of a nuisance on the same parameter, which takes their
    value; None where there is none.

    A fit ends in the nearest local optimum: this continues the better one that the effect found, without the effect.
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
