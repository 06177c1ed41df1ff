"""The share λ of the physics step's error that is put right, as a number that is fitted: ``y = S(θ) − λ·off``.

λ has a place among the nominal numbers, so that it is fitted together with them; its prior is normal with mean and
deviation of the even one on [0, 1.3], and it is kept within that. Beside it the one of λ = 1 and λ = 0 that the
diagnosis chose, and λ free with half the tolerance of when things happen (1 ms instead of 2 ms). Told is by
how much the truth, or of cases without an effect the best of some effects, is ahead of the nominal model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.experiments import results, search
from benchmarks.experiments.again import Again, again
from benchmarks.experiments.kept_cases import CONTACT, Kept
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import Fitter, Start
from tiago_mj.gap.inference.hypotheses import Candidate, Term
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.simulation import replay

Array = NDArray[np.float64]

#: λ at most, and mean and deviation of what lies anywhere between 0 and that.
MOST: Final = 1.3
MEAN, DEVIATION = MOST / 2, MOST / 12**0.5
#: Rounds of a fit that begins where another ended.
AGAIN: Final = 2
#: The tolerance of when things happen, halved [s].
HALVED: Final = noise_model.TIMING_TOLERANCE / 2


@dataclass
class ShareFitter(Fitter):
    """A fitter whose last shared nuisance is λ; ``off`` in channels, (ntrials, T, C)."""

    off: Array | None = None

    def effects(self, parts: Sequence[Candidate], values: Array, nuisance: Array, trial: int) -> tuple[Entry, ...]:
        plain = nuisance.copy()
        plain[len(self.shared) - 1] = 0.0  # λ is of no simulation
        return super().effects(parts, values, plain, trial)

    def predictions(self, points: Sequence[Point], *, keep: bool = False) -> Array:
        assert self.off is not None
        apart = [replace(p, nuisance=_without(p.nuisance, len(self.shared) - 1)) for p in points]
        once = list({(p.parts, p.values.tobytes(), p.nuisance.tobytes()): p for p in apart}.values())
        index = {(p.parts, p.values.tobytes(), p.nuisance.tobytes()): k for k, p in enumerate(once)}
        simulated = super().predictions(once, keep=keep)
        rows = [index[(p.parts, p.values.tobytes(), p.nuisance.tobytes())] for p in apart]
        shares = np.array([share_of(p.nuisance, len(self.shared) - 1) for p in points])
        return simulated[rows] - shares[:, None, None, None] * self.off


def _without(nuisance: Array, place: int) -> Array:
    out = nuisance.copy()
    out[place] = 0.0
    return out


def share_of(nuisance: Array, place: int) -> float:
    """λ, of nuisances."""
    return float(np.clip(MEAN + DEVIATION * nuisance[place], 0.0, MOST))


def with_share(case: Again, by: Fitter) -> ShareFitter:
    """The fitter with λ among its nominal numbers."""
    predict = by.predict
    assert predict.off is not None
    off = noise_model.predicted(by.data, predict.off.thinned(replay.parts_of(predict.plant)))[list(by.trials)]
    shared = [t for t in by.terms if not t.per_trial]
    own = [t for t in by.terms if t.per_trial]
    # It is never simulated: the effect only has to be one of the library's, and the parameter none of its own.
    share = Term("command_delay", None, "share of the step's error", 0.0, 1.0, False)
    terms = (*shared, share, *own)
    fields = {f: getattr(by, f) for f in ("trials", "data", "weight", "given", "iterations")}
    zeros = np.zeros((len(terms), *by.data.value.shape))
    return ShareFitter(predict.as_simulated(), terms=terms, responses=zeros, off=off, **fields)


def shared(kept: Kept) -> dict[str, Any]:
    """A case with λ fixed and free."""
    case = again(kept)
    out: dict[str, Any] = {"true": [e.name for e in kept.case.effects]}
    by = case.tolerant()
    out[f"{int(by.predict.corrected)}"] = _told(by, case.starts, case)
    out["free"] = _free(case, by)
    with mock.patch.object(noise_model, "TIMING_TOLERANCE", HALVED):
        tight = replace(case, by=replace(case.by, data=_collected(case)))
        out["free, 1 ms"] = _free(tight, tight.tolerant())
    return out


def _collected(case: Again) -> noise_model.Data:
    """Tolerances anew, with the constants of now."""
    whole = noise_model.collect(case.opened.plant, case.opened.predict.on.trials, frozenset(case.by.data.channels))
    nominal = case.opened.predict.as_simulated().all_trials([()], list(range(len(whole.value))))[0]
    assert case.opened.predict.off is not None
    off = case.opened.predict.off.thinned(replay.parts_of(case.opened.plant))
    finer = (
        nominal - noise_model.predicted(whole, off) * (noise_model.STEP_REFINEMENT - 1) / noise_model.STEP_REFINEMENT
    )
    return noise_model.select_trials(noise_model.with_step_tolerance(whole, nominal, finer), case.by.trials)


def _free(case: Again, by: Fitter) -> dict[str, Any]:
    fitter = with_share(case, by)
    place = len(fitter.shared) - 1
    starts = {}
    for name, start in case.starts.items():
        assert start.nuisance is not None
        begin = (float(by.predict.corrected) - MEAN) / DEVIATION
        starts[name] = replace(start, nuisance=np.insert(start.nuisance, place, begin))
    return _told(fitter, starts, case, place)


def _told(by: Fitter, starts: dict[str, Start], case: Again, place: int | None = None) -> dict[str, Any]:
    fits = {name: search.begun_at(by, start, AGAIN) for name, start in starts.items()}
    rows = {}
    for name, fit in fits.items():
        rows[name] = {k: v for k, v in search.row(fit).items() if k != "nuisance"}
        if place is not None:
            rows[name]["share"] = round(share_of(fit.nuisance, place), 3)
    best = max((f.evidence for f in fits.values() if f.parts), default=-np.inf)
    gain = round(best - fits["nominal"].evidence, 1)
    return {"gain": gain, "fits": rows, **search.decided(case.opened, list(fits.values()))}


if __name__ == "__main__":
    results.run("step_share", __doc__, CONTACT, shared)
