"""The second number of an effect (a time constant, a speed at which it fades), fitted by turns with the first, and its
other forms.

The first pass and the first fits know a second number at a few values only. Where such an explanation is near the best,
the second number is fitted with the first held, and then the first with the second held. Which form is the better one
may only show once each is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.search import ranking

#: Explanations, the best first, whose second parameters and forms are refined, and how many where all leave a gap: the
#: right effect may be far behind in the wrong form. Chosen by hand; no ablation.
MAX_REFINED: Final = 2
MAX_REFINED_IF_INADEQUATE: Final = 4


def refined(fitter: Fitter, fits: Sequence[Fitted], best: Fitted, *, fails: bool) -> list[Fitted]:
    """Further fits, with better second numbers, or of another form.

    Args:
        fitter: of all trials.
        fits: explanations.
        best: of all.
        fails: whether that leaves a gap.
    """
    different = {f.parts: f for f in sorted(fits, key=lambda f: f.evidence)}
    near = sorted(different.values(), key=lambda f: -f.evidence)
    near = (
        near[:MAX_REFINED_IF_INADEQUATE]
        if fails
        else [f for f in near if f.evidence > best.evidence - ranking.NEAR_BEST_NATS][:MAX_REFINED]
    )
    tasks = [(f, k, name) for f in near for k, part in enumerate(f.parts) for name in _second_parameters(part)][
        :MAX_REFINED
    ]
    held = [_start_on_second_parameter(fitter, f, k, name) for f, k, name in tasks]
    back = []
    for (f, k, name), second in zip(tasks, fitter.fit_all(held), strict=True):
        fixed = tuple((key, float(second.values[k]) if key == name else v) for key, v in f.parts[k].fixed)
        parts = tuple(replace(part, fixed=fixed) if i == k else part for i, part in enumerate(f.parts))
        values = np.array([f.values[k] if i == k else v for i, v in enumerate(second.values)])
        back.append(Start(parts, values, second.nuisance))
    return fitter.fit_all([*back, *(start for f in near for start in _other_forms(f))])


def _other_forms(fit: Fitted) -> list[Start]:
    """The same explanation with another form of one of its effects."""
    out = []
    for k, part in enumerate(fit.parts):
        for name, form in EFFECTS[part.effect].forms.items():
            for value in form.values:
                fixed = tuple((key, value if key == name else v) for key, v in part.fixed)
                if fixed != part.fixed:
                    other = replace(part, fixed=fixed)
                    parts = tuple(other if i == k else p for i, p in enumerate(fit.parts))
                    out.append(Start(parts, fit.values, fit.nuisance))
    return out


def _second_parameters(part: Candidate) -> list[str]:
    """Names of the numbers that are held, apart from those of the form; none that is 0, which is another form."""
    return [name for name, value in part.fixed if name not in EFFECTS[part.effect].forms and value]


def _start_on_second_parameter(fitter: Fitter, fit: Fitted, k: int, name: str) -> Start:
    """The same explanation, in which a second number is fitted and the first held."""
    part, targets = fit.parts[k], fitter.predict.plant.wiring.targets
    declared = EFFECTS[part.effect]
    index = 0 if part.target is None else targets.names(declared.targets).index(part.target[0])
    low, high = declared.parameters[name].bounds[0 if targets.slide(declared.targets, index) else 1]
    value = dict(part.fixed)[name]
    others = tuple((key, v) for key, v in part.fixed if key != name)
    # Within a few times of where it was: the number has no identity, and a first step from afar may go anywhere.
    turned = replace(
        part,
        parameter=name,
        fixed=(*others, (part.parameter, float(fit.values[k]))),
        identity=np.inf,
        low=max(low, value / 4),
        high=min(high, value * 4),
        tolerance=0.0,
    )
    values = np.array([value if i == k else v for i, v in enumerate(fit.values)])
    return Start(tuple(turned if i == k else p for i, p in enumerate(fit.parts)), values, fit.nuisance)
