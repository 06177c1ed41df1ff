"""What a diagnosis leaves possible, as a distribution of simulators: effects are drawn from it.

A draw takes one explanation of the reported set by its probability, and its magnitudes together from their joint normal
posterior; the numbers of the nominal model as fitted likewise, from theirs; and every other number of the nominal model
that is known to a prior, one by one. A draw beyond a bound is drawn again.

Numbers as fitted were fitted beside the best explanation as it is. The recordings say nothing of how the two depend on
each other, so they are drawn apart, beside whichever explanation was drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.nominal import check_stock
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.spec import Entry
from tiago_mj.effects.targets import overlap
from tiago_mj.io.quantities import NINETY, scaled
from tiago_mj.io.schema import first_fault

Array = NDArray[np.float64]

#: Draws of a block until one lies within its bounds; then the last is put on them. Of a normal whose mean is at a bound
#: half of the draws are within: of ten such numbers at once one draw in 2^10.
TRIES: Final = 4_000


@dataclass(frozen=True)
class Number:
    """A number that is drawn.

    Attributes:
        of: index of its effect in the block.
        parameter: of that effect.
        logarithm: whether its logarithm is normal, not itself.
        low, high: its bounds; None: there is none.
        unit: of it.
    """

    of: int
    parameter: str
    logarithm: bool
    low: float | None
    high: float | None
    unit: str

    def coordinate(self, value: float) -> float:
        """Of the normal distribution."""
        return math.log(value) if self.logarithm else value

    def value(self, coordinate: float) -> float:
        """Of the effect's parameter."""
        return math.exp(coordinate) if self.logarithm else coordinate

    def holds(self, value: float) -> bool:
        """Whether a value lies within the bounds."""
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)

    def bounded(self, value: float) -> float:
        """The nearest value within the bounds."""
        return min(
            max(value, -math.inf if self.low is None else self.low), math.inf if self.high is None else self.high
        )


