"""Numbers of the report: where the gap is, how far it shrinks, and the signals of the blocks that were kept aside."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj import inverse
from tiago_mj.gap.result import BANDS, PHASES, Closing, Overlay, Place, Shrink
from tiago_mj.gap.torque.evidence import Evidence
from tiago_mj.gap.torque.intervals import segments
from tiago_mj.gap.torque.search import Scored
from tiago_mj.gap.torque.terms import ON_THE_EFFORT

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

DRAWS: Final = 400
REST, FREE, REVERSAL = (PHASES.index(name) for name in ("rest", "free motion", "reversal"))
#: Edges of the bands [Hz].
EDGES: Final = (1.0, 5.0)


def efforts(evidence: Evidence, scored: Scored) -> Array:
    """Effort that an explanation predicts, (T, c) [N, N·m].

    At rest dry friction takes the value, within its bounds, that holds the joint, so the prediction there is the
    nearest to what was measured.
    """
    e = evidence
    e.refresh(scored.strengths, scored.terms)
    moving = e.predicted(scored.strengths)
    entries = [e.terms[k].entry(v) for k, v in scored.strengths.items() if e.terms[k].effect not in ON_THE_EFFORT]
    effort = e.transmitted(scored.strengths)
    cols = e.course.columns
    gain = e.gain(scored.strengths)[cols]
    friction = gain * e.torques.dry_friction(entries, effort)[:, cols]
    slack = moving - gain * (e.torques.of(entries, effort) - e.torques.of(entries, effort, dry=False))[:, cols]
    resting = np.clip(e.measured, slack - friction, slack + friction)
    return np.where(e.moving, moving, resting)


def phases(evidence: Evidence) -> Ints:
    """Phase of every row and channel, (T, c): rest, reversal (within the filter's reach of one), or free motion."""
    course = evidence.course
    resting = course.resting()[:, course.columns]
    return np.where(evidence.moving, FREE, np.where(resting, REST, REVERSAL))


def channel_name(evidence: Evidence, c: int) -> str:
    """As in a recording."""
    return f"effort.{evidence.course.channels[c]}"


def unit(evidence: Evidence, c: int) -> str:
    """Of a channel."""
    return "N" if evidence.torques.wiring.targets.slides[evidence.course.columns[c]] else "N·m"


def where(evidence: Evidence, scored: Scored, seed: int, channels: Sequence[int] | None = None) -> tuple[Place, ...]:
    """Mean squared residual over squared noise by channel, phase and band, largest share of the excess first."""
    e = evidence
    left = (e.measured - efforts(e, scored)) / e.floor.noise
    phase = phases(e)
    random = np.random.default_rng(seed)
    piece = np.arange(len(left)) // max(1, int(2 * float(np.median(e.floor.correlation)) * e.course.rate))
    rows: list[tuple[str, str, str, float, float, float, float]] = []
    for c in range(left.shape[1]) if channels is None else channels:
        for p in (REST, FREE, REVERSAL):
            inside = phase[:, c] == p
            if inside.sum() < 2:
                continue
            mean = float(left[inside, c].mean())
            for band, part in _bands(e, np.where(inside, left[:, c] - mean, 0.0), mean, inside):
                if band == BANDS[0]:
                    _, low, high = _interval(left[inside, c], piece[inside], random)
                    edges = (low**2, high**2)
                    gap, low, high = mean**2, 0.0 if low < 0 < high else min(edges), max(edges)
                else:
                    gap, low, high = _interval(part[inside] ** 2, piece[inside], random)
                excess = float(inside.sum()) * max(gap - _expected(e, band), 0.0)
                rows.append((channel_name(e, c), PHASES[p], band, gap, low, high, excess))
    whole = sum(row[-1] for row in rows)
    places = [Place(*row[:-1], row[-1] / whole if whole > 0 else 0.0) for row in rows]
    return tuple(sorted(places, key=lambda place: -place.share))


def shrink(evidence: Evidence, null: Scored, best: Scored, seed: int) -> Shrink:
    """Before and after on the test blocks, rest left out."""
    e = evidence
    if not e.blocks.test:
        return Shrink(None, None, 1.0, None, None, None)
    used = e.moving & np.isin(e.blocks.of, e.blocks.test)[:, None]
    before = ((e.measured - efforts(e, null)) / e.floor.noise) ** 2
    after = ((e.measured - efforts(e, best)) / e.floor.noise) ** 2
    per = {}
    for c in range(used.shape[1]):
        if used[:, c].any():
            b, a = float(before[used[:, c], c].mean()), float(after[used[:, c], c].mean())
            per[channel_name(e, c)] = Closing(b, a, _closed(b, a))
    piece = segments(e, e.blocks.test)
    names = np.unique(piece[piece >= 0])
    sums = np.zeros((len(names), 3))
    for i, name in enumerate(names):
        inside = used & (piece == name)[:, None]
        sums[i] = before[inside].sum(), after[inside].sum(), inside.sum()
    b, a = (float(sums[:, i].sum() / sums[:, 2].sum()) for i in (0, 1))
    drawn = np.random.default_rng(seed).integers(len(names), size=(DRAWS, len(names)))
    totals = sums[drawn].sum(axis=1)
    ratios = [_closed(x / n, y / n) for x, y, n in totals if n > 0]
    known = [r for r in ratios if r is not None]
    closed = _closed(b, a) if best.terms else None
    low, high = np.quantile(known, [0.05, 0.95]) if closed is not None and known else (None, None)
    return Shrink(b, a, 1.0, closed, None if low is None else float(low), None if high is None else float(high), per)


def overlays(evidence: Evidence, null: Scored, best: Scored) -> tuple[Overlay, ...]:
    """Signals of every test block, or of the last block where none was kept aside."""
    e = evidence
    nominal, repaired, phase = efforts(e, null), efforts(e, best), phases(e)
    names = [channel_name(e, c) for c in range(nominal.shape[1])]
    time = e.course.stack("time")
    found = []
    for block in e.blocks.test or e.blocks.fitted[-1:]:
        rows = np.flatnonzero(e.blocks.of == block)
        rows = np.arange(rows[0], rows[-1] + 1)
        turning = np.where((phase[rows] == REVERSAL).any(axis=1), REVERSAL, FREE)
        one = np.where((phase[rows] == REST).all(axis=1), REST, turning)
        found.append(
            Overlay(
                trial=e.blocks.names[block],
                time=time[rows],
                phases=one,
                measured={n: e.measured[rows, c] for c, n in enumerate(names)},
                nominal={n: nominal[rows, c] for c, n in enumerate(names)},
                repaired={n: repaired[rows, c] for c, n in enumerate(names)},
                units={n: unit(e, c) for c, n in enumerate(names)},
                floor={n: float(e.floor.noise[c]) for c, n in enumerate(names)},
            )
        )
    return tuple(found)


def validation_gain(evidence: Evidence, null: Scored, scored: Scored) -> float:
    """Drop of the mean squared residual on validation blocks [squared noise] under a fit to the train blocks."""
    e = evidence
    blocks = e.blocks.validation or e.blocks.train
    used = e.moving & np.isin(e.blocks.of, blocks)[:, None]
    if not used.any():
        return 0.0
    e.refresh(null.strengths, ())
    nominal = e.predicted(null.strengths)
    e.refresh(scored.strengths, scored.terms)
    there = [int(np.searchsorted(e.rows.blocks, b)) for b in e.blocks.train if b in e.rows.blocks]
    fitted = e.normal.fit([*scored.terms, *e.tolerance], there)
    strengths = {k: float(v) for k, v in zip([*scored.terms, *e.given], fitted, strict=False)}
    before = ((e.measured - nominal) / e.floor.noise) ** 2
    after = ((e.measured - e.predicted(strengths)) / e.floor.noise) ** 2
    return float((before - after)[used].mean())


def _closed(before: float, after: float) -> float | None:
    return 1 - (after - 1) / (before - 1) if before > 1 else None


def _bands(evidence: Evidence, centred: Array, mean: float, inside: NDArray[np.bool_]) -> list[tuple[str, Array]]:
    """(band, part of the signal): the mean, and what lies below and above 1 Hz; short phases hold no slow band."""
    course = evidence.course
    parts = [(BANDS[0], np.full(len(centred), mean))]
    if course.cutoff <= EDGES[0] or 2 * EDGES[0] >= course.rate:
        return [*parts, (BANDS[1], centred)]
    slow = np.concatenate(
        [
            inverse.low_pass(piece[:, None], rate=course.rate, cutoff=EDGES[0])[:, 0]
            for piece in np.split(centred, np.cumsum(course.lengths)[:-1])
        ]
    )
    if inside.sum() >= 0.5 * course.rate / EDGES[0]:
        parts.append((BANDS[1], slow))
    return [*parts, (BANDS[2] if course.cutoff <= EDGES[1] else BANDS[3], centred - slow)]


def _expected(evidence: Evidence, band: str) -> float:
    """Share of the noise that falls into a band."""
    cutoff = evidence.course.cutoff
    slow = min(EDGES[0] / cutoff, 1.0)
    return {BANDS[0]: 0.0, BANDS[1]: slow}.get(band, 1 - slow)


def _interval(values: Array, piece: Ints, random: np.random.Generator) -> tuple[float, float, float]:
    """Mean with a 90 % bootstrap interval over pieces."""
    names, inverse_ = np.unique(piece, return_inverse=True)
    sums, counts = np.bincount(inverse_, values), np.bincount(inverse_)
    drawn = random.integers(len(names), size=(DRAWS, len(names)))
    low, high = np.quantile(sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1), [0.05, 0.95])
    return float(values.mean()), float(low), float(high)
