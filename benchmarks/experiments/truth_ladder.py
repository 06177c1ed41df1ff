"""Search, form or nominal numbers: what makes a wrong case wrong, told by the evidence at its truth [nats].

    nominal     the nominal model at its best
    exact       the true effects and the true nominal numbers, nothing fitted
    truth       the true effects at their true magnitudes, nominal numbers fitted from the true ones
    from_truth  a fit of all that begins there
    from_name   the search with the true effects and those of the answer for its library
    answer      the effects that were answered, by the same search

All are judged on common ground: one weight of a sample, one tolerance, one treatment of the physics step. The share is

    search      a fit from the truth is better than from the name by :data:`CLEAR`, and better than all others
    form        even the best of the truth is worse than an answer that is no part of it
    nominal     the best of the truth is not better than its own parts, or than the nominal model, by :data:`PRICE`
    proposal    the truth is the best by more than that, and so it is from its name, and it was not among the
                explanations that the answer ranks: the search did not look
    mended      the same, and it was: it is found today, with this library
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from benchmarks.experiments import results, search
from benchmarks.experiments.kept_cases import WRONG, Kept
from benchmarks.experiments.opened import open_case, true_nuisance, true_parts
from tiago_mj.gap.inference.fit import Fitted, Start
from tiago_mj.gap.search import starts, step_error

#: Evidence that decides between two fits of one explanation, and that an effect must add: the search's own.
CLEAR: Final = 5.0
PRICE: Final = 5.0


def ladder(kept: Kept) -> dict[str, Any]:
    """The rungs of one case."""
    opened = open_case(kept)
    parts, values = true_parts(opened)
    true = frozenset(part.label for part in parts)
    betrayed = {k.candidate.effect for k in opened.known}
    said = frozenset(label for label in kept.said if label[0] not in betrayed)
    wanted = {true, said, *(frozenset([label]) for label in true)}
    found = search.compared(opened, search.searched(opened, true | said), wanted)
    by = found.by
    begin = true_nuisance(opened, by)
    rungs: dict[str, Fitted] = {"nominal": found.nominal()}
    rungs["exact"] = search.evaluated(by, parts, values, begin)
    rungs["truth"] = search.nuisances_alone(by, parts, values, begin)
    nearest = max(rungs["exact"], rungs["truth"], key=lambda f: f.evidence)
    rungs["from_truth"] = search.begun_at(by, starts.restart(nearest))
    if true in found.fits:
        rungs["from_name"] = found.fits[true]
    if said and said != true and said in found.fits:
        rungs["answer"] = found.fits[said]
    # The nominal model, and the parts of the truth, may lie in another valley, which the truth leads to.
    led = search.begun_at(by, Start((), np.zeros(0), rungs["from_truth"].nuisance))
    rungs["nominal"] = max(rungs["nominal"], led, key=lambda f: f.evidence)
    for label, fit in found.fits.items():
        if len(label) > 0 and label < true and label != said:
            key = "part"
            rungs[key] = max(rungs.get(key, fit), fit, key=lambda f: f.evidence)
    other = step_error.better_step_correction(by, [rungs["from_truth"], rungs["nominal"]])
    by_name = [*found.fits.values(), rungs["nominal"]]
    return {
        "setting": f"{kept.case.setting} {kept.case.interface} {kept.case.rate:g} Hz",
        "true": [f"{e.name} {'' if e.target == 'all' else e.target}".strip() for e in kept.case.effects],
        "magnitudes": [float(f"{v:.4g}") for v in values],
        "said": [name for name, _ in kept.said],
        "kind": (kept.answer or {"verdict": {"kind": "failed"}})["verdict"]["kind"],
        "trials": list(by.trials),
        "weight": [round(float(w), 4) for w in by.weight],
        "corrected": by.predict.corrected,
        "switched_beside_truth": other is not None,
        "rungs": {name: search.row(fit) for name, fit in rungs.items()},
        "today": search.decided(opened, by_name),
        "with_truth": search.decided(opened, [*by_name, *rungs.values()]),
        "share": share({name: fit.evidence for name, fit in rungs.items()}, looked=kept.ranked_truth),
    }


def share(evidence: dict[str, float], *, looked: bool) -> str:
    """Which part of the diagnosis the case is lost in; ``looked``: the truth was among what the answer ranks."""
    from_name = evidence.get("from_name", -np.inf)
    best = max(evidence["truth"], evidence["from_truth"], from_name)
    fewer = max(evidence["nominal"], evidence.get("part", -np.inf))
    if evidence.get("answer", -np.inf) > max(best, fewer):
        return "form"
    if best < fewer + PRICE:
        return "nominal"
    if best > from_name + CLEAR:
        return "search"
    return "mended" if looked else "proposal"


if __name__ == "__main__":
    results.run("truth_ladder", __doc__, WRONG, ladder)
