"""Sentences on parts that are built alike: which of their magnitudes agree, and which part differs."""

from __future__ import annotations

from tiago_mj.gap.parts import Likeness, Value
from tiago_mj.gap.report import words
from tiago_mj.gap.result import Diagnosis


def sentences(diagnosis: Diagnosis) -> list[str]:
    """One for each magnitude, those that differ first, the least likely of them first."""
    ahead = sorted(diagnosis.like, key=lambda one: (not one.differs, one.probability))
    return [sentence(one) for one in ahead]


def sentence(one: Likeness) -> str:
    """Which parts agree, on what, and which do not."""
    what = f"{words.begin(words.title(one.name))} of {one.place}"
    values = words.listed([f"{part} {words.amount(_bare(value))}" for part, value in one.values.items()])
    unit = next(iter(one.values.values())).unit
    chance = words.number(one.probability, 2)
    if one.common is None:
        return f"{what}: no two agree: {values} {unit} (chance of this where parts are alike: {chance})."
    agree = [part for part in one.values if part not in one.differs]
    common = words.amount(one.common)
    if not one.differs:
        return f"{what}: {words.listed(agree)} agree, within what they are known to, on {common}: {values} {unit}."
    verb = "differs" if len(one.differs) == 1 else "differ"
    rest = f"{words.listed(agree)} {'agree on' if len(agree) > 1 else 'has'} {common}"
    return f"{what}: {words.listed(one.differs)} {verb}: {values} {unit}; {rest} (chance where alike: {chance})."


def _bare(value: Value) -> Value:
    """The value alone, without its interval and unit."""
    return Value(value.value, None, None, "")
