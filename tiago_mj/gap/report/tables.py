"""What the page's tables and small drawings show: plain values, ready to be written."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import STAGES, twins
from tiago_mj.gap.report import words
from tiago_mj.gap.report.consistency import has_probability
from tiago_mj.gap.result import BANDS, PHASES, Diagnosis, Named, Place, Value, identity

#: Words for the stages of the signal chain, in its order.
STAGE_NAMES: Final = {
    "timing": "timing",
    "command": "command",
    "actuator": "actuator",
    "transmission": "transmission",
    "contact": "contact",
    "body": "bodies",
    "joint_sensor": "joint sensor",
    "force_sensor": "force sensor",
}


@dataclass(frozen=True)
class Cell:
    """Of the heat map. ``strength`` is 0 to 1; ``text`` is what it says, ``hover`` in full."""

    text: str
    hover: str
    strength: float


@dataclass(frozen=True)
class Heat:
    """Channel × (phase, band): rows sorted by what they hold of the gap; None where a phase holds no such band."""

    by_share: bool
    phases: tuple[tuple[str, tuple[str, ...]], ...]
    rows: tuple[tuple[str, str, tuple[Cell | None, ...]], ...]
    totals: tuple[str, ...]


def heat(places: tuple[Place, ...], *, shares: bool = True) -> Heat:
    """The table as a map. Cells show the share of the excess; without ``shares`` or an excess, the gap itself."""
    total = math.fsum(p.share for p in places)
    by_share = shares and total > 0.5  # shares sum to 1, or to 0 where nothing exceeds the floor
    columns = [
        (phase, tuple(b for b in _order(BANDS, {p.band for p in places if p.phase == phase})))
        for phase in _order(PHASES, {p.phase for p in places})
    ]
    by = {(p.channel, p.phase, p.band): p for p in places}
    excess: dict[str, float] = {}
    for p in places:
        excess[p.channel] = excess.get(p.channel, 0.0) + (p.share if by_share else _finite(p.gap))
    most = max((p.share if by_share else _finite(p.gap) for p in places), default=0.0)
    rows = []
    for name in sorted(excess, key=lambda name: -excess[name]):
        cells = tuple(_cell(by.get((name, phase, band)), most, by_share) for phase, bands in columns for band in bands)
        rows.append((name, words.percent(excess[name]) if by_share else "", cells))
    totals = tuple(
        words.percent(math.fsum(p.share for p in places if p.phase == phase)) if by_share else ""
        for phase, _ in columns
    )
    return Heat(by_share, tuple(columns), tuple(rows), totals)


def _cell(place: Place | None, most: float, by_share: bool) -> Cell | None:
    if place is None:
        return None
    share = words.percent(place.share)
    hover = f"{place.channel}, {place.phase}, {place.band}: gap {interval(place)}, {share} of the excess"
    value = place.share if by_share else _finite(place.gap)
    strength = min(max(value / most, 0.0), 1.0) if most > 0 else 0.0
    if not by_share:
        strength *= 0.5 if most < 5 else 1.0  # near the floor nothing deserves a loud colour
        return Cell(_narrow(place.gap), hover, strength)
    return Cell("" if value < 0.005 else _hundred(value), hover, strength)


def _hundred(share: float) -> str:
    """Per cent in a narrow cell that has no sign, whole, and rounded to no more than :func:`words.percent` says."""
    if share < 0.995:
        return f"{100 * share:.0f}"
    return words.percent(share).removesuffix(" %").replace("over ", ">")


def _narrow(gap: float) -> str:
    """A gap in three characters, as long as it is below a thousand: to a tenth, to one, or to ten."""
    if gap < 10:
        return words.bare(f"{gap:.1f}")
    return words.number(gap, 2) if not math.isfinite(gap) else f"{round(gap, -1 if gap >= 100 else 0):.0f}"


def interval(place: Place) -> str:
    """A gap with its interval: ``12.3 (8.1–17)``."""
    low, high = words.number(place.low), words.number(place.high)
    return words.number(place.gap) if low == high else f"{words.number(place.gap)} ({low}–{high})"


@dataclass(frozen=True)
class Whisker:
    """A parameter beside the value that the simulator has: positions in per cent of the drawing's width."""

    name: str
    text: str
    identity: str
    zero: float | None
    value: float
    low: float | None
    high: float | None


def whiskers(effect: Named) -> list[Whisker]:
    """One per parameter."""
    return [_whisker(effect.name, key, value) for key, value in effect.parameters.items()]


