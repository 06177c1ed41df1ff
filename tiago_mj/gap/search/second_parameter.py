"""The second number of an effect (a time constant, a speed at which it fades), fitted by turns with the first, and its
other forms.

The first pass and the first fits know a second number at a few values only. Where such an explanation is near the best,
the second number is fitted with the first held, and then the first with the second held, from the likeliest of many
pairs of both. Which form is the better one may only show once each is fitted.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.inference.fit import Fitted, Fitter, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.search import ranking, scan, starts
from tiago_mj.gap.search.state import State

#: Explanations, the best first, whose second parameters and forms are refined, and how many where all leave a gap: the
#: right effect may be far behind in the wrong form. Chosen by hand; no ablation.
MAX_REFINED: Final = 2
MAX_REFINED_IF_INADEQUATE: Final = 4
#: Second numbers and first ones (as shares of the way from none to what was fitted) that are tried in pairs, all in the
#: trials of the first pass, the likeliest in all trials. Static friction of 1.7 N that fades at 5.6 mm/s was fitted as
#: 1.2 N at 21 mm/s, and no slope leads back (blind check's generator, seed 941, case 7).
SECOND_SHARES: Final = tuple(np.geomspace(1 / 6, 6, 9).tolist())
FIRST_SHARES: Final = tuple(np.geomspace(0.5, 2, 9).tolist())
MAX_PAIRS: Final = 9


def refined(state: State, *, fails: bool) -> list[Fitted]:
    """Further fits to all trials, with better second numbers, or of another form.

    Args:
        state: the search.
        fails: whether its best explanation leaves a gap.
    """
    fitter, best = state.everywhere, state.best
    different = {f.parts: f for f in sorted(state.fits, key=lambda f: f.evidence)}
    near = sorted(different.values(), key=lambda f: -f.evidence)
    near = (
        near[:MAX_REFINED_IF_INADEQUATE]
        if fails
        else [f for f in near if f.evidence > best.evidence - ranking.NEAR_BEST_NATS][:MAX_REFINED]
    )
    tasks = [(f, k, name) for f in near for k, part in enumerate(f.parts) for name in _second_parameters(part)][
        :MAX_REFINED
    ]
    if not fitter.out_of_time():
        tasks = [(_likeliest_pair(state, f, k, name), k, name) for f, k, name in tasks]
    held = [_start_on_second_parameter(fitter, f, k, name) for f, k, name in tasks]
    back = []
    for (f, k, name), second in zip(tasks, fitter.fit_all(held), strict=True):
        parts = _with_second(f, k, name, float(second.values[k]))
        values = np.array([f.values[k] if i == k else v for i, v in enumerate(second.values)])
        back.append(Start(parts, values, second.nuisance))
    return fitter.fit_all([*back, *(start for f in near for start in _other_forms(f))])


def _likeliest_pair(state: State, fit: Fitted, k: int, name: str) -> Fitted:
    """The explanation, or the same fitted from the likeliest pair of both numbers of one of its effects."""
    part, at = fit.parts[k], starts.point_of(fit)
    low, high = _bounds(state.everywhere, part, name)
    origin = part.identity if np.isfinite(part.identity) else 0.0
    points = []
    seconds = {min(max(dict(part.fixed)[name] * share, low), high) for share in SECOND_SHARES}
    for second in sorted(seconds - {0.0}):  # which is another form
        for share in FIRST_SHARES:
            values = fit.values.copy()
            values[k] = min(max(origin + share * (values[k] - origin), part.low), part.high)
            points.append(replace(at, parts=_with_second(fit, k, name, second), values=values))
    ahead = [points[i] for i in scan.likeliest_in_few(state, points, MAX_PAIRS)]
    (best,) = scan.likeliest(state.everywhere, ahead, 1)
    (again,) = state.everywhere.fit_all([starts.start_at(ahead[best])])
    return again if again.evidence > fit.evidence else fit


def _with_second(fit: Fitted, k: int, name: str, second: float) -> tuple[Candidate, ...]:
    """The explanation's effects, one of them with another second number."""
    fixed = tuple((key, second if key == name else value) for key, value in fit.parts[k].fixed)
    return tuple(replace(part, fixed=fixed) if i == k else part for i, part in enumerate(fit.parts))


def _bounds(fitter: Fitter, part: Candidate, name: str) -> tuple[float, float]:
    """Of a number of an effect, on its first target."""
    declared, targets = EFFECTS[part.effect], fitter.predict.plant.wiring.targets
    index = 0 if part.target is None else targets.names(declared.targets).index(part.target[0])
    return declared.parameters[name].bounds[0 if targets.slide(declared.targets, index) else 1]


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
    part = fit.parts[k]
    low, high = _bounds(fitter, part, name)
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
