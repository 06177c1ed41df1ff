"""What may explain a torque gap: one term per effect, target and shape, each with the torque that it would add.

A term has one strength (the effect's parameter that has an identity; 0 here is that identity) and the torque per unit
of strength along the motion: the secant between the identity and a magnitude, exact for effects that are linear in it.
Parameters without an identity (a Stribeck velocity, a cogging period) are shapes: one term for each value on a grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS, Effect, Entry, Parameter
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.spec import arrays
from tiago_mj.gap.inference.hypotheses import EDGE_SHARE
from tiago_mj.gap.torque.torques import STAGES, Torques, invertible

Array = NDArray[np.float64]

#: Effects between the true torque and the recorded effort, which no torque along the motion shows: the effort channel
#: is the motor's current times its nominal torque constant; motion is stamped late against effort.
ON_THE_EFFORT: Final = ("torque_constant", "clock_offset")
#: Slowest speed of a shape, over that of rest: below, reversals and rests are left out anyway.
SLOWEST: Final = 5.0
#: Values of a shape parameter that are tried.
SHAPES: Final = 6


@dataclass(frozen=True)
class Term:
    """One thing that may be wrong.

    Attributes:
        effect: name.
        target: joint, actuator, or the kind of target where there is only one.
        joint: index of the joint; None for what concerns all.
        parameter: name of the strength.
        unit: of the strength.
        shape: the other parameters.
        shape_units: their units.
        identity: value of the parameter at strength 0.
        low, high: bounds of the strength, relative to the identity.
        magnitude: of the first secant, relative to the identity.
        follows_effort: whether the torque depends on the torque that is transmitted.
        linear: whether the torque is in proportion to the strength.
        rigid: whether masses, gravity or the motion itself change; else it is a matter of one joint.
        removes: whether the lower bound takes away all that the model has of it.
    """

    effect: str
    target: str
    joint: int | None
    parameter: str
    unit: str
    identity: float
    low: float
    high: float
    magnitude: float
    shape: tuple[tuple[str, float], ...] = ()
    shape_units: tuple[tuple[str, str], ...] = ()
    follows_effort: bool = field(default=False, compare=False)
    linear: bool = field(default=True, compare=False)
    rigid: bool = field(default=False, compare=False)
    removes: bool = field(default=False, compare=False)

    def at_edge(self, strength: float) -> bool:
        """Whether a strength lies at the bound of what is possible: it stands for something else. To take all of the
        model's own friction or damping away is none."""
        if not math.isfinite(self.high - self.low):
            return False
        near = EDGE_SHARE * (self.high - self.low)
        at_least = strength < self.low + near and not self.removes and self.low != 0
        return at_least or (strength > self.high - near and self.high > 0)

    @property
    def key(self) -> tuple[str, str]:
        """Effect and target, whatever the shape."""
        return self.effect, self.target

    def entry(self, strength: float) -> Entry:
        """The effect at a strength."""
        target = None if self.joint is None else (self.target,)
        return Entry(self.effect, target, {self.parameter: self.identity + strength, **dict(self.shape)})


def all_terms(torques: Torques, effort: Array) -> tuple[Term, ...]:
    """Every term whose torque this course can show, in the order of the declarations.

    Args:
        torques: along the course.
        effort: (T, m) a plausible torque, for effects that depend on it.
    """
    found = []
    columns = torques.course.columns
    for declared in EFFECTS.values():
        for term in _declared(declared, torques):
            if term.joint is not None and term.joint not in columns and not _reaches_others(declared):
                continue
            plain = per_unit(term, torques, effort)[:, columns]
            if np.isfinite(plain).all() and np.abs(plain).max() > 1e-9:
                found.append(_bounded(term, torques, effort))
    return tuple(found)


def possible(torques: Torques) -> tuple[str, ...]:
    """Names of the effects that may show along a course, whether this one excites them or not."""
    return tuple(name for name, declared in EFFECTS.items() if any(True for _ in _declared(declared, torques)))


def _reaches_others(declared: type[Effect]) -> bool:
    """Whether an effect at one joint changes the torque of others."""
    return declared.stage in ("body", "joint_sensor")


def per_unit(
    term: Term,
    torques: Torques,
    effort: Array,
    magnitude: float | None = None,
    beside: Sequence[Entry] = (),
) -> Array:
    """Torque that a term adds per unit of strength, (T, m).

    Args:
        term: which.
        torques: along the course.
        effort: (T, m) torque that is transmitted, as far as it is known.
        magnitude: strength of the secant; the term's own if None.
        beside: what else is at work on the joints.
    """
    size = term.magnitude if magnitude is None or magnitude == 0 else magnitude
    if term.effect == "torque_constant":
        # Strength is the parameter's distance from 1: the effort channel reads torque / factor. What is added to the
        # nominal torque reads as much less; :class:`Evidence` scales the other terms.
        column = np.zeros_like(effort)
        column[:, term.joint] = torques.nominal[:, term.joint] * (reading_gain(size) - 1) / size
        return column
    if term.effect == "clock_offset":
        return (torques.course.shifted(effort, size) - effort) / size
    without = torques.of(beside, effort) if beside else torques.nominal
    change = torques.of([*beside, term.entry(size)], effort) - without
    return change / size


