"""Magnitudes that end at a bound are fitted with wider ones: how large an effect can be on a robot is only estimated
from its masses and from what its drives did (:mod:`tiago_mj.gap.simulation.sizes`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.simulation import sizes

#: A bound is so many times wider, so many times in turn: up to 16 times in all, as the estimates are of an order of
#: magnitude. Halved and doubled, the load of a real pendulum, 0.66 kg where 0.39 was the bound, is the same.
WIDER: Final = 4.0
TIMES: Final = 2


def fitted(fitter: Fitter, fits: Sequence[Fitted]) -> list[Fitted]:
    """Fits, those with a magnitude at its estimated bound fitted again without it where that explains more."""
    if fitter.predict.plant.environment is not None and fitter.predict.replays:  # its bounds were chosen for this robot
        return list(fits)
    out = list(fits)
    for _ in range(TIMES):
        which = [k for k, fit in enumerate(out) if any(map(_at_estimate, fit.parts, fit.values.tolist()))]
        if not which or fitter.out_of_time():
            break
        again = fitter.fit_all([_start(out[k]) for k in which])
        better = {k: new for k, new in zip(which, again, strict=True) if new.evidence > out[k].evidence}
        if not better:
            break
        out = [better.get(k, fit) for k, fit in enumerate(out)]
    return out


def _start(fit: Fitted) -> Start:
    """Start where a fit ended, with wider bounds."""
    values = fit.values.tolist()
    parts = (
        replace(part, high=part.high * WIDER) if _at_estimate(part, v) else part
        for part, v in zip(fit.parts, values, strict=True)
    )
    return Start(tuple(parts), fit.values, fit.nuisance)


def _at_estimate(part: Candidate, value: float) -> bool:
    """Whether a magnitude lies at an upper bound that is an estimate."""
    return value > part.identity == 0 and part.at_edge(value) and part.unit in sizes.ESTIMATED
