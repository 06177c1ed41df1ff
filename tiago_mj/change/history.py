"""A robot's life: magnitudes with intervals over time, what left its interval, and when to look.

A folder holds one entry a date, in the order of their names (``2026-01-15``, ``2026-02-20`` …): a set of recordings, a
diagnosis, or a comparison with the entry before. Sets are compared each with the one before; files are taken as they
are.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tiago_mj.change.report import label, size, styles, values
from tiago_mj.change.result import FILE_NAME, KEPT, Comparison
from tiago_mj.gap.parts import Named, Value
from tiago_mj.gap.report import json as diagnoses
from tiago_mj.gap.report import words
from tiago_mj.io import atomic, pages

#: The page.
PAGE: Final = "history.html"
#: An effect that is said to have changed with at least this probability is one to look at.
SURE: Final = 0.5
#: Size of a drawing [px], and its margin.
WIDTH, HEIGHT, MARGIN = 560, 150, 34


@dataclass(frozen=True)
class Point:
    """A magnitude at one date.

    Attributes:
        date: name of the entry.
        value, low, high: of the parameter, with its 90 % interval where it is known.
        left: whether it lies outside the interval of the date before, and that one's value outside of its own.
    """

    date: str
    value: float
    low: float | None
    high: float | None
    left: bool = False


@dataclass(frozen=True)
class Track:
    """A magnitude over time.

    Attributes:
        name: effect and targets, in words.
        parameter: whose value it is.
        unit: of the value.
        points: by date.
    """

    name: str
    parameter: str
    unit: str
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Life:
    """A robot's life.

    Attributes:
        dates: names of the entries, in order.
        tracks: magnitudes.
        events: (date, what was said to have changed since the date before, whether it is to be looked at).
    """

    dates: tuple[str, ...]
    tracks: tuple[Track, ...]
    events: tuple[tuple[str, str, bool], ...]


def read(folder: Path, compare: Callable[[Path, Path], Comparison]) -> Life:
    """The life that a folder holds.

    Args:
        folder: of the entries.
        compare: two sets of recordings.

    Raises:
        ValueError: there is no such folder, or fewer than two entries in it; one line.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder: give one that holds an entry a date, named so that they sort")
    entries = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    if len(entries) < 2:
        raise ValueError(
            f"{folder}: {len(entries)} entries are no history: give a folder of two or more, one a date "
            "(recordings, a diagnosis or a comparison in each)"
        )
    found: dict[tuple[str, str, str], list[Point]] = {}
    events: list[tuple[str, str, bool]] = []
    before: Path | None = None
    for number, entry in enumerate(entries):
        earlier = entries[number - 1].name if number else None
        if (entry / diagnoses.NAME).is_file():
            for effect in diagnoses.load(entry / diagnoses.NAME).best.effects:
                _add(found, _of_diagnosis(effect), entry.name)
            before = None
            continue
        if (entry / FILE_NAME).is_file():
            one = KEPT.load(entry / FILE_NAME)
        elif before is not None:
            one = compare(before, entry)
        else:
            before = entry
            continue
        before = None if (entry / FILE_NAME).is_file() else entry
        events.append(_event(entry.name, one))
        for row in _of_comparison(one, earlier, entry.name):
            _add(found, row[:2], row[2])
    tracks = tuple(
        Track(*key, _marked(sorted(points, key=lambda point: point.date))) for key, points in sorted(found.items())
    )
    return Life(tuple(entry.name for entry in entries), tracks, tuple(events))


def _of_diagnosis(effect: Named) -> tuple[tuple[str, str, str], Value]:
    parameter, value = next(iter(effect.parameters.items()))
    return (words.label(Named(effect.name, effect.target)), parameter, value.unit), value


def _of_comparison(one: Comparison, first: str | None, second: str) -> list[tuple[tuple[str, str, str], Value, str]]:
    """Magnitudes at both dates of what a comparison says changed; the interval is of the set in which more acts.

    Args:
        one: the comparison.
        first: date of the earlier set; None: no entry is of it.
        second: date of the later one.
    """
    rows = []
    for change in one.best.changes if one.kind == "changed" else ():
        key, amount = (label(change), change.parameter, change.amount.unit), change.amount
        reach = None
        if amount.low is not None and amount.high is not None:
            reach = (amount.high - amount.low) / 2
        for date, value, which in ((first, change.before, "before"), (second, change.after, "after")):
            if value is not None and date is not None:
                far = reach if which == change.acts_in else None
                low, high = (None, None) if far is None else (value - far, value + far)
                rows.append((key, Value(value, low, high, amount.unit), date))
    return rows


