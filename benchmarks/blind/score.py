"""Scores of diagnoses against labels, by class.

Names count as right up to their class (the contract's table of effects): a verdict that names another member of the
class of the true effect is right. An effect without a class is a class of its own. Which cases enter a score:

* ``top1``, ``in_set``, ``set_size``: one detectable effect of the library. Size is in classes told apart.
* ``pairs``: two effects, each detectable.
* ``false_names``: nothing to find; ``effect`` or ``ambiguous`` with a name is false.
* ``unknown_flagged``: detectable effects outside the library, called ``unknown``, without soft forms of its effects;
  ``soft_forms``: these, called ``unknown`` or by the effect whose softer form they are; ``left_out``: the library's
  own, deleted from it: ``unknown`` or a member of the class is right.
* ``false_flags``: every case that the library can explain, called ``unknown``.
* ``ece``: probability of the best explanation against whether it is the true one, which it is not where the library
  lacks what there is. An undetectable effect's truth is no gap.
* ``brier_gain``, ``log_gain``: how much lower the mean Brier and log loss of these probabilities are than those of the
  best constant, the share that is right; ``reliability``: of five bins of as many answers each, the mean probability
  and the share that is right.
* ``parameter_error``, ``interval_coverage``: single detectable effects that were named exactly; error over the
  parameter's distance from its identity.
* ``closed_share``: closed over closable (:mod:`benchmarks.blind.oracle`), where at least :data:`CLOSABLE` is.
* ``next_motion``: ambiguous cases whose recommended motion was played in reality and diagnosed again.
* ``seconds``, ``physics_steps``: of a diagnosis; steps do not depend on the machine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from benchmarks.blind import intervals
from benchmarks.blind.dictionary import KINDS, UNSCORED

#: Least share that the true effect would close for a case to tell how much of it was closed.
CLOSABLE: Final = 0.2
#: Parameters whose identity is not 0; None: infinity, so that errors are relative to the value.
IDENTITY: Final[Mapping[tuple[str, str], float | None]] = {
    **{(name, "factor"): 1.0 for name in KINDS},
    ("rate_limit", "velocity"): None,
    ("velocity_limit", "velocity"): None,
    ("force_limit", "limit"): None,
    ("force_saturation", "limit"): None,
    ("joint_elasticity", "stiffness"): None,
    ("motor_cogging", "period"): None,
}

#: How far an effect stands out, in times of what a robot without any effect may reach, and its upper bound.
STRENGTHS: Final[Mapping[str, float]] = {"up to 3 times": 3.0, "3 to 10 times": 10.0, "over 10 times": np.inf}

Classes = tuple[str, ...]
Label = Mapping[str, Any]
Answer = Mapping[str, Any]


def class_of(name: str) -> str:
    """Class of an effect; its own name where it has none."""
    kind = KINDS.get(name)
    return kind.group if kind is not None and kind.group else name


def classes(effects: Sequence[Mapping[str, Any]]) -> Classes:
    """Classes of an explanation, in no order; members of one class, and one effect on several targets, count once."""
    return tuple(sorted({class_of(effect["name"]) for effect in effects}))


@dataclass(frozen=True)
class Judged:
    """A case with its answer.

    Attributes:
        label: the truth.
        answer: the diagnosis; None where it failed.
    """

    label: Label
    answer: Answer | None

    @property
    def kind(self) -> str:
        """Of the case."""
        return str(self.label["kind"])

    @property
    def detectable(self) -> bool:
        """By the oracle."""
        return bool(self.label["oracle"]["detectable"])

    @property
    def verdict(self) -> str:
        """Kind of the verdict; ``failed`` without one."""
        return "failed" if self.answer is None else str(self.answer["verdict"]["kind"])

    @property
    def truth(self) -> Classes:
        """Classes of the true effects."""
        return classes(self.label["effects"])

    @property
    def best(self) -> Classes | None:
        """Classes of the best explanation; None where there is none, or it is said to fail."""
        if self.answer is None or self.verdict == "unknown":
            return None
        return classes(self.answer["verdict"]["effects"])

    @property
    def set(self) -> set[Classes]:
        """Explanations that the verdict does not rule out, by class."""
        if self.answer is None:
            return set()
        verdict = self.answer["verdict"]
        alternatives = {classes(a["effects"]) for a in verdict.get("alternatives", [])}
        return alternatives | {classes(verdict["effects"])}

    @property
    def explainable(self) -> bool:
        """Whether the library holds the truth."""
        return self.kind in ("none", "one", "two")


def score(judged: Sequence[Judged], motions: Sequence[bool] = ()) -> dict[str, Any]:
    """All scores, each {value, low, high, n}.

    Args:
        judged: every case.
        motions: whether the recommended motion resolved it, of each case in which one was played.
    """
    one = [j for j in judged if j.kind == "one" and j.detectable]
    pairs = [j for j in judged if j.kind == "two" and j.detectable]
    none = [j for j in judged if j.kind == "none"]
    strange = [j for j in judged if j.kind == "outside" and j.detectable]
    outside, soft = [j for j in strange if not _soft(j)], [j for j in strange if _soft(j)]
    left_out = [j for j in judged if j.kind == "left_out" and j.detectable]
    undetectable = [j for j in judged if j.kind == "one" and not j.detectable]
    said = [row for j in judged if (row := stated(j)) is not None]
    errors, covered = _parameters(one)
    closed = [row for j in (*one, *pairs) if (row := _closed(j)) is not None]
    seconds = [float(j.answer["seconds"]) for j in judged if j.answer is not None]
    steps = [float(n) for j in judged if j.answer is not None and (n := j.answer.get("physics_steps")) is not None]
    scores = {
        "top1": intervals.share([j.best == j.truth for j in one]),
        "in_set": intervals.share([j.truth in j.set and j.verdict != "unknown" for j in one]),
        "set_size": intervals.statistic([len(j.set) for j in one if j.answer is not None], np.mean),
        "pairs": intervals.share([j.best == j.truth for j in pairs]),
        "false_names": intervals.share([j.verdict in ("effect", "ambiguous") and bool(j.best) for j in none]),
        "unknown_flagged": intervals.share([j.verdict == "unknown" for j in outside]),
        "soft_forms": intervals.share([right(j) for j in soft]),
        "left_out": intervals.share([j.verdict == "unknown" or j.best == j.truth for j in left_out]),
        "false_flags": intervals.share([j.verdict == "unknown" for j in judged if j.explainable]),
        "undetectable": intervals.share([_modest(j) for j in undetectable]),
        "ece": intervals.statistic(said, intervals.calibration_error),
        "brier_gain": intervals.statistic(said, lambda rows: intervals.gain_over_constant(rows, intervals.brier)),
        "log_gain": intervals.statistic(said, lambda rows: intervals.gain_over_constant(rows, intervals.log_loss)),
        "parameter_error": intervals.statistic(errors, np.median),
        "interval_coverage": intervals.share(covered),
        "closed_share": intervals.statistic(closed, np.mean),
        "next_motion": intervals.share(motions),
        "seconds": intervals.statistic(seconds, np.mean),
        "physics_steps": intervals.statistic(steps, np.mean),
        "failed": intervals.share([j.answer is None for j in judged]),
    }
    if len(said) > 1:
        scores["ece"]["spiegelhalter_p"] = intervals.spiegelhalter(np.array(said))
        scores["ece"]["reliability"] = intervals.reliability(np.array(said))
    return scores


def by_class(judged: Sequence[Judged]) -> dict[str, Any]:
    """Named first, by class of the true single effect: detectable ones of the library."""
    rows: dict[str, list[bool]] = {}
    for j in judged:
        if j.kind == "one" and j.detectable:
            rows.setdefault(j.truth[0], []).append(j.best == j.truth)
    return {name: intervals.share(rows[name]) for name in sorted(rows)}


def by_strength(judged: Sequence[Judged]) -> dict[str, Any]:
    """Named first, by how many times what is ordinary the effect's distance is (:mod:`benchmarks.blind.oracle`):
    detectable single effects of the library."""
    rows: dict[str, list[bool]] = {}
    for j in judged:
        if j.kind == "one" and j.detectable:
            times = j.label["oracle"]["distance"] / max(j.label["oracle"]["ordinary"], 1e-12)
            rows.setdefault(next(word for word, most in STRENGTHS.items() if times < most), []).append(
                j.best == j.truth
            )
    return {word: intervals.share(rows[word]) for word in STRENGTHS if word in rows}


def _modest(j: Judged) -> bool:
    """Right where an effect hardly shows: nothing named, or the true one, or said not to be excited."""
    excited = {class_of(n) for n in (j.answer or {}).get("verdict", {}).get("not_excited", [])}
    return j.verdict == "no_gap" or j.best == j.truth or (j.best == () and bool(set(j.truth) & excited))


def right(j: Judged) -> bool:
    """Whether the verdict's best explanation is the true one, up to classes."""
    if not j.explainable:
        return (
            j.verdict == "unknown" or (j.kind == "left_out" and j.best == j.truth) or (_soft(j) and j.best == _form(j))
        )
    if j.kind == "none" or not j.detectable:
        return j.best == () or (j.kind != "none" and j.best == j.truth)
    return j.best == j.truth


