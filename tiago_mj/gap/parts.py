"""The parts that rankings and tables of a result are made of, in memory and as a file has them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, Field, PlainSerializer, WithJsonSchema, WrapSerializer

from tiago_mj.effects.spec import Entry, read_effects

PHASES: Final = ("rest", "free motion", "reversal", "contact onset", "loading", "hold", "release")


def written(target: str | tuple[str, ...]) -> str | list[str]:
    """A target as a file has it: ``"all"``, a name, several; one alone is no list."""
    if isinstance(target, str):
        return target
    return target[0] if len(target) == 1 else list(target)


def target_of(names: tuple[str, ...] | None) -> str | tuple[str, ...]:
    """A target of names, None for all: ``"all"``, a name, several."""
    if names is None:
        return "all"
    return names[0] if len(names) == 1 else names


def _in_order(given: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping in the order of its keys; phases in that of a motion."""
    return dict(sorted(given.items(), key=lambda one: (one[0] in PHASES and PHASES.index(one[0]), one[0])))


#: A number, NaN where it is not known: null in the file.
Number = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    WithJsonSchema({"type": ["number", "null"]}),
]
Target = Annotated[str | tuple[str, ...], PlainSerializer(written, return_type=str | list[str])]
Sorted = WrapSerializer(lambda given, written: written(_in_order(given)))


@dataclass(frozen=True)
class Value:
    """A parameter with its 90 % interval, in ``unit``, and the standard deviations, where there are any, of its fit
    alone and of what no recording tells of it."""

    value: Number
    low: float | None
    high: float | None
    unit: str
    deviation: float | None = None
    known_to: float | None = None


Parameters = Annotated[Mapping[str, Value], Sorted]


@dataclass(frozen=True)
class Named:
    """An effect on its targets, with what was fitted; ``target`` is ``"all"``, one name or several."""

    name: str
    target: Target
    parameters: Parameters = field(default_factory=dict)

    @property
    def targets(self) -> tuple[str, ...] | None:
        """Names of its targets; None: all of them."""
        if self.target == "all":
            return None
        return (self.target,) if isinstance(self.target, str) else tuple(self.target)

    def entry(self) -> Entry:
        """As simulators take it.

        Raises:
            ValueError: there is no such effect or parameter, as in a file of another version; one line.
        """
        values = {key: {"value": value.value} for key, value in self.parameters.items()}
        (found,) = read_effects([{"name": self.name, "target": written(self.target), "parameters": values}])
        return found


@dataclass(frozen=True)
class FittedNumber:
    """A number of the nominal model as it was fitted, as the effect that changes it.

    Attributes:
        name: of the effect.
        target: ``"all"``, one name or several.
        parameter: of the effect.
        value: as fitted.
        low, high: ends of its 90 % interval.
        unit: of these.
        nominal: the parameter's value where the model is as it was given.
    """

    name: str
    target: Target
    parameter: str
    value: Number
    low: Number
    high: Number
    unit: str
    nominal: Number

    @property
    def effect(self) -> Named:
        """The same as an effect with one parameter."""
        return Named(self.name, self.target, {self.parameter: Value(self.value, self.low, self.high, self.unit)})


@dataclass(frozen=True)
class Likeness:
    """A magnitude on parts that are built alike, such as legs: each fitted by itself.

    Attributes:
        name: of the effect.
        place: which of a part's joints.
        parameter: of the effect.
        values: by part.
        common: of the parts that agree; None where no two do.
        chi_square: of the differences between all of the parts.
        probability: that parts with the same magnitude differ so much.
        differs: parts that do not agree with the rest; empty where all agree.
    """

    name: str
    place: str
    parameter: str
    values: Mapping[str, Value]
    common: Value | None
    chi_square: Number
    probability: Number
    differs: tuple[str, ...] = ()


@dataclass(frozen=True)
class FitQuality:
    """How well an explanation meets the recordings, and what it costs.

    Attributes:
        met: how well it meets the recordings it was fitted to [nats].
        price: what it costs: nominal numbers that had to move, freedom that its magnitudes have, rarity [nats].
        misfit: mean squared residual of the worst channel, in units of floor and tolerance.
        lasting: mean square of the worst channel's residual over quarters of a second, in units of what it should
            scatter by.
        edge: whether one of its magnitudes lies at the bound of what is possible.
        sharp: the larger of ``misfit`` and ``lasting`` in units of what is left to tolerate beside the best
            explanation; None: not known.
        agreement: what trials gain by its effects over what they gain and lose together [nats]; None: not known.
    """

    met: Number
    price: Number
    misfit: Number
    lasting: Number
    edge: bool = False
    sharp: float | None = None
    agreement: float | None = None


