"""How far the gap shrinks, as the page draws it: by channel, by channel and phase, and on the task."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from tiago_mj.gap.report import words
from tiago_mj.gap.result import PHASES, Closing, Diagnosis

#: The loudest colour stands for a gap of at least this: near the floor nothing deserves it.
LOUD: Final = 30.0
#: Steps of an axis' labels, times a power of ten.
STEPS: Final = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Bar:
    """Before and after of one channel; positions in per cent on a logarithmic axis that all rows share."""

    channel: str
    before: str
    after: str
    closed: str
    between: str
    worse: bool
    at_before: float | None
    at_after: float | None


@dataclass(frozen=True)
class Shrinking:
    """Rows of the before/after drawing, largest gap first; its axis as (position [%], label); the floor's position."""

    rows: tuple[Bar, ...]
    ticks: tuple[tuple[float, str], ...]
    floor: float


def by_channel(diagnosis: Diagnosis) -> Shrinking:
    """Gap per channel on the test trials, before and after, in units of the floor."""
    items = sorted(diagnosis.shrink.per_channel.items(), key=lambda item: -_finite(item[1].before))
    values = [v for _, c in items for v in (c.before, c.after) if math.isfinite(v) and v > 0]
    floor = diagnosis.shrink.floor if diagnosis.shrink.floor > 0 else 1.0
    low = math.floor(math.log10(min([*values, floor]) + 1e-300))
    high = math.ceil(math.log10(max([*values, floor * 1.01])))

    def at(v: float) -> float | None:
        if not math.isfinite(v):
            return None
        return round(100 * (math.log10(max(v, 10.0**low)) - low) / (high - low), 2)

    rows = tuple(
        Bar(
            name, words.number(c.before), words.number(c.after), words.percent(c.closed),
            words.interval_percent(c.low, c.high), worse(c), at(c.before), at(c.after),
        )
        for name, c in items
    )  # fmt: skip
    step = max(1, math.ceil((high - low) / 6))
    ticks = tuple((at(10.0**k) or 0.0, _power(k)) for k in range(low, high + 1, step))
    return Shrinking(rows, ticks, at(floor) or 0.0)


def worse(closing: Closing) -> bool:
    """Whether the repair makes predictions worse."""
    return closing.after > closing.before * 1.02


@dataclass(frozen=True)
class Pair:
    """Of the map by channel and phase; strengths are 0 to 1 on a logarithmic scale."""

    before: str
    after: str
    strong_before: float
    strong_after: float
    worse: bool
    hover: str


@dataclass(frozen=True)
class Pairs:
    """Channel × phase, largest gap first; None where a channel has no such phase; the last row is of all channels."""

    phases: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Pair | None, ...]], ...]


def by_phase(diagnosis: Diagnosis) -> Pairs:
    """Gap per channel and phase on the test trials, before and after."""
    shrink = diagnosis.shrink
    present = {phase for places in shrink.per_place.values() for phase in places}
    phases = tuple(phase for phase in PHASES if phase in present)
    every = [c for places in shrink.per_place.values() for c in places.values()]
    most = max([LOUD, *(v for c in every for v in (c.before, c.after) if math.isfinite(v))])
    order = sorted(
        shrink.per_place, key=lambda n: -_finite(shrink.per_channel[n].before if n in shrink.per_channel else 0)
    )
    rows = [(name, shrink.per_place[name]) for name in order]
    if len(rows) > 1 and shrink.per_phase:
        rows.append(("all", shrink.per_phase))
    return Pairs(
        phases,
        tuple(
            (name, tuple(None if p not in places else _pair(name, p, places[p], most) for p in phases))
            for name, places in rows
        ),
    )


def _pair(name: str, phase: str, c: Closing, most: float) -> Pair:
    closed = f", {words.percent(c.closed)} closed" if c.closed is not None else ", nothing to close"
    between = words.interval_percent(c.low, c.high)
    hover = f"{name}, {phase}: {words.number(c.before)} \N{RIGHTWARDS ARROW} {words.number(c.after)}{closed}"
    return Pair(
        _short(c.before),
        _short(c.after),
        _strength(c.before, most),
        _strength(c.after, most),
        worse(c) and c.after > 1,
        f"{hover} ({between})" if between else hover,
    )


def _short(gap: float) -> str:
    """Two digits, thousands as k: a cell is narrow."""
    if gap < 0.05:
        return "0"
    if math.isfinite(gap) and gap >= 9950:
        return f"{gap / 1000:.0f}k" if gap < 9.995e5 else f"{gap:.0e}".replace("e+0", "e")
    return words.number(gap, 2)


def _strength(gap: float, most: float) -> float:
    return min(max(math.log10(max(_finite(gap), 1.0)) / math.log10(most), 0.0), 1.0)


@dataclass(frozen=True)
class Return:
    """Of one simulator, or measured; positions in per cent on a linear axis that all rows share.

    ``at`` is the mean, ``low`` and ``high`` the ends of its interval as far as it is known, ``trials`` the returns of
    the trials.
    """

    name: str
    role: str
    text: str
    between: str
    at: float | None
    low: float | None
    high: float | None
    trials: tuple[float, ...]


@dataclass(frozen=True)
class Returns:
    """Returns of a policy with their axis as (position [%], label)."""

    rows: tuple[Return, ...]
    ticks: tuple[tuple[float, str], ...]


def on_the_task(diagnosis: Diagnosis) -> Returns | None:
    """Returns that the nominal and the repaired simulator predict, and the measured one; None where none was asked."""
    task = diagnosis.shrink.task
    if task is None:
        return None
    roles = ["nominal", "repaired", "measured"] if diagnosis.repair else ["nominal", "measured"]
    titles = {"nominal": "nominal simulator", "repaired": "repaired simulator", "measured": "measured"}
    trials = {r: [t[r] for t in (task.get("trials") or {}).values() if t.get(r) is not None] for r in roles}
    shown = [v for r in roles for v in (task.get(r), *trials[r]) if v is not None]
    if not shown:
        return None
    low, high = min(shown), max(shown)
    room = 0.08 * (high - low) or max(0.05 * abs(high), 0.5)
    low, high = low - room, high + room

    def at(value: float | None) -> float | None:
        return None if value is None else round(100 * min(max((value - low) / (high - low), 0.0), 1.0), 2)

    def row(role: str) -> Return:
        ends = task.get(f"{role}_low"), task.get(f"{role}_high")
        decimals = max(0, 3 - math.floor(math.log10(max(abs(high), abs(low), 1e-9))) - 1)
        between = words.span(*ends, decimals)
        places = tuple(p for v in trials[role] if (p := at(v)) is not None)
        return Return(
            titles[role],
            role,
            words.number(task.get(role), 4),
            between,
            at(task.get(role)),
            at(ends[0]),
            at(ends[1]),
            places,
        )

    return Returns(
        tuple(row(role) for role in roles),
        tuple((at(v) or 0.0, words.bare(words.number(v, 4))) for v in _nice(low, high)),
    )


def _nice(low: float, high: float) -> Iterable[float]:
    """Round numbers between both, three to six."""
    power = 10.0 ** math.floor(math.log10((high - low) / 4))
    step = next(s * power for s in STEPS if (high - low) / (s * power) <= 5)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _power(exponent: int) -> str:
    return words.bare(words.number(10.0**exponent)) if -3 <= exponent <= 4 else f"1e{exponent}"


def _finite(value: float | None) -> float:
    return value if value is not None and math.isfinite(value) else 0.0
