"""What an environment leaves open from one episode to the next: numbers and shapes that are fixed or drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.io.quoting import quoted
from tiago_mj.models.objects import GraspObject, described_object, named_object

#: A number, or (low, high) to draw it uniformly at every reset.
Range = float | tuple[float, float] | Sequence[float]


#: An object's name, a dictionary that describes it, or the thing itself; or several to draw from at every reset.
Objects = str | Mapping[str, Any] | GraspObject | Sequence[str | Mapping[str, Any] | GraspObject]


@dataclass(frozen=True, slots=True)
class Interval:
    """A closed interval of a quantity; a point when it is fixed."""

    low: float
    high: float

    @property
    def fixed(self) -> bool:
        """Whether there is nothing to draw."""
        return self.low == self.high

    def draw(self, rng: np.random.Generator) -> float:
        """A uniform number of the interval. A fixed quantity takes nothing from the generator."""
        return self.low if self.fixed else float(rng.uniform(self.low, self.high))


def interval(name: str, value: Range, *, unit: str = "") -> Interval:
    """Read a number or a (low, high) pair that a user gave.

    Raises:
        ValueError: neither, or not finite, or low above high; names the argument.
    """
    try:
        numbers = np.full((), np.nan) if _is_text(value) else np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        numbers = np.full((), np.nan)
    if numbers.shape not in ((), (2,)) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} is {quoted(value)}: give one number or (low, high){f' in {unit}' if unit else ''}")
    low, high = (float(numbers), float(numbers)) if numbers.shape == () else (float(numbers[0]), float(numbers[1]))
    if low > high:
        raise ValueError(f"{name} is {quoted(value)}: the first of (low, high) must not be above the second")
    return Interval(low, high)


def _is_text(value: Any) -> bool:
    """Whether NumPy would read numbers out of text, or out of booleans."""
    return any(isinstance(one, (str, bytes, bool)) for one in (value if isinstance(value, (list, tuple)) else [value]))


@dataclass(frozen=True, slots=True)
class Region:
    """A box in space along the world's axes.

    Attributes:
        low, high: its corners, x, y, z [m].
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def draw(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """A uniform point, (3,) [m]."""
        return np.asarray(rng.uniform(self.low, self.high))

    def __contains__(self, point: NDArray[np.float64]) -> bool:
        return bool((np.asarray(self.low) <= point).all() and (point <= np.asarray(self.high)).all())

    def __str__(self) -> str:
        sides = zip("xyz", self.low, self.high, strict=True)
        return ", ".join(f"{axis} {low:.4g} to {high:.4g}" for axis, low, high in sides) + " m"


#: What may be drawn of an object, in the order in which it is drawn.
QUANTITIES: Final = ("width", "mass", "stiffness", "damping")


@dataclass(frozen=True, slots=True)
class ObjectChoice:
    """Which object lies where: every field fixed or drawn at reset.

    Attributes:
        kinds: objects to draw from.
        width, mass, stiffness, damping: [m], [kg], [N/m], [N·s/m]; None keeps the drawn kind's own.
        offset: along the grasp axis from the middle between the fingers, positive towards the left finger [m].
    """

    kinds: tuple[GraspObject, ...]
    width: Interval | None
    mass: Interval | None
    stiffness: Interval | None
    damping: Interval | None
    offset: Interval

    @property
    def fixed(self) -> bool:
        """Whether every episode has the same object (its place apart)."""
        return len(self.kinds) == 1 and all(
            choice is None or choice.fixed for choice in (self.width, self.mass, self.stiffness, self.damping)
        )

    def draw(self, rng: np.random.Generator) -> tuple[GraspObject, float]:
        """An object and its offset [m]."""
        kind = self.kinds[int(rng.integers(len(self.kinds)))] if len(self.kinds) > 1 else self.kinds[0]
        drawn: dict[str, Any] = {
            name: choice.draw(rng) for name in QUANTITIES if (choice := getattr(self, name)) is not None
        }
        return replace(kind, **drawn) if drawn else kind, self.offset.draw(rng)

    def first(self) -> GraspObject:
        """The object that the model is compiled with: the middle of every interval."""
        middle: dict[str, Any] = {
            name: (choice.low + choice.high) / 2 for name in QUANTITIES if (choice := getattr(self, name)) is not None
        }
        return replace(self.kinds[0], **middle)

    def most(self, quantity: str) -> float:
        """Largest value that ``width``, ``mass``, ``stiffness`` or ``damping`` can take."""
        choice: Interval | None = getattr(self, quantity)
        return max(getattr(kind, quantity) for kind in self.kinds) if choice is None else choice.high


def _object(given: Any) -> GraspObject:
    if isinstance(given, Mapping):
        return described_object(given)
    return given if isinstance(given, GraspObject) else named_object(given)


def object_choice(
    kind: Objects,
    *,
    width: Range | None = None,
    mass: Range | None = None,
    stiffness: Range | None = None,
    damping: Range | None = None,
    offset: Range = 0.0,
) -> ObjectChoice:
    """Read the object arguments of an environment; every bad one is one line that names the argument.

    Raises:
        ValueError: an unknown object, or a number that no object can have.
    """
    listed: list[Any] = list(kind) if isinstance(kind, (list, tuple)) else [kind]
    if not listed:
        raise ValueError("object is an empty list: name at least one object")
    kinds = tuple(_object(item) for item in listed)

    def argument(name: str, value: Range, unit: str) -> Interval:
        return interval(f"object_{name}", value, unit=unit)

    def read(name: str, value: Range | None, unit: str) -> Interval | None:
        if value is None:
            return None
        chosen = argument(name, value, unit)
        for bound in (chosen.low, chosen.high):
            changed: dict[str, Any] = {name: bound}
            replace(kinds[0], **changed)  # GraspObject knows what is possible
        return chosen

    return ObjectChoice(
        kinds=kinds,
        width=read("width", width, "m"),
        mass=read("mass", mass, "kg"),
        stiffness=read("stiffness", stiffness, "N/m"),
        damping=read("damping", damping, "N·s/m"),
        offset=argument("offset", offset, "m"),
    )


def check_fits(choice: ObjectChoice, opening: float) -> None:
    """Refuse an object that would start inside a finger.

    Raises:
        ValueError: the widest object at its largest offset does not fit between the open fingers.
    """
    offset = max(abs(choice.offset.low), abs(choice.offset.high))
    widest = choice.most("width")
    if widest + 2 * offset >= opening:
        raise ValueError(
            f"an object {widest:.4g} m wide at an offset of {offset:.4g} m does not fit the gripper's opening of "
            f"{opening:.4g} m: lower object_width or object_offset"
        )
