"""Nominal numbers bound at 2.5 deviations instead of 4: does the truth then stand out, and do false names appear?

The explanations of the truth ladder (nominal model, truth, parts of it, answer; of cases without an effect the
effects that a nominal number may stand for) are fitted again from where they ended, with either bound, and judged as
the verdict would judge them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final
from unittest import mock

import numpy as np

from benchmarks.experiments import results, search
from benchmarks.experiments.again import again
from benchmarks.experiments.kept_cases import Kept
from tiago_mj.gap.inference import likelihood

BOUNDS: Final = (4.0, 2.5)
#: Rounds of a fit that begins where another ended.
AGAIN: Final = 2


def bounded(kept: Kept) -> dict[str, Any]:
    """A case with either bound."""
    case = again(kept)
    by = case.tolerant()
    out: dict[str, Any] = {"true": [e.name for e in kept.case.effects]}
    for bound in BOUNDS:
        with mock.patch.object(likelihood, "NUISANCE_BOUND", bound):
            fits = {}
            for name, start in case.starts.items():
                assert start.nuisance is not None
                inside = replace(start, nuisance=np.clip(start.nuisance, -bound, bound))
                fits[name] = search.begun_at(by, inside, AGAIN)
        rows = {name: {k: v for k, v in search.row(fit).items() if k != "nuisance"} for name, fit in fits.items()}
        out[f"{bound:g}"] = {"fits": rows, **search.decided(case.opened, list(fits.values()))}
    return out


if __name__ == "__main__":
    results.run("bounds", __doc__, sorted(results.load("truth_ladder")), bounded)
