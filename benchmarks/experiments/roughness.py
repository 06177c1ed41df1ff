"""How rough the likelihood is: what it changes by where the nominal numbers move by next to nothing.

Around where the fits of the ladder ended all nominal numbers are moved together by normal draws, from a 100 000th of
a deviation to a tenth. What is told is the scatter of the likelihood over the draws, less what its curvature makes of
such moves where it is smooth: a scatter that stays as moves shrink is of no parameter, and evidence is known no better.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from benchmarks.experiments import results
from benchmarks.experiments.again import again
from benchmarks.experiments.kept_cases import CONTACT, Kept
from tiago_mj.gap.inference.fit import Fitter
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.whitening import Whitening

#: Sizes of the moves [deviations], draws of each.
MOVES: Final = (1e-5, 1e-4, 1e-3, 1e-2, 3e-2, 1e-1)
DRAWS: Final = 10
SEED: Final = 7


def rough(kept: Kept) -> dict[str, Any]:
    """Scatter of the likelihood of the ladder's fits [nats]."""
    case = again(kept)
    by = case.tolerant()
    on = Whitening(by.data, by.weight)
    out: dict[str, Any] = {"true": [e.name for e in kept.case.effects], "moves": list(MOVES)}
    for name, start in case.starts.items():
        assert start.nuisance is not None
        at = Point(start.parts, start.values, start.nuisance)
        points = [at]
        for move in MOVES:
            rng = np.random.default_rng(SEED)
            drawn = move * rng.standard_normal((DRAWS, by.size))
            points += [replace(at, nuisance=start.nuisance + one) for one in drawn]
        met = np.array([-on.cost(one, np.zeros(0)) for one in by.predictions(points)])
        by_move = met[1:].reshape(len(MOVES), DRAWS)
        out[name] = {
            "parts": [part.effect for part in start.parts],
            "here": round(float(met[0]), 1),
            "deviation": [round(float(one.std(ddof=1)), 2) for one in by_move],
            "best": [round(float(one.max() - met[0]), 1) for one in by_move],
            "worst": [round(float(one.min() - met[0]), 1) for one in by_move],
            "of_one_trial": _of_one_trial(by, points[1 + DRAWS : 1 + 2 * DRAWS]),
        }
    return out


def _of_one_trial(by: Fitter, points: list[Point]) -> float:
    """Share of the scatter that the trial which scatters most has."""
    spread = []
    predicted = by.predictions(points)
    for k in range(len(by.trials)):
        one = by.part([k])
        on = Whitening(one.data, one.weight)
        spread.append(np.var([on.cost(p[[k]], np.zeros(0)) for p in predicted]))
    return round(float(max(spread) / max(sum(spread), 1e-12)), 2)


if __name__ == "__main__":
    results.run("roughness", __doc__, CONTACT, rough)
