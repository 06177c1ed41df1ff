"""Fitters of a change: effects that act in one of two sets of recordings alone.

What the model gets wrong is the same before and after. Where both sets repeat the same commands it cancels in the
difference of the two recordings, which is compared with the difference of two simulations; where they do not, both
sets are fitted with the same numbers of the nominal model, and what these leave of the reference set is tolerated in
both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import noise_model, sensor_noise, step_tolerance
from tiago_mj.gap.inference.fit import Array, Fitter, Point
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.simulation.subset import Subset

#: Share of the tolerance of any two simulators that is left in a difference of two recordings of the same commands, in
#: which what the model gets wrong cancels to first order: as beside an explanation
#: (:data:`tiago_mj.gap.inference.step_tolerance.BESIDE`). Halved and doubled, none of 12 answers about pairs of
#: sessions changes (varied_pairs.json).
LEFT: float = step_tolerance.BESIDE


@dataclass
class JointFitter(Fitter):
    """Fits both sets, with candidates that act in one of them alone.

    Attributes:
        changed: indices of the trials in which candidates act.
    """

    changed: frozenset[int] = frozenset()

    @property
    def acting(self) -> NDArray[np.bool_]:
        """Mask of the trials in which candidates act, (ntrials,): those of the changed set."""
        return np.array([trial in self.changed for trial in self.trials], dtype=bool)

    def effects(self, parts: Sequence[Candidate], values: Array, nuisance: Array, trial: int) -> tuple[Entry, ...]:
        """What is simulated for a trial (by its position among the trials)."""
        if self.trials[trial] not in self.changed:
            parts, values = (), np.zeros(0)
        return super().effects(parts, values, nuisance, trial)

    def of_both(self) -> Fitter:
        """With candidates that act in both sets: they are no change."""
        return replace(self, changed=frozenset(self.trials))


@dataclass
class DifferenceFitter(Fitter):
    """Fits differences of two recordings of the same commands: of a trial in which candidates act, less its partner.

    Attributes:
        partner: by the index of a trial, that of the trial of the other set.
        both: whether candidates act in both sets.
    """

    partner: dict[int, int] = field(default_factory=dict)
    both: bool = False

    def of_both(self) -> Fitter:
        """With candidates that act in both sets: they are no change."""
        return replace(self, both=True)

    def selection_penalty(self, part: Candidate) -> float:
        """As of :meth:`Fitter.selection_penalty`, of both recordings of a pair where candidates act in both."""
        penalty = super().selection_penalty(part)
        if not self.both:
            return penalty
        others = replace(self, trials=Subset.of(self.partner[trial] for trial in self.trials))
        return penalty + Fitter.selection_penalty(others, part)

    def predictions(self, points: Sequence[Point], *, keep: bool = False) -> Array:
        """Differences of simulations, (npoints, ntrials, T, C); ``keep``: remember the physics."""
        changed = super().predictions(points, keep=keep)
        others = replace(self, trials=Subset.of(self.partner[trial] for trial in self.trials))
        if self.both:
            return changed - Fitter.predictions(others, points)
        bare = [Point((), np.zeros(0), point.nuisance) for point in points]
        distinct = {point.nuisance.tobytes(): point for point in bare}
        predicted = Fitter.predictions(others, list(distinct.values()), keep=True)
        of = dict(zip(distinct, predicted, strict=True))
        return changed - np.stack([of[point.nuisance.tobytes()] for point in bare])


def differences(data: Data, base: Array, pairs: Sequence[tuple[int, int]]) -> Data:
    """Differences of pairs of recordings, with their noise and what is left to tolerate in them.

    Args:
        data: measured, of all trials.
        base: predicted without a change, of all trials, (ntrials, T, C).
        pairs: indices of a trial and of its partner, which is subtracted.
    """
    one, other = (noise_model.select_trials(data, [pair[k] for pair in pairs]) for k in (0, 1))
    value = one.value - other.value
    expected = base[[pair[0] for pair in pairs]] - base[[pair[1] for pair in pairs]]
    least = np.sqrt(2) * (data.noise if data.least is None else data.least)
    grid = np.zeros(len(data.channels)) if data.step is None else data.step / np.sqrt(6)
    noise = np.array(
        [
            max(sensor_noise.floor((value - expected)[:, :, c], float(least[c])), float(grid[c]))
            for c in range(len(data.channels))
        ]
    )
    tolerated = LEFT * np.sqrt(np.maximum((one.sigma**2 + other.sigma**2) / 2 - data.own**2, 0.0))
    common = LEFT * np.sqrt((one.common**2 + other.common**2) / 2)
    sigma = np.sqrt(noise**2 + tolerated**2)
    return replace(
        data, value=value, noise=noise, sigma=sigma, common=common, step=None, least=least, stepless=None, assumed=None
    )
