"""Blocks of a recording that are as good as independent, and which of them train, choose and test."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.torque.strips import Course
from tiago_mj.recordings.autocorrelation import integrated_time

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
Mask = NDArray[np.bool_]

#: So many trials are taken as they are; fewer are cut.
ENOUGH_TRIALS: Final = 6
#: Blocks that a recording is cut into, where its correlation time allows.
WANTED: Final = 12
#: Shortest block, in correlation times.
SHORTEST: Final = 3.0
#: At most this share of the motion is given up to the gaps between blocks.
GIVEN_UP: Final = 0.25
#: Assignments that are tried.
TRIES: Final = 400


@dataclass(frozen=True)
class Blocks:
    """Blocks and what each is for.

    Attributes:
        of: (T,) block of every row, -1 in gaps and at rest.
        names: of the blocks.
        train, validation, test: numbers of blocks; validation and test may be empty.
        cut: whether trials were cut.
        length, gap: of the blocks and between them [s]; 0 where trials were taken as they are.
    """

    of: Ints
    names: tuple[str, ...]
    train: tuple[int, ...]
    validation: tuple[int, ...]
    test: tuple[int, ...]
    cut: bool
    length: float = 0.0
    gap: float = 0.0

    @property
    def fitted(self) -> tuple[int, ...]:
        """All but the test blocks."""
        return tuple(sorted(self.train + self.validation))


def cut(course: Course, moving: Mask, correlation: float, seed: int) -> Blocks:
    """Divide a course.

    Args:
        course: strips.
        moving: (T, c) samples that tell something.
        correlation: integrated autocorrelation time of the residual [s].
        seed: of the assignment.
    """
    trial = np.concatenate([np.full(n, s.trial) for n, s in zip(course.lengths, course.strips, strict=True)])
    names = list(dict.fromkeys(trial))
    some: Mask = np.asarray(moving.any(axis=1))
    if len(names) >= ENOUGH_TRIALS:
        of = np.where(some, np.array([names.index(t) for t in trial]), -1)
        there = np.unique(of[of >= 0])
        of = np.where(of >= 0, np.searchsorted(there, of), -1)
        return _assign(course, moving, of, tuple(names[k] for k in there), seed, cut=False)
    runs = _runs(some, course)
    total = sum(stop - start for start, stop in runs) / course.rate
    gap = min(correlation, GIVEN_UP * total / WANTED)
    length = max(SHORTEST * correlation, total / WANTED - gap, 1 / course.cutoff)
    labels: list[str] = []
    of = np.full(len(some), -1)
    time = course.stack("time")
    for start, stop in runs:
        count = max(1, round((stop - start) / course.rate / (length + gap)))
        edges = np.linspace(start, stop + gap * course.rate, count + 1)
        for low, high in itertools.pairwise(edges):
            first, last = round(low), min(round(high - gap * course.rate), stop)
            if last - first < 0.3 * length * course.rate:
                continue
            of[first:last] = len(labels)
            labels.append(f"{trial[first]}[{time[first]:.1f}-{time[last - 1]:.1f} s]")
    of = np.where(some, of, -1)
    there = np.unique(of[of >= 0])
    of = np.where(of >= 0, np.searchsorted(there, of), -1)
    return _assign(course, moving, of, tuple(labels[k] for k in there), seed, cut=True, length=length, gap=gap)


def correlation_time(residual: Array, used: Mask, course: Course) -> Array:
    """Integrated autocorrelation time of each channel [s], (c,); at least that of noise that passed the filter.

    All strips are one process, about one mean: what is the same throughout is what explanations are about, what differs
    from strip to strip is error. Rests and reversals in between are not known.
    """
    least = 1 / (2 * course.cutoff)
    edges = np.cumsum((0, *course.lengths))
    times = []
    for values, there in zip(residual.T, used.T, strict=True):
        if not there.any():
            times.append(least)
            continue
        centred = np.where(there, values - values[there].mean(), np.nan)
        parts = [centred[start:stop] for start, stop in itertools.pairwise(edges)]
        times.append(max(integrated_time(parts) / course.rate, least))
    return np.array(times)


def _runs(some: Mask, course: Course) -> list[tuple[int, int]]:
    """Stretches [start, stop) of motion, never across strips."""
    runs = []
    edges = np.cumsum((0, *course.lengths))
    for start, stop in itertools.pairwise(edges):
        padded = np.concatenate([[False], some[start:stop], [False]])
        changes = np.flatnonzero(padded[1:] != padded[:-1])
        runs += [(int(start + a), int(start + b)) for a, b in zip(changes[::2], changes[1::2], strict=True)]
    return runs


def _assign(
    course: Course,
    moving: Mask,
    of: Ints,
    names: tuple[str, ...],
    seed: int,
    *,
    cut: bool,
    length: float = 0.0,
    gap: float = 0.0,
) -> Blocks:
    """The assignment, of many, in which the least excited channel and direction of any part is excited most."""
    n = len(names)
    if n < 3:
        return Blocks(of, names, tuple(range(n)), (), (), cut, length, gap)
    velocity = course.stack("velocity")[:, course.columns]
    energy = np.zeros((n, velocity.shape[1], 2))
    for b in range(n):
        inside = (of == b)[:, None] & moving
        for side, sign in enumerate((1, -1)):
            energy[b, :, side] = np.where(inside, np.maximum(sign * velocity, 0), 0).sum(axis=0)
    energy /= np.maximum(energy.sum(axis=0), 1e-12)
    held = max(1, round(n / 4))
    random = np.random.default_rng(seed)
    best, parts = -1.0, (np.arange(n),) * 3
    for _ in range(TRIES):
        order = random.permutation(n)
        chosen = order[2 * held :], order[held : 2 * held], order[:held]
        worst = min(float((energy[p].sum(axis=0) * n / len(p)).min()) for p in chosen)
        if worst > best:
            best, parts = worst, chosen
    train, validation, test = (tuple(int(k) for k in np.sort(p)) for p in parts)
    return Blocks(of, names, train, validation, test, cut, length, gap)