@dataclass(frozen=True)
class Joint:
    """Joint posterior of numbers that were fitted together: normal about their values, within bounds.

    Attributes:
        logarithms: of each, whether its coordinate is its logarithm, as of a factor of the nominal model's number.
        covariance: of the coordinates, (k, k), as wide as the numbers' intervals are.
        low, high: bounds of the numbers themselves; None: there is none.
    """

    logarithms: tuple[bool, ...]
    covariance: tuple[tuple[float, ...], ...]
    low: tuple[float | None, ...]
    high: tuple[float | None, ...]


@dataclass(frozen=True)
class OpenNumber:
    """A number of the nominal model that the repair leaves as it is, with what is known of it.

    Attributes:
        name, target, parameter, unit: as a :class:`FittedNumber`'s.
        nominal: the parameter's value where the model is as it was given.
        low, high: ends of the 90 % interval of its prior, narrowed by what the recordings say.
        left: share of the prior's standard deviation that the recordings leave; 1: none of them speaks of it.
        least, most: bounds of the parameter; None: there is none.
    """

    name: str
    target: Target
    parameter: str
    nominal: Number
    low: Number
    high: Number
    unit: str
    left: Number
    least: float | None = None
    most: float | None = None


@dataclass(frozen=True)
class Explanation:
    """A set of effects that may explain the gap; the empty set is the nominal model.

    Attributes:
        effects: none, one or two.
        probability: calibrated, that it is the true one, up to its classes; NaN where the search did not come to its
            end.
        validation_gain: drop of the validation trials' mean squared residual [in units of the floor] against the
            nominal model with its own numbers as they were fitted, nothing added: 0 for the empty set; NaN: not known.
        evidence: for it; None where it was judged otherwise.
        parameters: those of the effects, by :func:`keys`: where the file has them.
        joint: posterior of its magnitudes, one for each effect, in their order; None: not known.
    """

    effects: tuple[Named, ...]
    probability: Number
    validation_gain: Annotated[Number, Field(json_schema_extra={"default": None})] = math.nan
    evidence: FitQuality | None = None
    parameters: Mapping[str, Parameters] = field(default_factory=dict, repr=False)
    joint: Joint | None = None

    def __post_init__(self) -> None:
        names, given = keys(self.effects), self.parameters
        effects = [
            effect if effect.parameters else replace(effect, parameters=given.get(name, {}))
            for name, effect in zip(names, self.effects, strict=True)
        ]
        object.__setattr__(self, "effects", tuple(effects))
        held = {name: effect.parameters for name, effect in zip(names, effects, strict=True)}
        object.__setattr__(self, "parameters", held)


def identity(one: Explanation) -> tuple[tuple[str, str | tuple[str, ...]], ...]:
    """What an explanation names, without its numbers."""
    return tuple((effect.name, effect.target) for effect in one.effects)


def keys(effects: Sequence[Named]) -> list[str]:
    """Of a ranking's ``parameters``: the effect's name, with its target where one effect is there twice."""
    names = [effect.name for effect in effects]
    long = [[e.name, *(e.targets or ("all",))] for e in effects]
    return [name if names.count(name) == 1 else ":".join(words) for name, words in zip(names, long, strict=True)]


@dataclass(frozen=True)
class NextMotion:
    """The motion of the menu that best tells the alternatives apart."""

    file: str
    resolves: tuple[tuple[str, str], ...]
    expected_probability: Number


@dataclass(frozen=True)
class Place:
    """One row of the gap table. ``gap`` is the mean squared residual in units of the floor; ``share`` of the excess."""

    channel: str
    phase: str
    band: str
    gap: Number
    low: Number
    high: Number
    share: Number


@dataclass(frozen=True)
class Closing:
    """Gap of a part of the test trials, before and after; ``closed`` is None where there was nothing to close.

    ``low`` and ``high`` are the ends of its 90 % interval, which holds ``closed``; None where it is not known.
    ``accounted`` is as in :class:`Shrink`, of this part.
    """

    before: Number
    after: Number
    closed: float | None
    low: float | None = None
    high: float | None = None
    accounted: float | None = None


Closings = Annotated[Mapping[str, Closing], Sorted]


@dataclass(frozen=True)
class Repaired:
    """A user's own model with the effects in it that a model file holds, and how it was simulated.

    Attributes:
        xml: MJCF; empty where it could not be written.
        fault: why not.
        holds, lacks: names of effects.
        rate_hz: of commands.
        interface: what they are.
        timestep: physics step [s].
        joints, actuators: names, in the order in which effects know them.
        numbers: how many of the model's own numbers as fitted the file holds.
    """

    xml: str
    fault: str
    holds: tuple[str, ...]
    lacks: tuple[str, ...]
    rate_hz: float
    interface: str
    timestep: float
    joints: tuple[str, ...]
    actuators: tuple[str, ...]
    numbers: int = 0