def reading_gain(strength: float) -> float:
    """What an effort channel reads per true torque, from the strength of a ``torque_constant``."""
    return 1 / (1 + strength)


def _declared(declared: type[Effect], torques: Torques) -> Iterator[Term]:
    """Terms of one declaration."""
    strengths = [p for p in declared.parameters.values() if p.identity is not None and math.isfinite(p.identity)]
    shapes = [p for p in declared.parameters.values() if p.identity is None]
    wiring, course = torques.wiring, torques.course
    special = declared.name in ON_THE_EFFORT
    if len(strengths) != 1 or len(shapes) > 1 or not (special or declared.stage in STAGES):
        return
    if declared.targets in ("sensor", "clock") and not special:
        return
    targets: list[tuple[str, int | None]]
    if declared.targets == "joint":
        own = list(enumerate(course.joints))
        targets = [(name, j) for j, name in (own[-1:] if declared.stage == "body" else own)]
    elif declared.targets == "command":
        targets = [(n, wiring.targets.actuated[a]) for a, n in enumerate(wiring.targets.command)]
    else:
        targets = [("all" if declared.targets == "clock" else declared.targets, None)]
    for name, joint in targets:
        slide = 0 if joint is not None and wiring.targets.slides[joint] else 1
        if overrides(declared, "measure_position") and not special and not _can_be_undone(declared, name, torques):
            continue
        p = strengths[0]
        assert p.identity is not None
        low, high = (bound - p.identity for bound in p.bounds[slide])
        for shape in _grid(shapes, slide, joint, torques):
            yield Term(
                declared.name,
                name,
                joint,
                p.name,
                p.unit[slide],
                p.identity,
                low,
                high,
                p.default[slide] - p.identity,
                shape,
                tuple((s.name, s.unit[slide]) for s in shapes),
            )


def _can_be_undone(declared: type[Effect], target: str, torques: Torques) -> bool:
    """Whether true positions follow from readings that have the effect."""
    effect = arrays(declared, [[Entry(declared.name, (target,))]], torques.wiring.targets)
    return invertible(effect, torques.course.stack("position"), torques.along)


def _grid(
    shapes: Sequence[Parameter], slide: int, joint: int | None, torques: Torques
) -> Iterator[tuple[tuple[str, float], ...]]:
    """Shapes that the motion can resolve: speeds between rest and the fastest, periods that the filter passes."""
    if not shapes:
        yield ()
        return
    shape, course = shapes[0], torques.course
    assert joint is not None, "a shape parameter belongs to a joint"
    low, high = shape.bounds[slide]
    position, velocity = course.stack("position")[:, joint], np.abs(course.stack("velocity")[:, joint])
    if shape.unit[slide] in ("m", "rad"):
        span = float(np.ptp(position))
        low = max(low, float(np.percentile(velocity, 95)) / course.cutoff, 1e-9)
        if span > 0 and low < high:
            count = max(2, min(60, math.ceil(2 * span * (1 / low - 1 / high))))
            for frequency in np.linspace(1 / high, 1 / low, count):
                yield ((shape.name, float(1 / frequency)),)
        return
    low, high = max(low, SLOWEST * float(course.rest_speed[joint])), min(high, float(velocity.max()))
    if low < high:
        for value in np.geomspace(low, high, SHAPES):
            yield ((shape.name, float(value)),)


def _bounded(term: Term, torques: Torques, effort: Array) -> Term:
    """The term with bounds that mean something (friction cannot fall below zero), and on what its torque depends."""
    if term.effect in ON_THE_EFFORT:
        return replace(term, follows_effort=term.effect == "clock_offset", linear=False, rigid=True)
    rigid = torques.changes_rigid(term.entry(term.magnitude))
    unit = per_unit(term, torques, effort)
    size = float(np.abs(unit).max())
    linear = bool(np.abs(unit - per_unit(term, torques, effort, 0.5 * term.magnitude)).max() < 1e-3 * size)
    if rigid:
        return replace(term, linear=linear, rigid=True)
    follows = bool(np.abs(unit - per_unit(term, torques, 2 * effort)).max() > 1e-6 * size)
    low, removes = term.low, False
    if linear and math.isfinite(low) and low < 0:
        share = float(np.abs(per_unit(term, torques, effort, low)).max()) / size
        low, removes = low * min(1.0, share), share < 1
    return replace(term, low=low, follows_effort=follows, linear=linear, removes=removes)
