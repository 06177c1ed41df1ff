"""Gap closed on the test trials: by channel, by phase, and by both, with bootstrap intervals.

Trials are drawn with replacement. Few trials say little about how trials differ; where there are few, moving blocks of
each drawn trial are drawn, too (Künsch 1989; here with the trial closed to a ring, so that its ends are drawn as often
as its middle). All channels are drawn together, as their errors are correlated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.analysis.recorded import Recorded
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.result import PHASES, Closing, Shrink
from tiago_mj.recordings.autocorrelation import integrated_time

Array = NDArray[np.float64]

#: A gap within this of the floor is none: it is not closed.
NOTHING: Final = 0.1
#: So many trials are enough to be drawn whole.
ENOUGH: Final = 8
#: Draws of the bootstrap, and the interval's quantiles.
DRAWS: Final = 400
QUANTILES: Final = (0.05, 0.95)
#: A block is so many correlation times of the residual long, and between these shares of a trial: several make a trial,
#: and no more than need be.
TIMES: Final = 4
SHARES: Final = (1 / 40, 1 / 5)
#: A trial is summed up in at most so many bins: blocks need no finer edges.
BINS: Final = 1000
#: Samples below which a phase of a channel is not reported.
FEWEST: Final = 5


def shrink(recorded: Recorded, before: Array, after: Array) -> Shrink:
    """Mean squared residual before and after on the test trials, in units of the noise floor, and the share closed.

    Args:
        recorded: recordings; where no trial is kept aside, nothing is said.
        before, after: predictions, (ntrials, T, C).
    """
    data, phase, test = recorded.data, recorded.phase, recorded.test
    if not test:
        return Shrink(None, None, 1.0, None, None, None)
    sums = [_binned(data, before[k], after[k], phase[k], k) for k in test]
    index = list(test)
    length = block_rows(noise_model.select_trials(data, index), before[index], after[index])
    drawn = _drawn(sums, length, np.random.default_rng(recorded.seed))
    total = np.sum([part.sum(axis=0) for part in sums], axis=0)
    whole = _closing(total.sum(axis=(0, 1)), drawn.sum(axis=(1, 2)))
    if whole is None:
        return Shrink(None, None, 1.0, None, None, None)
    per_channel = _known({n: _closing(total[c].sum(0), drawn[:, c].sum(1)) for c, n in enumerate(data.channels)})
    per_phase = _known({n: _closing(total[:, p].sum(0), drawn[:, :, p].sum(1)) for p, n in enumerate(PHASES)})
    per_place = {
        name: _known({phase: _closing(total[c, p], drawn[:, c, p]) for p, phase in enumerate(PHASES)})
        for c, name in enumerate(data.channels)
    }
    return Shrink(
        whole.before,
        whole.after,
        1.0,
        whole.closed,
        whole.low,
        whole.high,
        per_channel,
        per_phase=per_phase,
        per_place={name: places for name, places in per_place.items() if places},
        resampled=_said(len(test), length * recorded.plant.period),
    )


def closed(before: float, after: float) -> float | None:
    """Share of the excess over the noise floor (1) that is closed; None without an excess."""
    if before - 1 <= NOTHING:
        return None
    return 1 - (max(after, 1.0) - 1) / (before - 1)


def gone(before: float, after: float) -> float:
    """Share by which a mean squared residual fell, noise included: for a gap no larger than the floor, which is itself
    uncertain."""
    return 1 - after / before if before > 0 else 0.0


def interval(drawn: Sequence[float], share: float) -> tuple[float, float]:
    """90 % interval of a share from its bootstrap draws, widened to contain the share itself."""
    low, high = (float(q) for q in np.quantile(drawn, QUANTILES))
    return min(low, share), max(high, share)


def _said(trials: int, seconds: float) -> str:
    if trials >= ENOUGH:
        return f"{trials} test trials"
    if trials == 1:
        return f"blocks of {seconds:.2g} s of the one test trial"
    return f"{trials} test trials, and blocks of {seconds:.2g} s within each"


def _binned(data: Data, before: Array, after: Array, phase: NDArray[np.int_], k: int) -> Array:
    """Squared residuals before and after, and their number, by time bin, (bins, C, phases, 3), of one trial."""
    value = data.value[k]
    rows = np.flatnonzero(np.isfinite(value).any(axis=1))
    last = int(rows[-1]) + 1 if len(rows) else 1
    count = min(last, BINS)
    known = np.isfinite(value[:last])
    signals = [
        np.where(known, ((value[:last] - before[:last]) / data.floor) ** 2, 0.0),
        np.where(known, ((value[:last] - after[:last]) / data.floor) ** 2, 0.0),
        known.astype(np.float64),
    ]
    cell = (np.arange(last) * count // last) * len(PHASES) + phase[:last]
    out = np.zeros((count, len(PHASES), len(data.channels), 3))
    flat = out.reshape(count * len(PHASES), len(data.channels), 3)
    for s, signal in enumerate(signals):
        for c in range(len(data.channels)):
            flat[:, c, s] = np.bincount(cell, signal[:, c], minlength=len(flat))
    return out.transpose(0, 2, 1, 3)


def block_rows(data: Data, before: Array, after: Array) -> int:
    """Rows of a bootstrap block: a few autocorrelation times of the more correlated residual, the median over channels.

    A slowly varying error is one error however many rows it lasts.

    Args:
        data: measured, of some trials.
        before, after: predictions of these, (ntrials, T, C).
    """
    found = []
    for k in range(len(data.value)):
        for c in range(len(data.channels)):
            times = [
                _correlation((data.value[k, :, c] - signal[k, :, c]) / data.floor[c]) for signal in (before, after)
            ]
            found.append(max(times))
    longest = max(len(np.flatnonzero(np.isfinite(value).any(axis=1))) for value in data.value)
    return max(int(np.clip(TIMES * float(np.median(found)), SHARES[0] * longest, SHARES[1] * longest)), 1)


def _correlation(residual: Array) -> float:
    """Integrated autocorrelation time of a residual about its mean [rows]."""
    known = np.isfinite(residual)
    return integrated_time(residual - residual[known].mean()) if known.any() else 1.0


def _drawn(sums: Sequence[Array], length: int, rng: np.random.Generator) -> Array:
    """Sums over resampled test trials, (DRAWS, C, phases, 3)."""
    ntrials = len(sums)
    picked = rng.integers(ntrials, size=(DRAWS, ntrials))
    out = np.zeros((DRAWS, *sums[0].shape[1:]))
    for k, part in enumerate(sums):
        draw = np.repeat(np.arange(DRAWS), (picked == k).sum(axis=1))  # one entry for each time this trial is drawn
        if ntrials >= ENOUGH:
            np.add.at(out, draw, part.sum(axis=0))
            continue
        bins = len(part)
        size = max(min(round(length * bins / max(_rows(part), 1)), bins), 1)
        ring = np.concatenate([part, part[: size - 1]]).cumsum(axis=0)
        ring = np.concatenate([np.zeros_like(ring[:1]), ring])
        blocks = ring[size:] - ring[:-size]  # of every start
        count = -(-bins // size)
        starts = rng.integers(bins, size=(len(draw), count))
        for column in starts.T:
            np.add.at(out, draw, blocks[column] / (count * size / bins))
    return out


def _rows(part: Array) -> float:
    """Rows of a trial: those of its longest channel."""
    return float(part[..., 2].sum(axis=(0, 2)).max())


def _closing(total: Array, drawn: Array) -> Closing | None:
    """Gap before and after and share closed from sums, (3,), and their draws, (DRAWS, 3); None for hardly any
    samples."""
    if total[2] < FEWEST:
        return None
    before, after = float(total[0] / total[2]), float(total[1] / total[2])
    share = closed(before, after)
    low = high = None
    if share is not None:
        enough = drawn[drawn[:, 2] > 0]
        shares = [s for b, a, n in enough if (s := closed(b / n, a / n)) is not None]
        if shares:
            low, high = interval(shares, share)
    return Closing(before, after, share, low, high)


def _known(found: Mapping[str, Closing | None]) -> dict[str, Closing]:
    return {name: closing for name, closing in found.items() if closing is not None}
