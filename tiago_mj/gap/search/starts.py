"""Starting points of fits. Gauss-Newton ends in the nearest local optimum, so several are tried."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference import likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Label, Term
from tiago_mj.gap.search.screen import Screened

Array = NDArray[np.float64]

#: Explanations within this of the best evidence are refined [nats]. Chosen by hand; no ablation.
NEAR_BEST_NATS: Final = 15.0
#: Explanations from whose nuisances the nominal model is restarted. Chosen by hand; no ablation.
MAX_NOMINAL_RESTARTS: Final = 2
#: Evidence that a better local optimum of the nuisances may gain [nats]. Chosen by hand; no ablation.
LOCAL_OPTIMUM_NATS: Final = 60.0
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
    """Start for some trials of what the first pass found: with the nominal numbers beside which it was found, or where
    those were moved far, which the effect may be the reason for, with what they are without."""
    values = np.array([s.value])
    also = [_nuisances_moved_to_effect((s.candidate,), values, few, at)]
    also += [there for value in s.candidate.grid for there in with_zero_nuisances(np.array([value]), at)]
    return Start((s.candidate,), values, at, tuple(also))


def with_zero_nuisances(values: Array, at: Array) -> tuple[tuple[Array, Array], ...]:
    """The magnitudes with all nuisances 0 as an alternative start where a nuisance was moved far; else empty."""
    return ((values, np.zeros_like(at)),) if np.abs(at).max(initial=0.0) > FAR_NUISANCE_DEVIATIONS else ()


def start_on_all_trials(fit: Fitted, everywhere: Fitter, at: Array) -> Start:
    """Start for all trials of what was fitted to some: with its nuisances, as far as trials share them; with those of
    the nominal model, or without them where these were moved far; or with an effect that has not begun, which is no
    worse than none; of both with what the nominal numbers have of the effect given back to it."""
    count = len(everywhere.shared)
    nuisance = np.concatenate([fit.nuisance[:count], at[count:]])
    begun = np.array([p.identity if np.isfinite(p.identity) else p.high for p in fit.parts])
    freed = _nuisances_moved_to_effect(fit.parts, fit.values, everywhere, nuisance)
    return Start(
        fit.parts,
        fit.values,
        nuisance,
        (
            (fit.values, at),
            freed,
            (begun, at),
            _nuisances_moved_to_effect(fit.parts, begun, everywhere, at),
            *with_zero_nuisances(fit.values, at),
        ),
    )


def _nuisances_moved_to_effect(
    parts: Sequence[Candidate], values: Array, fitter: Fitter, nuisance: Array
) -> tuple[Array, Array]:
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
            out.append(
                Start(
                    parts,
                    *_nuisances_moved_to_effect(parts, np.append(fit.values, part.identity), fitter, fit.nuisance),
                )
            )
    return out


def without_insignificant(fits: Sequence[Fitted]) -> list[Start]:
    """Starts without the effects whose magnitudes do not differ from their identity (90 %)."""
    out = []
    for fit in fits:
        needed = [k for k in range(len(fit.parts)) if differs_from_identity(fit, k)]
        if 0 < len(needed) < len(fit.parts):
            out.append(Start(tuple(fit.parts[k] for k in needed), fit.values[needed], fit.nuisance))
    return out


def leave_one_out(fit: Fitted, tried: Sequence[Fitted]) -> list[Start]:
    """Starts without one of its effects, as far as no fit of the rest was tried: it may have had to wait for that one
    to be found beside another."""
    there = {frozenset(part.label for part in f.parts) for f in tried}
    out = []
    for k in range(len(fit.parts)):
        rest = [i for i in range(len(fit.parts)) if i != k]
        parts = tuple(fit.parts[i] for i in rest)
        if frozenset(part.label for part in parts) not in there:
            out.append(Start(parts, fit.values[rest], fit.nuisance))
    return out


def on_all_targets(fit: Fitted, fitter: Fitter) -> list[Start]:
    """Starts with one effect on all targets, of an explanation that has it on each of them apart."""
    out = []
    for effect in dict.fromkeys(part.effect for part in fit.parts):
        mine = [k for k, part in enumerate(fit.parts) if part.effect == effect and part.target is not None]
        names = {name for k in mine for name in fit.parts[k].target or ()}
        if len(mine) < 2 or names != set(fitter.predict.plant.wiring.targets.names(EFFECTS[effect].targets)):
            continue
        rest = [k for k in range(len(fit.parts)) if k not in mine]
        paid = tuple(sum(each) for each in zip(*(fit.parts[k].selection_penalty for k in mine), strict=True))
        parts = (replace(fit.parts[mine[0]], target=None, selection_penalty=paid), *(fit.parts[k] for k in rest))
        out.append(Start(parts, np.array([fit.values[mine].mean(), *fit.values[rest]]), fit.nuisance))
    return out


def differs_from_identity(fit: Fitted, part: int, deviations: float = 1.645) -> bool:
    """Whether a magnitude is farther from its identity than so many of its deviations (1.645: 90 %)."""
    identity = fit.parts[part].identity
    if not np.isfinite(identity):
        return bool(fit.values[part] < fit.parts[part].high - 1e-6 * abs(fit.parts[part].high))
    return bool(abs(fit.values[part] - identity) > deviations * fit.deviations[part])


def nominal_restarts(fits: Sequence[Fitted]) -> list[Start]:
    """Starts of the nominal model where effects led its numbers, of those that do not explain far more than it does:
    it may have ended in another valley."""
    nominal = max(f.evidence for f in fits if not f.parts)
    found = sorted(
        (f for f in fits if f.parts and abs(f.evidence - nominal) < LOCAL_OPTIMUM_NATS), key=lambda f: -f.evidence
    )
    return [Start((), np.zeros(0), f.nuisance) for f in found[:MAX_NOMINAL_RESTARTS]]


def absorbed_by_nuisances(fits: Sequence[Fitted], fitter: Fitter) -> list[Start]:
    """Starts without effects that are no more than a nominal number a little off, which takes that value instead.

    Fits end in the nearest valley: where an effect found a better one than its explanation without it, that goes on
    from there. Only of the best, and where nothing but the number itself is beyond what it is known to.
    """
    best = max(fit.evidence for fit in fits)
    known = {frozenset(p.label for p in fit.parts): fit.evidence for fit in fits}
    out: dict[object, Start] = {}
    for fit in sorted(fits, key=lambda f: -f.evidence):
        if fit.evidence < best - NEAR_BEST_NATS:
            break
        nuisance, kept = fit.nuisance.copy(), []
        for k, part in enumerate(fit.parts):
            mine = _nuisances_of(fitter, part)
            taken = [nuisance[there] + term.deviations(fit.values[k]) for there, term in mine]
            if mine and max(np.abs(m).max() for m in taken) < likelihood.NUISANCE_BOUND:
                for (there, _), m in zip(mine, taken, strict=True):
                    nuisance[there] = m
            else:
                kept.append(k)
        labels = frozenset(fit.parts[k].label for k in kept)
        if len(kept) < len(fit.parts) and known.get(labels, -np.inf) < fit.evidence:
            out.setdefault(labels, Start(tuple(fit.parts[k] for k in kept), fit.values[kept], nuisance))
    return list(out.values())
