"""What explanations do in blocks that were kept out: the validation blocks, which choose, and the test blocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.analysis import promises
from tiago_mj.gap.analysis.remainder import Remainder, with_accounted
from tiago_mj.gap.result import Shrink
from tiago_mj.gap.torque.evidence import TOLERANCE, Evidence
from tiago_mj.gap.torque.intervals import segments
from tiago_mj.gap.torque.pool import misfit, own_numbers, residual
from tiago_mj.gap.torque.search import Scored
from tiago_mj.gap.torque.tables import channel_name
from tiago_mj.recordings.travel import ENDS, SMALL

Array = NDArray[np.float64]

#: Numbers of the nominal model that are told: those that went farthest, if at all as far as this many deviations.
TOLD: Final = 3
FAR: Final = 1.0


def validated(
    evidence: Evidence, null: Scored, scored: Sequence[Scored], fails: float, seed: int
) -> tuple[Array, NDArray[np.bool_]]:
    """What explanations gain on the validation blocks, fitted to the train blocks alone, and the nominal model's own
    numbers along with each.

    Args:
        evidence: that was searched.
        null: the nominal model.
        scored: explanations.
        fails: misfit above which one fails.
        seed: of the bootstrap.

    Returns:
        Drop of the mean squared residual [squared noise] against the nominal model with its own numbers as they were
        fitted without any effect, (n,), and which are far worse than the best, (n,): none without validation blocks.
    """
    e = evidence
    blocks = e.blocks.validation or e.blocks.train
    piece = segments(e, blocks)
    used = e.moving & (piece >= 0)[:, None]
    if not used.any():
        return np.zeros(len(scored)), np.zeros(len(scored), dtype=bool)
    there = [int(np.searchsorted(e.rows.blocks, b)) for b in e.blocks.train if b in e.rows.blocks]
    samples = _summed(used.astype(float), piece)
    nominal = _summed(np.where(used, (_left(e, null, there) / e.floor.noise) ** 2, 0.0), piece)
    energies, misfits = [], []
    for one in scored:
        left = _left(e, one, there)
        energies.append(_summed(np.where(used, (left / e.floor.noise) ** 2, 0.0), piece))
        misfits.append(misfit(e, left, used))
    energy = np.array(energies)
    gains: Array = (nominal.sum() - energy.sum(axis=1)) / samples.sum()
    if not e.blocks.validation:
        return gains, np.zeros(len(scored), dtype=bool)
    return gains, promises.beaten(energy, samples, np.array(misfits), fails, seed)


def aside(evidence: Evidence, fitted: Scored, shrink: Shrink) -> promises.Aside:
    """What an explanation leaves on the test blocks, the nominal model's own numbers as they were fitted beside it."""
    e = evidence
    used = e.moving & np.isin(e.blocks.of, e.blocks.test)[:, None]
    left = residual(e, fitted)
    return promises.Aside(shrink.closed, float(np.mean((left / e.floor.noise)[used] ** 2)), misfit(e, left, used))


def accounted(evidence: Evidence, fitted: Scored, shrink: Shrink) -> Shrink:
    """Before and after with what is left on the test blocks, the nominal model's own numbers as they were fitted."""
    e = evidence
    used = e.moving & np.isin(e.blocks.of, e.blocks.test)[:, None]
    if not used.any():
        return shrink
    square = np.where(used, (residual(e, fitted) / e.floor.noise) ** 2, 0.0)
    counts = used.sum(axis=0)
    channels = {channel_name(e, c): float(square[:, c].sum() / n) for c, n in enumerate(counts) if n}
    return with_accounted(shrink, Remainder(float(square.sum() / counts.sum()), 0.0, channels))


def spoiled(evidence: Evidence, fitted: Scored, seed: int) -> tuple[str, ...]:
    """A sentence where the nominal model's own numbers, as fitted beside an explanation, spoil the test blocks."""
    e = evidence
    piece = segments(e, e.blocks.test)
    used = e.moving & (piece >= 0)[:, None]
    with_them = residual(e, fitted)
    moved = own_numbers(e, fitted)
    names = {k: v for k, v in fitted.strengths.items() if k not in e.given}
    stated = e.measured - e.predicted(names)
    after, before = (_summed(np.where(used, (left / e.floor.noise) ** 2, 0.0), piece) for left in (with_them, stated))
    numbers = [
        f"{e.terms[k].effect} of {e.terms[k].target} {e.terms[k].identity + fitted.strengths[k]:.3g}" for k in e.given
    ]
    farthest = sorted(range(len(moved)), key=lambda k: -abs(moved[k]))[:TOLD]
    numbers += [
        f"{e.tolerance_names[k]} {100 * TOLERANCE * moved[k]:+.0f} %"
        for k in farthest
        if abs(moved[k]) > FAR and e.tolerance_names[k]
    ]
    return promises.spoiled(after, before, _summed(used.astype(float), piece), numbers, _went(e), seed)


def _left(evidence: Evidence, scored: Scored, blocks: Sequence[int]) -> Array:
    """Residual, (T, c) [N, N·m], of a fit to some blocks, by position, with the nominal model's own numbers in it."""
    e = evidence
    e.refresh(scored.strengths, scored.terms)
    fitted = e.normal.fit([*scored.terms, *e.tolerance], blocks)
    count = len(scored.terms) + len(e.given)
    left = e.measured - e.predicted({k: float(v) for k, v in zip([*scored.terms, *e.given], fitted, strict=False)})
    for amount, column in zip(fitted[count:], e.tolerance_columns, strict=True):
        left = left - amount * column
    return left


def _summed(values: Array, piece: NDArray[np.intp]) -> Array:
    """Sums of values (T, c) by piece, (npieces,); -1: none."""
    inside = piece >= 0
    found: Array = np.bincount(piece[inside], values[inside].sum(axis=1)).astype(float)
    return found


def _went(evidence: Evidence) -> list[str]:
    """Joints that went less far in the blocks that were fitted than in the test."""
    e = evidence
    position, test = e.course.stack("position"), np.isin(e.blocks.of, e.blocks.test)
    found = []
    for j, joint in enumerate(e.course.joints):
        before, after = (float(np.ptp(np.percentile(position[rows, j], ENDS))) for rows in (e.fitted_rows, test))
        if before < SMALL * after:
            unit = "m" if e.torques.wiring.targets.slides[j] else "rad"
            found.append(f"fitted where {joint} moves over {before:.2g} {unit}, held out over {after:.2g} {unit}")
    return found
