"""Numbers, names and effects as a reader wants them: millimetres for small metres, sentences for effects."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from tiago_mj.effects import EFFECTS, Effect
from tiago_mj.gap.result import Explanation, Named, Value
from tiago_mj.io.quantities import bare, fixed, number, quantity, scaled
from tiago_mj.models import names

__all__ = ["bare", "fixed", "number", "quantity", "scaled"]

#: A reader's word for the one part that an effect acts on, and for all of them.
PARTS: Final = {
    "command": ("{}", "every actuator"),
    "joint": ("{}", "every joint"),
    "sensor": ("the {} load cell", "both load cells"),
    "object": ("the object", "the object"),
    "clock": ("the clock", "the clock"),
}
QUANTITIES: Final = {"position": "position", "velocity": "velocity", "effort": "effort", "force": "force reading"}
#: More targets than these are counted instead of listed.
LISTED: Final = 3


#: Shares from which on, and up to which, a reader is told no nearer number.
NEARLY_ALL, NEARLY_NOTHING = 0.9995, 0.0005


def percent(share: float | None) -> str:
    """A share in per cent: whole, with a decimal below ten and from 99.5 on. One rule for every column and interval:
    what is :data:`NEARLY_ALL` is "over 99.9 %", all of it too, so that no column holds both that and "100 %"."""
    if share is None or not math.isfinite(share):
        return "–"
    return f"{_hundredths(share)} %"


def _hundredths(share: float, decimals: int = 0) -> str:
    """A share in per cent without the sign, with at least so many decimals."""
    if NEARLY_ALL <= share <= 1:
        return "over 99.9"
    if 1 < share < 1.005:
        return "over 100"
    if abs(share) < NEARLY_NOTHING:
        return "under 0.1" if share > 0 else "0"
    if 0.995 <= share < 1:  # nearly all is not all: never rounded up
        return f"{math.floor(1000 * share + 1e-9) / 10:.1f}"
    return fixed(100 * share, max(decimals, 1 if abs(share) < 0.0995 else 0))


def span(low: float | None, high: float | None, decimals: int) -> str:
    """An interval, or nothing where it is not known."""
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return ""
    return f"{fixed(low, decimals)}{' to ' if low < 0 else '–'}{fixed(high, decimals)}"


def interval_percent(low: float | None, high: float | None) -> str:
    """An interval of shares, ``88–96 %``, its ends as :func:`percent` has them: with a decimal where they would print
    equal without, and one value where they print equal still. Nothing where it is not known."""
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return ""
    ends = _hundredths(low), _hundredths(high)
    if ends[0] == ends[1]:
        ends = _hundredths(low, 1), _hundredths(high, 1)
    if ends[0] == ends[1]:
        return f"{ends[0]} %"
    plain = all(end[0].isdigit() for end in ends)
    return f"{ends[0]}{'–' if plain else ' to '}{ends[1]} %"


def percent_within(share: float | None, low: float | None, high: float | None) -> str:
    """A share with its interval: ``93 % (88–96 %)``; without it where that says no more."""
    said, between = percent(share), interval_percent(low, high)
    return f"{said} ({between})" if between and between != said else said


def amount(given: Value, *, share: bool = False, flip: bool = False) -> str:
    """A parameter with unit and interval: ``2.6 N (2.4–2.9)``.

    Args:
        given: the parameter.
        share: write it in per cent.
        flip: write the opposite (what is less by a negative amount).
    """
    value, low, high, unit = given.value, given.low, given.high, given.unit
    if flip:
        value, low, high = -value, None if high is None else -high, None if low is None else -low
    scale, unit = (100.0, "%") if share else scaled(value, unit)
    value, low, high = value * scale, None if low is None else low * scale, None if high is None else high * scale
    known = low is not None and high is not None and math.isfinite(high - low)
    if not known or high == low:
        text, between = bare(number(value)), ""
    else:
        assert low is not None
        assert high is not None
        decimals = min(6, max(0, -math.floor(math.log10(abs(high - low) / 2))))
        text, between = fixed(value, decimals), span(low, high, decimals)
        if fixed(low, decimals) == fixed(high, decimals):  # narrower than any reader's digits
            text, between = bare(number(value)), ""
    if share and text == "100":  # nearly all is not all, here neither
        text = _hundredths(value / scale)
    return " ".join(piece for piece in (text, unit, between and f"({between})") if piece)


def title(name: str) -> str:
    """An effect's name as words: ``Coulomb friction``."""
    words = name.replace("_", " ")
    for person in ("coulomb", "stribeck"):
        words = words.replace(person, person.capitalize())
    return words


def meaning(name: str) -> str:
    """What an effect is: the first sentence of its declaration."""
    declared = EFFECTS.get(name)
    described = (inspect.getdoc(declared) if declared else None) or ""
    paragraph = " ".join(described.split("\n\n")[0].split())
    sentence = re.split(r"(?<=[.;])\s", paragraph)[0].rstrip(";.").replace("``", "")
    return f"{sentence}." if sentence else ""


