"""Many effects in few words: which, on which joints, between which values.

``Coulomb friction on all six joints, 1.9 to 8.4 N·m; armature on J1 to J4, 0.1 to 0.3 kg·m²``. A sentence with a dozen
effects, each with its joint and its interval, is not read; a table beside it holds them one by one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.parts import identity
from tiago_mj.gap.report import words
from tiago_mj.gap.result import Explanation, Named, Result, Value
from tiago_mj.io.quantities import BARE

#: Kinds of effects that a sentence holds; it says how many terms are beside them.
KINDS: Final = 3
#: Numbers that are written as words.
COUNTED: Final = (
    *("no", "one", "two", "three", "four", "five", "six"),
    *("seven", "eight", "nine", "ten", "eleven", "twelve"),
)


def counted(number: int) -> str:
    """A small number as a word."""
    return COUNTED[number] if number < len(COUNTED) else str(number)


def joints(result: Result) -> frozenset[str]:
    """Joints whose motion or effort was compared."""
    found = (place.channel.partition(".") for place in result.where)
    return frozenset(name for kind, _, name in found if kind != "force" and name)


def in_short(effects: Sequence[Named], of: frozenset[str] = frozenset(), *, valued: bool = True) -> str:
    """Effects as what they are, where, and between which values, those on most joints first.

    Args:
        effects: of one explanation.
        of: all joints of the robot that were compared; unknown: none is said to be all of them.
        valued: with the values.
    """
    groups = sorted(_by_name(effects).values(), key=len, reverse=True)
    said = [_group(group, of, valued=valued) for group in groups[:KINDS]]
    rest = sum(map(len, groups[KINDS:]))
    if rest:
        said.append(f"{counted(rest)} further term{'s' if rest > 1 else ''}")
    return "; ".join(said[:-1]) + f"; and {said[-1]}" if len(said) > 1 else "".join(said)


def clauses(explanation: Explanation, of: frozenset[str] = frozenset()) -> str:
    """A set of effects as one clause: each spelled out, or of many what they have in common."""
    if len(explanation.effects) > words.MANY:
        return f"the simulator lacks {in_short(explanation.effects, of)}"
    return words.clauses(explanation)


def labels(explanation: Explanation, of: frozenset[str] = frozenset()) -> str:
    """A set of effects in a few words, without values."""
    if len(explanation.effects) > words.MANY:
        return in_short(explanation.effects, of, valued=False)
    return words.labels(explanation)


def apart(choices: Sequence[Explanation]) -> tuple[tuple[Named, ...], tuple[Explanation, ...]]:
    """What all explanations name, with the values of the first, and what each names beside it."""
    shared = set(identity(choices[0])).intersection(*map(identity, choices[1:]))
    common = tuple(effect for effect in choices[0].effects if (effect.name, effect.target) in shared)
    rests = tuple(
        Explanation(tuple(e for e in one.effects if (e.name, e.target) not in shared), one.probability)
        for one in choices
    )
    return common, rests


def _by_name(effects: Sequence[Named]) -> Mapping[str, list[Named]]:
    groups: dict[str, list[Named]] = {}
    for effect in effects:
        groups.setdefault(effect.name, []).append(effect)
    return groups


def _group(group: Sequence[Named], of: frozenset[str], *, valued: bool) -> str:
    """One kind of effect: its name, where it acts, and its values."""
    place = _place(words.together(group)[0], of)
    values = _values([_magnitude(effect) for effect in group]) if valued else ""
    title = words.title(group[0].name)
    return f"{title}{place and f' on {place}'}{values and f', {values}'}"


def _place(effect: Named, of: frozenset[str]) -> str:
    """Where an effect acts: all joints, a run of numbered ones, or a list; empty: there is but one place."""
    declared = EFFECTS.get(effect.name)
    if declared is not None and declared.targets in ("object", "clock"):
        return ""
    targets = effect.targets or ()
    if len(targets) > 2:
        if of and set(targets) == of:
            return f"all {counted(len(of))} joints"
        if (ends := run(targets)) is not None:
            return f"{ends[0]} to {ends[1]}"
    return words.whom(effect)[0]


def run(names: Sequence[str]) -> tuple[str, str] | None:
    """The first and the last of names that differ in one number and leave none out, ``J1`` and ``J4``; None: they are
    not like that."""
    found = [re.fullmatch(r"(\D*)(\d+)(\D*)", name) for name in names]
    if any(one is None for one in found):
        return None
    split = sorted((int(one[2]), one[1], one[3], one[0]) for one in found if one is not None)
    numbers = [number for number, *_ in split]
    if len({(before, after) for _, before, after, _ in split}) > 1 or numbers != list(
        range(numbers[0], numbers[0] + len(numbers))
    ):
        return None
    return split[0][3], split[-1][3]


def _magnitude(effect: Named) -> tuple[str, Value] | None:
    """The parameter by which an effect is told, with its name."""
    return next(iter(effect.parameters.items()), None)


def _values(given: Sequence[tuple[str, Value] | None]) -> str:
    """The values of one parameter on several joints: the only one with its interval, else the least to the largest, by
    unit."""
    known = [one for one in given if one is not None]
    if len(known) == 1:
        name, value = known[0]
        said = words.amount(value)
        return said if value.unit not in BARE else f"{name.replace('_', ' ')} {said}"
    by_unit: dict[str, list[float]] = {}
    names: dict[str, str] = {}
    for name, value in known:
        scale, unit = words.scaled(max((v.value for _, v in known if v.unit == value.unit), key=abs), value.unit)
        by_unit.setdefault(unit, []).append(scale * value.value)
        names[unit] = "" if unit else f"{name.replace('_', ' ')} "
    return " and ".join(f"{names[unit]}{_span(values)} {unit}".rstrip() for unit, values in by_unit.items())


def _span(values: Sequence[float]) -> str:
    """The least to the largest, in two digits."""
    low, high = (words.bare(words.number(one, 2)) for one in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