@dataclass(frozen=True)
class Block:
    """Numbers that are drawn together: jointly normal, within bounds.

    Attributes:
        effects: with the values about which they are drawn, and with those that are not drawn.
        numbers: that are drawn.
        covariance: of their coordinates, (k, k).
    """

    effects: tuple[Entry, ...]
    numbers: tuple[Number, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()

    @property
    def values(self) -> list[float]:
        """About which they are drawn."""
        return [self.effects[one.of].parameters[one.parameter] for one in self.numbers]

    @property
    def mean(self) -> Array:
        """Of the coordinates, (k,)."""
        return np.array([one.coordinate(v) for one, v in zip(self.numbers, self.values, strict=True)])

    def sample(self, rng: np.random.Generator) -> tuple[Entry, ...]:
        """The effects with values that are drawn."""
        if not self.numbers:
            return self.effects
        mean, root = self.mean, _root(np.array(self.covariance))
        for _ in range(TRIES):
            drawn = mean + root @ rng.standard_normal(len(mean))
            values = [one.value(float(x)) for one, x in zip(self.numbers, drawn, strict=True)]
            if all(one.holds(value) for one, value in zip(self.numbers, values, strict=True)):
                break
        return self.at([one.bounded(value) for one, value in zip(self.numbers, values, strict=True)])

    def at(self, values: Sequence[float]) -> tuple[Entry, ...]:
        """The effects with these values of the numbers that are drawn."""
        parameters = [dict(effect.parameters) for effect in self.effects]
        for one, value in zip(self.numbers, values, strict=True):
            parameters[one.of][one.parameter] = value
        return tuple(
            Entry(effect.name, effect.target, own, fitted=True)
            for effect, own in zip(self.effects, parameters, strict=True)
        )

    def ends(self) -> list[tuple[float, float]]:
        """The 90 % interval of each number, by itself."""
        reach = NINETY * np.sqrt(np.array([row[k] for k, row in enumerate(self.covariance)]))
        return [
            (one.bounded(one.value(m - r)), one.bounded(one.value(m + r)))
            for one, m, r in zip(self.numbers, self.mean.tolist(), reach.tolist(), strict=True)
        ]


@dataclass(frozen=True)
class Weighed:
    """An explanation of the reported set, with its probability and its magnitudes."""

    probability: float
    block: Block


@dataclass(frozen=True)
class Left:
    """A number of the nominal model that the repair leaves as it is.

    Attributes:
        block: the one number, about its nominal value.
        left: share of its prior's standard deviation that the recordings leave; 1: it is the prior's.
    """

    block: Block
    left: float


@dataclass(frozen=True)
class Posterior:
    """A distribution of simulators.

    Attributes:
        source: the file that it was read from, with its folder.
        sha256: fingerprint of what that says; empty where it is not known.
        explanations: of the reported set.
        numbers: of the nominal model as fitted; no effects where there are none.
        open_numbers: its other numbers.
        notes: sentences on what the file did not say.
    """

    source: str
    sha256: str
    explanations: tuple[Weighed, ...]
    numbers: Block = Block(())
    open_numbers: tuple[Left, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def remainder(self) -> float:
        """Probability that is on nothing that was reported; draws are as if it were 0."""
        return max(1.0 - sum(one.probability for one in self.explanations), 0.0)

    @property
    def shares(self) -> Array:
        """Of the draws, each explanation's: its probability over that of the reported set, (n,)."""
        given = np.array([one.probability for one in self.explanations])
        return np.asarray(given / given.sum())

    def sample(self, rng: np.random.Generator) -> tuple[Entry, ...]:
        """Effects of one simulator."""
        chosen = self.explanations[int(rng.choice(len(self.explanations), p=self.shares))].block
        return self._whole(chosen, lambda block: block.sample(rng))

    def _whole(self, chosen: Block, values: Callable[[Block], tuple[Entry, ...]]) -> tuple[Entry, ...]:
        """An explanation and the numbers that it leaves as they are, with these values of each."""
        mine = values(chosen)
        beside = [values(one.block) for one in self.open_numbers if not _changed(one.block.effects[0], mine)]
        return (*mine, *values(self.numbers), *(entry for entries in beside for entry in entries))

    def drawn(self) -> dict[str, list[tuple[str, ...]]]:
        """Names of all effects that have numbers that are drawn, with their targets; no names: all."""
        out: dict[str, list[tuple[str, ...]]] = {}
        blocks = (*(one.block for one in self.explanations), self.numbers, *(one.block for one in self.open_numbers))
        for block in blocks:
            for k, effect in enumerate(block.effects):
                if any(one.of == k for one in block.numbers):
                    out.setdefault(effect.name, []).append(effect.target or ())
        return out

    def extremes(self) -> list[tuple[Entry, ...]]:
        """For each explanation the simulators with all numbers at the lower and at the upper ends of their 90 %
        intervals: what must fit a model that is to be drawn for."""

        def at(end: int) -> Callable[[Block], tuple[Entry, ...]]:
            return lambda block: block.at([ends[end] for ends in block.ends()])

        return [self._whole(one.block, at(end)) for one in self.explanations for end in (0, 1)]

    def check_fits(self, model: mujoco.MjModel, wiring: Wiring) -> None:
        """Refuse what cannot be drawn for a model.

        Raises:
            ValueError: it names a part that the model does not have, or takes away more than there is; one line.
        """
        for entries in self.extremes():
            check_stock(entries, model, wiring)

    def as_data(self) -> dict[str, Any]:
        """As JSON data."""
        data: dict[str, Any] = _FORM.dump_python(self, mode="json")
        return data

    @classmethod
    def of_data(cls, data: Any) -> Posterior:
        """Of JSON data.

        Raises:
            ValueError: it has another form; one line.
        """
        try:
            return _FORM.validate_python(data)
        except ValidationError as error:
            fault = first_fault(error, data)
            raise ValueError(f"a posterior's {fault.path} {fault.problem}") from error


_FORM: Final = TypeAdapter(Posterior)


def described(posterior: Posterior) -> list[str]:
    """What is drawn, a line each."""
    lines = [f"drawn from the posterior of {posterior.source}:"]
    for one, share in zip(posterior.explanations, posterior.shares.tolist(), strict=True):
        what = _said(one.block) or "no effect"
        lines.append(f"  {100 * share:.3g} % of the episodes: {what}")
    if posterior.remainder > ROUNDING:
        lines.append(
            f"  probability {posterior.remainder:.2g} is on nothing that was reported: the shares above are of the rest"
        )
    if posterior.numbers.numbers:
        lines.append(f"  numbers as fitted: {_said(posterior.numbers)}")
    spoken = [one for one in posterior.open_numbers if one.left < 1]
    silent = [one for one in posterior.open_numbers if one.left >= 1]
    if spoken:
        lines.append("  other numbers, narrowed by the recordings: " + "; ".join(_said(one.block) for one in spoken))
    if silent:
        lines.append("  the prior's, as no recording speaks of them: " + "; ".join(_said(one.block) for one in silent))
    return [*lines, *(f"  {note}" for note in posterior.notes)]


#: A probability that is left over below this is what is written with six digits.
ROUNDING: Final = 1e-4


def _said(block: Block) -> str:
    """Its numbers with their 90 % intervals."""
    out, ends = [], block.ends()
    for k, effect in enumerate(block.effects):
        on = "" if effect.target is None else f" on {', '.join(effect.target)}"
        mine = [
            f"{one.parameter} {_interval(low, high, one.unit)}"
            for one, (low, high) in zip(block.numbers, ends, strict=True)
            if one.of == k
        ]
        out.append(f"{effect.name}{on} {', '.join(mine)}".rstrip())
    return "; ".join(out)


def _interval(low: float, high: float, unit: str) -> str:
    factor, shown = scaled(max(abs(low), abs(high)), unit)
    return f"{low * factor:.3g} to {high * factor:.3g} {shown}".rstrip()


def _changed(number: Entry, effects: Sequence[Entry]) -> bool:
    """Whether an explanation changes the same number of the model."""
    return any(one.name == number.name and overlap(one.target, number.target) for one in effects)


def _root(covariance: Array) -> Array:
    """A matrix whose square is the covariance, which rounding may have made slightly indefinite."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def switch(effect: str) -> str:
    """The parameter of an effect that a diagnosis fits first."""
    return next(one.name for one in EFFECTS[effect].parameters.values() if one.identity is not None)


def is_factor(effect: str, parameter: str) -> bool:
    """Whether a parameter multiplies what the model has."""
    declared = EFFECTS[effect].parameters
    return parameter in declared and declared[parameter].identity == 1.0