def _soft(j: Judged) -> bool:
    """Whether what there is is a softer form of an effect of the library."""
    return bool(_form(j))


def _form(j: Judged) -> Classes:
    """Class of the library's effect whose softer form is there; empty: none is."""
    form = [KINDS[effect["name"]].soft_form_of for effect in j.label["effects"] if effect["name"] in KINDS]
    return classes([{"name": name} for name in form]) if form and all(form) else ()


def stated(j: Judged) -> tuple[float, float] | None:
    """The probability of the best explanation, and whether that is right; None where nothing is claimed, or of what the
    library does not have nothing shows."""
    if j.answer is None or j.verdict == "unknown" or not (j.explainable or j.detectable):
        return None
    probability = j.answer["verdict"].get("probability")
    return None if probability is None else (float(probability), float(right(j)))


def _closed(j: Judged) -> float | None:
    closable = j.label["oracle"].get("closable")
    if closable is None or closable < CLOSABLE or j.answer is None:
        return None
    closed = j.answer.get("shrink", {}).get("closed")
    return min(float(closed or 0.0) / closable, 1.0)


def _parameters(one: Sequence[Judged]) -> tuple[list[float], list[bool]]:
    """Errors over the distance from identity, and whether intervals hold the truth."""
    errors, covered = [], []
    for j in one:
        true = j.label["effects"][0]
        named = (j.answer or {}).get("verdict", {}).get("effects", [])
        if j.best is None or len(named) != 1 or named[0]["name"] != true["name"]:
            continue
        effective = j.label.get("effective", {})
        for parameter, drawn in true["parameters"].items():
            said = named[0]["parameters"].get(parameter)
            if said is None or said.get("value") is None or (true["name"], parameter) in UNSCORED:
                continue
            value = float(effective.get(parameter, drawn))
            identity = IDENTITY.get((true["name"], parameter), 0.0)
            scale = abs(value if identity is None else value - identity)
            errors.append(abs(float(said["value"]) - value) / max(scale, 1e-12))
            if said.get("low") is not None and said.get("high") is not None:
                covered.append(bool(said["low"] <= value <= said["high"]))
    return errors, covered
