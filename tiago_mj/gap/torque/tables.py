"""Numbers of the report: where the gap is, how far it shrinks, and the signals of the blocks that were kept aside."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.analysis import locate
from tiago_mj.gap.analysis.shrink import closed as closed_share
from tiago_mj.gap.analysis.shrink import interval
from tiago_mj.gap.result import PHASES, Closing, Overlay, Place, Shrink
from tiago_mj.gap.torque.evidence import Evidence
from tiago_mj.gap.torque.intervals import SEGMENT, segments
from tiago_mj.gap.torque.search import Scored
from tiago_mj.gap.torque.terms import ON_THE_EFFORT

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

DRAWS: Final = 400
REST, FREE, REVERSAL = (PHASES.index(name) for name in ("rest", "free motion", "reversal"))


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
    """Mean squared residual over squared noise by channel, phase and band, largest share of the excess first; strips
    are the stretches, and what the bootstrap draws is some correlation times long."""
    e = evidence
    left = (e.measured - efforts(e, scored)) / e.floor.noise
    phase = phases(e)
    edges = np.cumsum((0, *e.course.lengths))
    piece = np.arange(len(left)) // max(1, int(SEGMENT * float(np.median(e.floor.correlation)) * e.course.rate))
    piece += np.repeat(np.arange(len(e.course.lengths)), e.course.lengths)  # no piece in two strips
    signals = {
        channel_name(e, c): [
            locate.Signal(left[start:stop, c], phase[start:stop, c], piece[start:stop])
            for start, stop in itertools.pairwise(edges)
        ]
        for c in (range(left.shape[1]) if channels is None else channels)
    }
    return locate.table(signals, 1 / e.course.rate, e.course.cutoff, seed)


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
            per[channel_name(e, c)] = Closing(b, a, closed_share(b, a))
    piece = segments(e, e.blocks.test)
    names = np.unique(piece[piece >= 0])
    sums = np.zeros((len(names), 3))
    for i, name in enumerate(names):
        inside = used & (piece == name)[:, None]
        sums[i] = before[inside].sum(), after[inside].sum(), inside.sum()
    b, a = (float(sums[:, i].sum() / sums[:, 2].sum()) for i in (0, 1))
    drawn = np.random.default_rng(seed).integers(len(names), size=(DRAWS, len(names)))
    totals = sums[drawn].sum(axis=1)
    ratios = [closed_share(x / n, y / n) for x, y, n in totals if n > 0]
    known = [r for r in ratios if r is not None]
    closed = closed_share(b, a) if best.terms else None
    low, high = interval(known, closed) if closed is not None and known else (None, None)
    return Shrink(b, a, 1.0, closed, low, high, per)


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
