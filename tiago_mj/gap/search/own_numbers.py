"""Numbers of effects that were fitted like nuisances, as part of the effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.hypotheses import Candidate, OwnNumber, Term


def in_effects(fit: Fitted, terms: Sequence[Term]) -> Fitted:
    """The fit with the numbers of its effects in these, and no more among its nuisances.

    Args:
        fit: with nuisances of all terms.
        terms: those that all trials share come first.
    """
    own = {k: term for k, term in enumerate(terms) if isinstance(term, OwnNumber)}
    if not own:
        return fit
    rest = [k for k in range(len(fit.nuisance)) if k not in own]
    parts, spreads = list(fit.parts), dict(fit.spreads)
    for k, term in own.items():
        for i, part in enumerate(parts):
            if part.effect == term.effect:
                there = float(fit.nuisance[k])
                parts[i] = _with(part, term.parameter, term.of(part.target, there))
                if fit.nuisance_deviations is not None:
                    known_to = float(fit.nuisance_deviations[k])
                    spreads[term.parameter] = term.spread(part.target, there, known_to)
    correlation = fit.correlation and (fit.correlation[0], fit.correlation[1][np.ix_(rest, rest)])
    return replace(
        fit,
        parts=tuple(parts),
        nuisance=fit.nuisance[rest],
        nuisance_deviations=None if fit.nuisance_deviations is None else fit.nuisance_deviations[rest],
        correlation=correlation,
        spreads=spreads,
    )


def _with(part: Candidate, name: str, value: float) -> Candidate:
    return replace(part, fixed=(*(one for one in part.fixed if one[0] != name), (name, value)))
