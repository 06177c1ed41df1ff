"""Simulation-based calibration of magnitudes: ranks of the truth in its posterior, where the effect's name is given.

    python -m benchmarks.magnitudes --cases 200 --seed 3757 --settings plain --out MAGNITUDES

Records cases of the blind check with one effect each and diagnoses those in which it shows, with every other effect
left out of the library, so that nothing but the magnitude is in question. If posteriors are as wide as they should be,
the truth's ranks in them are evenly distributed (Talts et al. 2018). The recordings are those of the blind check's
reality, which is no draw of the diagnosis's own simulator: forms that differ count, too. Writes
``results/magnitudes.json``: of each case error and deviations, the ranks in ten bins with chi-square's p, and the
numbers that posteriors have from here, fitted to the cases with an even number and tried on the others: by how much
deviations of fits are widened (``widens`` in ``tiago_mj/gap/decision/verdict.json``), which share of an uncertain form
a magnitude takes up (``FORM_COMPENSATION``), and the degrees of freedom of Student's distribution, since a few errors
are far larger than most. Both widths are such that 1.645 deviations are half a 90 % interval. A folder goes on where it
stopped, and a run that was ended early is scored as far as it went with ``--answered``.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chisquare, norm, t

from benchmarks.blind import plan, run
from benchmarks.blind.cases import Case
from benchmarks.blind.dictionary import UNSCORED
from benchmarks.blind.store import Store
from benchmarks.machine import save
from tiago_mj.effects import EFFECTS
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.inference.hypotheses import FORM_COMPENSATION, form_deviation

Array = NDArray[np.float64]

#: Bins of ranks, and the share of intervals that are to hold the truth.
BINS: Final = 10
HOLDS: Final = 0.9
#: Half a 90 % interval [deviations of a normal distribution].
NINETY: Final = float(norm.ppf((1 + HOLDS) / 2))
#: Values that are tried: degrees of freedom, and both other numbers.
FREEDOMS: Final = (1.5, 2.0, 3.0, 4.0, 6.0, 12.0, 100.0)
WIDENINGS: Final = tuple(np.geomspace(0.5, 4.0, 31).tolist())
COMPENSATIONS: Final = tuple(np.linspace(0.0, 1.0, 26).tolist())
#: Degrees of freedom as of the run whose numbers are shipped.
FREEDOM: Final = 1.5
#: Effects whose truth is not stated against the nominal numbers: masses and inertias of links, which are a few per cent
#: off, add to them.
UNSTATED: Final = frozenset({"armature", "payload"})


@dataclass(frozen=True)
class Magnitude:
    """What was said of a magnitude whose truth is known.

    Attributes:
        effect: name.
        error: said less true, in the magnitude's unit.
        fitted: deviation of the fit.
        form: deviation by which the effect's form may change the magnitude, if it takes up all of that.
    """

    effect: str
    error: float
    fitted: float
    form: float


@dataclass(frozen=True)
class Shape:
    """Width and tails of posteriors.

    Attributes:
        widens: deviations of the fit count so many times.
        compensates: share of what the form may change that the magnitude takes up.
        freedom: degrees of freedom of Student's distribution.
    """

    widens: float
    compensates: float
    freedom: float

    def deviations(self, some: Sequence[Magnitude]) -> Array:
        """Errors in deviations of their posteriors, of which 1.645 are half a 90 % interval."""
        errors, fits, forms = np.array([(one.error, one.fitted, one.form) for one in some]).T
        return np.asarray(errors / np.hypot(fits * self.widens, forms * self.compensates))

    def ranks(self, deviations: Array) -> Array:
        """Of the truths in their posteriors, from 0 to 1."""
        return np.asarray(t.cdf(-deviations * t.ppf((1 + HOLDS) / 2, self.freedom) / NINETY, self.freedom))


def magnitude(label: Mapping[str, Any], answer: Mapping[str, Any]) -> Magnitude | None:
    """The first magnitude of a case with one effect; None where another was named, none, or its truth is not stated."""
    true, named = label["effects"][0], answer["verdict"].get("effects", [])
    if len(named) != 1 or named[0]["name"] != true["name"] or true["name"] in UNSTATED:
        return None
    parameter, declared = next(iter(EFFECTS[true["name"]].parameters.items()))
    said = named[0]["parameters"].get(parameter, {})
    if not said.get("deviation") or (true["name"], parameter) in UNSCORED:
        return None
    value = float(label.get("effective", {}).get(parameter, true["parameters"][parameter]))
    identity = np.inf if declared.identity is None else declared.identity
    form = form_deviation(true["name"], identity, said["value"]) / FORM_COMPENSATION
    return Magnitude(true["name"], said["value"] - value, said["deviation"], form)


def fitted(some: Sequence[Magnitude]) -> Shape:
    """The shape with which ranks, folded in the middle, are distributed most evenly: the least Cramér-von Mises
    distance, which a few wrong answers do not decide."""

    def distance(by: Shape) -> float:
        folded = np.sort(np.abs(2 * by.ranks(by.deviations(some)) - 1))
        return float(np.square(folded - (np.arange(len(folded)) + 0.5) / len(folded)).sum())

    return min((Shape(*three) for three in itertools.product(WIDENINGS, COMPENSATIONS, FREEDOMS)), key=distance)


def scored(some: Sequence[Magnitude], by: Shape) -> dict[str, Any]:
    """How evenly ranks are distributed, and how often 90 % intervals hold the truth."""
    deviations = by.deviations(some)
    counts = np.histogram(by.ranks(deviations), bins=BINS, range=(0, 1))[0]
    return {
        **asdict(by),
        "magnitudes": len(some),
        "ranks": counts.tolist(),
        "p_of_even_ranks": float(chisquare(counts).pvalue),
        "held": float(np.mean(np.abs(deviations) <= NINETY)),
    }


def _answered(
    planned: Sequence[Case], store: Store, jobs: int, *, further: bool
) -> dict[int, tuple[dict[str, Any], dict[str, Any]]]:
    """Labels and answers of the cases whose effect shows, diagnosed with its name given."""
    run.generate(planned, store, workers=1, say=partial(print, flush=True))
    labels = {k: json.loads(store.label_file(k).read_text()) for k in range(len(planned))}
    shows = [k for k, label in labels.items() if label["oracle"]["detectable"]]
    for k in shows:
        if not further or store.answered(k):
            continue
        (choice,) = planned[k].effects
        others = tuple(name for name, one in EFFECTS.items() if one.nameable and name != choice.name)
        words = run.Diagnoser(jobs=jobs).command(
            replace(planned[k], without=others), store.recordings(k), store.diagnosis(k)
        )
        status, told = run.call_command(words)
        if status:
            store.failure(k).write_text(told)
        print(f"case {k:03d} of {len(planned)}: {choice.name}, status {status}", flush=True)
    return {k: (labels[k], answer) for k in shows if (answer := store.answer(k)) is not None}


def main(words: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.magnitudes", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--cases", type=int, required=True, metavar="N")
    parser.add_argument("--seed", type=int, required=True, metavar="N")
    parser.add_argument("--settings", default="plain", choices=plan.SETTINGS)
    parser.add_argument("--jobs", type=int, default=1, metavar="N")
    parser.add_argument("--answered", action="store_true", help="diagnose nothing more, score what was answered")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--save", default="magnitudes", metavar="NAME", help="results/NAME.json")
    asked = parser.parse_args(words)
    store = Store(asked.out.resolve())
    try:
        store.begin(run.facts(asked.cases, asked.seed, ("one",), (asked.settings,)))
    except ValueError as fault:
        parser.error(str(fault))
    planned = plan.plan(asked.cases, asked.seed, only=("one",), settings=(asked.settings,))
    answered = _answered(planned, store, asked.jobs, further=not asked.answered)
    found = {k: said for k, pair in answered.items() if (said := magnitude(*pair)) is not None}
    even, odd = ([said for k, said in found.items() if k % 2 == side] for side in (0, 1))
    everything, by_even = list(found.values()), fitted(even)
    shipped = Shape(verdict.calibration().widens, FORM_COMPENSATION, FREEDOM)
    results = {
        "seed": asked.seed,
        "settings": asked.settings,
        "recorded": asked.cases,
        "answered": len(answered),
        "shipped": scored(everything, shipped),
        "fitted_to_even": scored(even, by_even),
        "tried_on_odd": scored(odd, by_even),
        "fitted_to_all": scored(everything, fitted(everything)),
        "each": {str(k): asdict(one) for k, one in found.items()},
    }
    command = f"python -m benchmarks.magnitudes --cases {asked.cases} --seed {asked.seed} --settings {asked.settings}"
    print(save(asked.save, results, f"{command} --out MAGNITUDES"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
