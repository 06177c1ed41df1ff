"""Whether an answer is right, by class.

* ``right``: every cause is named on its joint by an effect of its class, with a value within 15 % or within the
  truth's own uncertainty, and nothing else is named but what may be; a stated remainder takes nothing away. Where
  nothing is withheld: ``no_gap``, or no name and a remainder that is said.
* ``half``: some of it is right and nothing false is named, or all names are right and a value is not. It counts as
  wrong.
* ``wrong``: a name that is false, or none that is right.
* ``silent``: no name where there is something to name (``unknown``, ``no_gap``), or no answer.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from benchmarks.blind import intervals
from benchmarks.blind.dictionary import LIBRARY, kind_of
from benchmarks.blind.score import class_of
from benchmarks.real.declare import KINDS, NOTHING, RECORDINGS, Case, Cause

RIGHT, HALF, WRONG, SILENT = "right", "half", "wrong", "silent"
GRADES: Final = (RIGHT, HALF, WRONG, SILENT)
VERDICTS: Final = ("no_gap", "effect", "ambiguous", "unknown")
#: Effects that have no joint of their own, or need none to be understood.
PLACELESS: Final = frozenset({"payload", "gravity_tilt", "clock_offset", "clock_skew"})
#: Parameter that is an effect's size; the contract's first.
SIZE: Final[Mapping[str, str]] = {name: next(iter(next(iter(kind_of(name).ranges.values())))) for name in LIBRARY}
_WORDS: Final = re.compile(r"[@+]")


@dataclass(frozen=True)
class Named:
    """One name of an answer.

    Attributes:
        effect: of the contract.
        targets: joints; empty: all, or not said.
        value: of its size; None: not said.
    """

    effect: str
    targets: tuple[str, ...]
    value: float | None

    @classmethod
    def of(cls, name: str, value: float | None) -> Named:
        """``effect``, ``effect@joint`` or ``effect@joint+joint``."""
        effect, *targets = _WORDS.split(name)
        return cls(effect, () if targets == ["all"] else tuple(targets), value)

    def on(self, target: str) -> bool:
        """Whether it is, or may be, on a joint."""
        return not target or not self.targets or self.effect in PLACELESS or target in self.targets


@dataclass(frozen=True)
class Answer:
    """What somebody says of a case.

    Attributes:
        kind: one of :data:`VERDICTS`.
        named: the best explanation.
        alternatives: others that are said to be as good.
        remains: whether a remainder is stated.
    """

    kind: str
    named: tuple[Named, ...]
    alternatives: tuple[tuple[Named, ...], ...] = ()
    remains: bool = False


@dataclass(frozen=True)
class Judged:
    """A case, graded.

    Attributes:
        case: its name.
        grade: one of :data:`GRADES`.
        in_set: whether the best explanation or an alternative is right.
        missed: causes that nothing names.
        false: names that are true of nothing.
        off: causes that are named with a wrong value, or with a value that cannot be compared.
    """

    case: str
    grade: str
    in_set: bool
    missed: tuple[str, ...] = ()
    false: tuple[str, ...] = ()
    off: tuple[str, ...] = ()


def judge(case: Case, answer: Answer | None) -> Judged:
    """Grade an answer; None: there is none."""
    if answer is None:
        return Judged(case.name, SILENT, False, tuple(_called(cause) for cause in case.causes))
    grade, missed, false, off = _grade(case, answer.kind, answer.named, answer.remains)
    others = [_grade(case, answer.kind, one, answer.remains)[0] for one in answer.alternatives]
    return Judged(case.name, grade, RIGHT in (grade, *others), missed, false, off)


def _grade(
    case: Case, kind: str, named: Sequence[Named], remains: bool
) -> tuple[str, tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    may = {class_of(name) for name in case.may}
    missed, off = [], []
    for cause in case.causes:
        fits = [one for one in named if _is(one, cause)]
        if not fits:
            missed.append(_called(cause))
        elif not any(_close(one, cause) for one in fits):
            off.append(_called(cause))
    true = [one for one in named if any(_is(one, cause) for cause in case.causes)]
    false = [one.effect for one in named if not _all_true(one, case, may)]
    if case.kind == NOTHING:
        honest = kind in ("no_gap", "unknown") or remains or named  # named: what is known to be uncertain
        grade = WRONG if false or not honest else RIGHT
    elif false:
        grade = WRONG
    elif not named:
        grade = SILENT
    elif not true:
        grade = WRONG
    else:
        grade = HALF if missed or off else RIGHT
    return grade, tuple(missed), tuple(false), tuple(off)


def _called(cause: Cause) -> str:
    return cause.effects[0] + (f"@{cause.target}" if cause.target else "")


def _classes(cause: Cause) -> set[str]:
    return {class_of(effect) for effect in (*cause.effects, *(other[0] for other in cause.others))}


def _is(one: Named, cause: Cause) -> bool:
    return class_of(one.effect) in _classes(cause) and one.on(cause.target)


def _all_true(one: Named, case: Case, may: set[str]) -> bool:
    """Whether a name is true of a cause on each of its joints, or one of what may be named."""
    if class_of(one.effect) in may:
        return True
    causes = [cause for cause in case.causes if class_of(one.effect) in _classes(cause)]
    if one.effect in PLACELESS:
        return bool(causes)
    claimed = one.targets or case.joints  # a name without a joint claims every joint
    return bool(causes) and all(any(cause.target in ("", target) for cause in causes) for target in claimed)


def _close(one: Named, cause: Cause) -> bool:
    """Whether a value is right; a truth without a value asks for none."""
    accepted = cause.accepted
    for effect, low, high in cause.others:
        if one.effect == effect:
            return one.value is not None and low <= one.value <= high
    if accepted is None:
        return True
    if one.effect not in (cause.effects[0], *cause.alike) or one.value is None:
        return False
    return accepted[0] <= one.value <= accepted[1]


def summary(cases: Sequence[Case], judged: Mapping[str, Judged]) -> dict[str, Any]:
    """Counts and shares: overall, by kind, by recording, by robot, by class of the causes."""

    def of(some: Sequence[Case]) -> dict[str, Any]:
        graded = [judged[case.name] for case in some]
        return {
            "cases": len(graded),
            **{grade: sum(one.grade == grade for one in graded) for grade in GRADES},
            "right_share": intervals.share([one.grade == RIGHT for one in graded]),
            "in_set": sum(one.in_set for one in graded),
        }

    robots = dict.fromkeys(case.robot for case in cases)
    classes = sorted({class_of(cause.effects[0]) for case in cases for cause in case.causes})
    by_class = {}
    for name in classes:
        asked = [(case, cause) for case in cases for cause in case.causes if class_of(cause.effects[0]) == name]
        missed = sum(_called(cause) in judged[case.name].missed for case, cause in asked)
        off = sum(_called(cause) in judged[case.name].off for case, cause in asked)
        by_class[name] = {"causes": len(asked), "named": len(asked) - missed, "value_right": len(asked) - missed - off}
    return {
        "all": of(cases),
        "kind": {kind: of([case for case in cases if case.kind == kind]) for kind in KINDS},
        "recording": {kind: of([case for case in cases if case.recording == kind]) for kind in RECORDINGS},
        "robot": {robot: of([case for case in cases if case.robot == robot]) for robot in robots},
        "class": by_class,
    }


def names(effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """``effect@joint`` of every effect of an explanation."""
    found = []
    for one in effects:
        target = one["target"] if isinstance(one["target"], str) else "+".join(one["target"])
        found.append(one["name"] if target in ("all", "") else f"{one['name']}@{target}")
    return found


def of_diagnosis(found: Mapping[str, Any]) -> dict[str, Any]:
    """The answer of a ``diagnosis.json``, in the form of a submission."""
    verdict = found["verdict"]

    def told(effects: Sequence[Mapping[str, Any]]) -> tuple[list[str], dict[str, float]]:
        called, values = names(effects), {}
        for name, one in zip(called, effects, strict=True):
            size = (one.get("parameters") or {}).get(SIZE.get(one["name"], ""))
            if size is not None and size.get("value") is not None:
                values[name] = float(size["value"])
        return called, values

    if verdict["kind"] not in ("effect", "ambiguous"):
        return {"kind": verdict["kind"], "names": [], "remains": bool((verdict.get("remains") or {}).get("flag"))}
    called, values = told(verdict["effects"])
    told_others = [told(other["effects"]) for other in verdict.get("alternatives") or []]
    others = [{"names": theirs, "values": sizes} for theirs, sizes in told_others if theirs != called]
    return {
        "kind": verdict["kind"],
        "names": called,
        "values": values,
        "alternatives": others,
        "remains": bool((verdict.get("remains") or {}).get("flag")),
    }
