"""Points in the space of explanations: where a fit begins, what is simulated, and where it ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference.hypotheses import Candidate

Array = NDArray[np.float64]

#: Step of a nuisance for its finite-difference response [deviations]: contacts are nonlinear, so it is not small.
#: Halved and doubled, none of 16 answers about hinges changes (varied.json).
NUISANCE_STEP: Final = 0.3


@dataclass(frozen=True)
class Fitted:
    """An explanation at its best.

    Attributes:
        parts: candidates, none for the nominal model.
        values: fitted magnitudes, (k,).
        deviations: of the magnitudes, (k,), one standard deviation.
        nuisance: deviations of the global terms, then of the per-trial terms trial by trial.
        evidence: log of the probability of the recordings under the explanation.
        prior: part of the evidence that is not log-likelihood: log-prior of nuisances and magnitudes, and the Occam
            factor [nats].
        lasting: mean square of the worst channel's residual over blocks, see
            :func:`tiago_mj.gap.inference.likelihood.lasting`.
        misfit: mean squared residual of the worst channel, in units of floor and tolerance.
        sharp: the larger of these two in units of noise and tolerance as they are beside the best explanation; None:
            not known.
        agreement: what trials gain by its effects over what they gain and lose together [nats]; None: not known.
        spreads: deviations of details that were fitted after it (:mod:`tiago_mj.gap.analysis.place`), by name.
        nuisance_deviations: of ``nuisance``, one standard deviation; None: not known.
        correlation: of the magnitudes, (k, k), and of the nuisances, (p, p); None: not known.
        second_deviations: of each candidate, deviations of the logarithms of its second numbers, by name; none: not
            known.
        marginal: deviations of the magnitudes where second numbers are as uncertain as that, (k,); None: as
            ``deviations``, which hold them.
    """

    parts: tuple[Candidate, ...]
    values: Array
    deviations: Array
    nuisance: Array
    evidence: float
    misfit: float
    prior: float = 0.0
    lasting: float = 0.0
    sharp: float | None = None
    agreement: float | None = None
    spreads: Mapping[str, float] = field(default_factory=dict)
    nuisance_deviations: Array | None = None
    correlation: tuple[Array, Array] | None = None
    second_deviations: tuple[Mapping[str, float], ...] = ()
    marginal: Array | None = None

    @property
    def told(self) -> Array:
        """Deviations of the magnitudes as intervals tell them, (k,): a second number was chosen, too."""
        if self.marginal is None:
            return self.deviations
        rest = self.deviations[len(self.marginal) :]
        return np.concatenate([np.maximum(self.marginal, self.deviations[: len(self.marginal)]), rest])

    def effects(self) -> tuple[Entry, ...]:
        """The effects at their magnitudes, without the nuisances."""
        return tuple(part.entry(float(v)) for part, v in zip(self.parts, self.values, strict=True))


@dataclass(frozen=True)
class Start:
    """Where a fit begins: candidates, their magnitudes (k,), nuisances (size,), all 0 if None.

    Attributes:
        alternatives: further pairs of magnitudes and nuisances of the same candidates; the fit begins at the pair with
            the lowest cost.
    """

    parts: tuple[Candidate, ...]
    values: Array
    nuisance: Array | None = None
    alternatives: tuple[tuple[Array, Array], ...] = ()


@dataclass(frozen=True)
class Point:
    """What is simulated on every trial: candidates, magnitudes (k,), nuisances (size,)."""

    parts: tuple[Candidate, ...]
    values: Array
    nuisance: Array

    @classmethod
    def of(cls, there: Fitted | Start) -> Point:
        """Of a fit, or of a start that says its nuisances."""
        assert there.nuisance is not None
        return cls(there.parts, there.values, there.nuisance)

    def with_effect(self, part: Candidate, value: float) -> Point:
        """With another candidate."""
        return Point((*self.parts, part), np.append(self.values, value), self.nuisance)

    def without_effect(self, part: int) -> Point:
        """Without one of its candidates."""
        rest = [k for k in range(len(self.parts)) if k != part]
        return Point(tuple(self.parts[k] for k in rest), self.values[rest], self.nuisance)

    def with_value(self, part: int, value: float) -> Point:
        """With another magnitude of one of its candidates, within its bounds."""
        values = self.values.copy()
        values[part] = min(max(value, self.parts[part].low), self.parts[part].high)
        return Point(self.parts, values, self.nuisance)

    def with_second_number(self, part: int, name: str, times: float) -> Point:
        """With so many times a fixed number of one of its candidates."""
        parts = list(self.parts)
        fixed = tuple((key, times * value if key == name else value) for key, value in parts[part].fixed)
        parts[part] = replace(parts[part], fixed=fixed)
        return Point(tuple(parts), self.values, self.nuisance)

    def nudged(self, which: slice, step: float = NUISANCE_STEP) -> Point:
        """A little further in some nuisances."""
        nuisance = self.nuisance.copy()
        nuisance[which] += step
        return Point(self.parts, self.values, nuisance)