def _add(found: dict[tuple[str, str, str], list[Point]], one: tuple[tuple[str, str, str], Value], date: str) -> None:
    """Keep a magnitude; of two at one date the one with an interval."""
    key, value = one
    points = found.setdefault(key, [])
    there = next((point for point in points if point.date == date), None)
    if there is not None:
        if there.low is not None:
            return
        points.remove(there)
    points.append(Point(date, float(value.value), value.low, value.high))


def _marked(points: Sequence[Point]) -> tuple[Point, ...]:
    """Points with whether each left the interval of the one before."""
    out = list(points[:1])
    for before, here in itertools.pairwise(points):
        outside = _outside(here.value, before) and _outside(before.value, here)
        known = before.low is not None or here.low is not None
        out.append(Point(here.date, here.value, here.low, here.high, left=bool(known and outside)))
    return tuple(out)


def _outside(value: float, of: Point) -> bool:
    """Whether a value lies outside the interval of a point; of one without, that is not known and counts as outside."""
    return of.low is None or of.high is None or not of.low <= value <= of.high


def _event(date: str, one: Comparison) -> tuple[str, str, bool]:
    if one.kind == "nothing_changed":
        return date, "nothing changed", False
    if one.kind == "unknown_change":
        return date, "something changed that no effect of the library explains", True
    said = [", ".join(f"{label(change)} {values(change)}" for change in each.changes) for each in one.alternatives]
    sure = one.kind == "ambiguous" or one.probability >= SURE
    return date, words.listed([text or "nothing" for text in said], "or"), bool(sure)


def look(life: Life) -> list[str]:
    """What to look at, in sentences."""
    out = [f"{date}: {said}" for date, said, loud in life.events if loud]
    for track in life.tracks:
        out += [
            f"{point.date}: {track.name}, {track.parameter.replace('_', ' ')}, left its interval: "
            f"now {size(point.value, track.unit)}"
            for point in track.points
            if point.left
        ]
    return sorted(dict.fromkeys(out))


def lines(life: Life) -> list[str]:
    """What is printed."""
    out = [f"{len(life.dates)} dates, {life.dates[0]} to {life.dates[-1]}"]
    for track in life.tracks:
        out.append(f"{track.name}, {track.parameter.replace('_', ' ')}")
        out += [f"  {point.date}  {shown(point, track.unit)}" for point in track.points]
    found = look(life)
    return [*out, "To look at:" if found else "Nothing to look at.", *(f"  {one}" for one in found)]


def shown(point: Point, unit: str) -> str:
    """A magnitude with its interval."""
    return words.amount(Value(point.value, point.low, point.high, unit)) + (", left its interval" * point.left)


def drawing(life: Life, track: Track) -> list[dict[str, float | bool | str]]:
    """Places of a track's points in a drawing of :data:`WIDTH` times :data:`HEIGHT` [px]."""
    ends = [v for p in track.points for v in (p.value, p.low, p.high) if v is not None]
    low, high = min(ends), max(ends)
    span = high - low or abs(high) or 1.0

    def down(value: float) -> float:
        return round(HEIGHT - MARGIN - (value - low) / span * (HEIGHT - 2 * MARGIN), 1)

    step = (WIDTH - 2 * MARGIN) / max(len(life.dates) - 1, 1)
    return [
        {
            "x": round(MARGIN + step * life.dates.index(point.date), 1),
            "y": down(point.value),
            "top": down(point.value if point.high is None else point.high),
            "bottom": down(point.value if point.low is None else point.low),
            "left": point.left,
            "date": point.date,
        }
        for point in track.points
    ]


def render(life: Life) -> str:
    """The page."""
    environment = pages.environment("tiago_mj.change")
    return environment.get_template("history.html.j2").render(
        life=life,
        look=look(life),
        drawn=[(track, drawing(life, track)) for track in life.tracks],
        shown=shown,
        styles=styles(),
        policy=pages.of_page(),
        width=WIDTH,
        height=HEIGHT,
    )


def write(life: Life, folder: Path) -> Path:
    """Write the page."""
    with atomic.replacing_set(folder, parts=(PAGE,)) as new:
        atomic.write_text(new / PAGE, render(life))
    return folder / PAGE
