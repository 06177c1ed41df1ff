"""What the readings themselves betray, whatever the motion: repeats, a grid, the size of the noise.

A dropped reading repeats the one before exactly, a quantised one lies on a grid, and more noise is more scatter.
Predicted means are blind to all three, so they are compared here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.effects.spec import Entry

Array = NDArray[np.float64]

#: Log-likelihood of a grid that is there and not explained, or explained and not there.
DECISIVE: Final = -200.0
#: A sensor's noise is known to about this share.
NOISE_SHARE: Final = 0.12


@dataclass(frozen=True)
class Trace:
    """Of one channel.

    Attributes:
        channel: its name.
        noise: scatter of one sample at rest; ``noise_samples`` differences went into it.
        repeats: number of readings that equal the one before exactly, of ``samples``.
        grid: step of the grid that all readings lie on, 0 if they lie on none.
        expected: the noise that the nominal sensor has; 0 for one without.
    """

    channel: str
    noise: float
    noise_samples: int
    repeats: int
    samples: int
    grid: float
    expected: float


def trace(channel: str, values: Array, quiet: NDArray[np.bool_], expected: float) -> Trace:
    """Look at the readings of a channel.

    Args:
        channel: its name.
        values: (ntrials, T), NaN where nothing was measured.
        quiet: rows in which the signal is predicted to stand still, (ntrials, T).
        expected: noise that the nominal sensor has.
    """
    steps = np.diff(values, axis=1)
    known = np.isfinite(steps)
    still = known & quiet[:, 1:] & quiet[:, :-1]
    different = steps[still & (steps != 0)]
    noise = 1.4826 * float(np.median(np.abs(different))) / np.sqrt(2) if len(different) > 10 else 0.0
    return Trace(
        channel=channel,
        noise=noise,
        noise_samples=len(different),
        repeats=int((steps[known] == 0).sum()),
        samples=int(known.sum()),
        grid=grid_step(values[np.isfinite(values)]),
        expected=expected,
    )


def grid_step(values: Array) -> float:
    """Step of the grid that all values lie on; 0 if there is none or it is finer than a thousandth of their range."""
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) > 0.5 * len(values):
        return 0.0
    gaps = np.diff(levels)
    step = float(gaps.min())
    if step <= 1e-4 * float(levels[-1] - levels[0]):
        return 0.0
    multiples = gaps / step
    return step if float(np.abs(multiples - np.round(multiples)).max()) < 1e-3 else 0.0


def log_likelihood(traces: Sequence[Trace], entries: Sequence[Entry]) -> float:
    """Log-likelihood of the traces, given effects, up to a constant."""
    return sum(_one(trace, entries) for trace in traces)


def _one(trace: Trace, entries: Sequence[Entry]) -> float:
    kind, _, name = trace.channel.partition(".")
    effects = {e.name: e.parameters for e in entries if e.target is None or name in e.target}
    total = 0.0
    step_name = "force_quantization" if kind == "force" else "encoder_quantization"
    step = effects.get(step_name, {}).get("step", 0.0)
    if trace.grid and not step:
        total += DECISIVE
    if step:
        total += DECISIVE if not trace.grid else -0.5 * min(((step - trace.grid) / (0.02 * trace.grid)) ** 2, 400.0)
    if kind != "force" or not trace.expected:
        return total
    if not trace.grid:
        share = effects.get("force_dropout", {}).get("probability", 0.0)
        share = min(max(share, 1e-4), 0.999)
        observed = trace.repeats / max(trace.samples, 1)
        likeliest = min(max(observed, 1e-4), 0.999)
        total += trace.samples * (
            observed * np.log(share / likeliest) + (1 - observed) * np.log((1 - share) / (1 - likeliest))
        )
        if trace.noise_samples > 20 and trace.noise > 0:
            factor = effects.get("force_noise", {}).get("factor", 1.0)
            error = np.log(trace.noise / (trace.expected * factor))
            spread = (
                1.0 / trace.noise_samples + NOISE_SHARE**2 if "force_noise" not in effects else 1 / trace.noise_samples
            )
            total += -0.5 * min(error**2 / (spread + 0.02**2), 400.0)
    return float(total)