def part(name: str, kind: str) -> str:
    """A reader's name of one target."""
    for side, joint in zip(names.SIDES, names.FINGERS, strict=True):
        if name == joint:
            return f"the gripper's {side} finger"
    return PARTS.get(kind, PARTS["joint"])[0].format(name)


def whom(effect: Named) -> tuple[str, bool]:
    """A reader's name of an effect's targets, and whether they are several."""
    declared = EFFECTS.get(effect.name)
    kind = declared.targets if declared else "joint"
    several = effect.targets
    if several is None:
        if declared and declared.subject:
            return declared.subject, False
        return PARTS[kind][1], kind == "sensor"
    if set(several) == set(names.FINGERS):
        return "both fingers of the gripper", True
    if kind == "sensor" and set(several) == set(names.SIDES):
        return "both load cells", True
    if len(several) > LISTED + 1:
        rest = len(several) - LISTED
        return f"{', '.join(part(name, kind) for name in several[:LISTED])} and {rest} more", True
    return listed([part(name, kind) for name in several]), len(several) > 1


def label(effect: Named) -> str:
    """Effect and targets in a few words: ``Coulomb friction on the gripper's right finger``."""
    declared = EFFECTS.get(effect.name)
    if declared is not None and declared.targets in ("object", "clock"):
        return title(effect.name)
    return f"{title(effect.name)} on {whom(effect)[0]}"


def labels(explanation: Explanation) -> str:
    """A set of effects in a few words; what acts on several joints is said once."""
    return listed([label(effect) for effect in together(explanation.effects)]) or "nothing (the nominal simulator)"


def together(effects: Sequence[Named]) -> list[Named]:
    """Effects of one name as one, on all their targets."""
    targets: dict[str, list[str]] = {}
    for effect in effects:
        targets.setdefault(effect.name, []).extend(effect.targets or ("all",))
    return [Named(name, found[0] if len(found) == 1 else tuple(found)) for name, found in targets.items()]


def clause(effect: Named) -> str:
    """What an effect says about the robot, as a clause that begins with a small letter."""
    declared, parameters = EFFECTS.get(effect.name, Effect), effect.parameters
    first = next(iter(parameters.values()), None)
    less = first is not None and first.value < 0 and declared.clause_less != ""
    template = declared.clause_less if less else declared.clause
    template = re.sub(r"\[(.*?{(\w+)}.*?)\]", lambda part: _if_present(part, parameters), template)
    fields = re.findall(r"{(\w+)(?:%)?}", template)
    subject, several = whom(effect)
    grammar = {"t": subject, "s": "" if several else "s", "has": "have" if several else "has"}
    grammar["is"] = "are" if several else "is"
    if not template or any(field not in grammar and field not in parameters for field in fields):
        shown = ", ".join(f"{key} {amount(value)}" for key, value in parameters.items())
        return f"there is {label(effect)}{f' ({shown})' if shown else ''}"

    def fill(found: re.Match[str]) -> str:
        key = found.group(1)
        if key in grammar:
            return grammar[key]
        return amount(parameters[key], share=found.group(2) == "%", flip=less and parameters[key] is first)

    said = re.sub(r"{(\w+)(%?)}", fill, template)
    where = ", ".join(f"{key} {amount(parameters[key])}" for key in declared.details if key in parameters)
    return f"{said}, at {where}" if where else said


def _if_present(part: re.Match[str], parameters: Mapping[str, Value]) -> str:
    """A part of a clause in brackets: said where its parameter is known and not 0."""
    value = parameters.get(part.group(2))
    return part.group(1) if value is not None and value.value else ""


#: Effects of an explanation that are spelled out one by one; of more a sentence says the pattern
#: (:mod:`tiago_mj.gap.report.pattern`).
MANY: Final = 3


def clauses(explanation: Explanation) -> str:
    """Effects as one clause, each spelled out."""
    return ", and ".join(clause(effect) for effect in explanation.effects)


def channel(name: str) -> str:
    """A channel as a reader says it: ``the force reading of the right finger``."""
    kind, _, rest = name.partition(".")
    if kind not in QUANTITIES or not rest:
        return name
    owner = f"the {rest} finger" if kind == "force" and rest in names.SIDES else part(rest, "joint")
    return f"the {QUANTITIES[kind]} of {owner}"


def listed(items: Sequence[str], word: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    items = list(items)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {word} {items[-1]}" if items else ""


def begin(sentence: str) -> str:
    """With a capital letter, unless it begins with a name such as ``arm_1_joint``."""
    first = sentence.partition(" ")[0]
    return sentence if re.search(r"[_\d./]", first) else sentence[:1].upper() + sentence[1:]