def _whisker(effect: str, key: str, given: Value) -> Whisker:
    declared = EFFECTS[effect].parameters.get(key) if effect in EFFECTS else None
    identity = declared.identity if declared is not None else None
    ends = [x for x in (given.value, given.low, given.high, identity) if x is not None and math.isfinite(x)]
    low, high = min(ends, default=0.0), max(ends, default=0.0)

    def at(x: float | None) -> float | None:
        if x is None or not math.isfinite(x):
            return None
        return 50.0 if high <= low else round(6 + 88 * (x - low) / (high - low), 2)

    known = identity is not None and math.isfinite(identity)
    simulated = words.amount(Value(identity or 0.0, None, None, given.unit)) if known else ""
    place = at(given.value)
    return Whisker(
        name=key.replace("_", " "),
        text=words.amount(given),
        identity=simulated,
        zero=at(identity),
        value=50.0 if place is None else place,
        low=at(given.low),
        high=at(given.high),
    )


@dataclass(frozen=True)
class Ranked:
    """A row of the ranking; ``again``: its probability is that of its class, which a row above has already.
    ``probability`` is empty where the page gives none."""

    effects: tuple[dict[str, Any], ...]
    probability: str
    width: float
    gain: str
    gain_width: float
    chosen: bool
    tied: bool
    again: bool


def ranking(diagnosis: Diagnosis) -> list[Ranked]:
    """Explanations as ranked, with those that the data cannot tell from the best marked."""
    best = identity(diagnosis.best)
    tied = {identity(one) for one in diagnosis.alternatives}
    most = max((_finite(one.validation_gain) for one in diagnosis.ranking), default=0.0)
    told = has_probability(diagnosis) or diagnosis.kind == "no_gap"
    rows: list[Ranked] = []
    before: set[frozenset[str]] = set()
    for one in diagnosis.ranking:
        classes = frozenset(EFFECTS[e.name].gap_class if e.name in EFFECTS else e.name for e in one.effects)
        again = told and classes in before
        before.add(classes)
        rows.append(
            Ranked(
                effects=tuple(shown(effect) for effect in one.effects),
                probability="same class" if again else words.percent(one.probability) if told else "",
                width=round(100 * min(max(_finite(one.probability), 0.0), 1.0), 1),
                gain=words.number(one.validation_gain),
                gain_width=round(100 * max(_finite(one.validation_gain), 0.0) / most, 1) if most > 0 else 0.0,
                chosen=identity(one) == best,
                tied=len(tied) > 1 and identity(one) in tied,
                again=again,
            )
        )
    return rows


def shown(effect: Named) -> dict[str, Any]:
    """An effect for the template."""
    values = [(key.replace("_", " "), words.amount(value)) for key, value in effect.parameters.items()]
    declared = EFFECTS.get(effect.name)
    return {
        "name": effect.name,
        "label": words.label(effect),
        "meaning": words.meaning(effect.name),
        "gap_class": declared.gap_class.replace("_", " ") if declared and declared.gap_class != effect.name else "",
        "twins": words.listed([words.title(name) for name in twins(effect.name)] if declared else []),
        "parameters": values,
        "whiskers": whiskers(effect),
    }


def numbers(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Of each number of the model as fitted: what it is, its value with unit and interval, and what the model has."""
    rows = []
    for one in diagnosis.numbers:
        fitted, nominal = Value(one.value, one.low, one.high, one.unit), Value(one.nominal, None, None, one.unit)
        rows.append((words.begin(words.label(one.effect)), words.amount(fitted), words.amount(nominal)))
    return rows


def not_excited(diagnosis: Diagnosis) -> list[tuple[str, list[tuple[str, str]]]]:
    """Names with what they mean, by stage of the signal chain."""
    by: dict[str, list[tuple[str, str]]] = {}
    for name in diagnosis.not_excited:
        stage = EFFECTS[name].stage if name in EFFECTS else "other"
        by.setdefault(stage, []).append((words.title(name), words.meaning(name)))
    order = [*STAGES, "other"]
    return [(STAGE_NAMES.get(stage, stage), by[stage]) for stage in order if stage in by]


def _order(known: tuple[str, ...], present: set[str]) -> list[str]:
    return [name for name in known if name in present] + sorted(present - set(known))


def _finite(value: float | None) -> float:
    return value if value is not None and math.isfinite(value) else 0.0
