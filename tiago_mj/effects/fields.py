"""What a declaration says in numbers: parameters, forms, details and priors, as fields of the effect's class."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final


@dataclass(frozen=True)
class Parameter:
    """A number that an effect has.

    Attributes:
        unit: (on a sliding joint, on a hinge); one serves both.
        identity: value at which the effect is exactly absent; None: no such value (another parameter switches it off).
        default: (slide, hinge), a clearly visible magnitude.
        bounds: (low, high), what a fit may try.
        nominal: ``velocity`` or ``effort``: default and bounds are shares of that nominal limit of the target.
        possible: (low, high), beyond which a value has no meaning, whatever the robot; None: only what ``bounds`` say
            of signs.
        name: as in the class.
        tried: of a number that does not switch its effect off, values with which a search begins; empty: three across
            the bounds.
    """

    unit: tuple[str, str]
    identity: float | None
    default: tuple[float, float]
    bounds: tuple[tuple[float, float], tuple[float, float]]
    nominal: str | None = None
    possible: tuple[float, float] | None = None
    name: str = ""
    tried: tuple[float, ...] = ()

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)


def parameter(
    unit: str | tuple[str, str],
    *,
    identity: float | None,
    default: float | tuple[float, float],
    bounds: tuple[float, float] | tuple[tuple[float, float], tuple[float, float]],
    nominal: str | None = None,
    possible: tuple[float, float] | None = None,
    tried: tuple[float, ...] = (),
) -> Any:
    """Declare a parameter in an effect's body; pairs are (sliding joint, hinge)."""
    units = (unit, unit) if isinstance(unit, str) else unit
    defaults = default if isinstance(default, tuple) else (default, default)
    ranges: Any = bounds if isinstance(bounds[0], tuple) else (bounds, bounds)
    if not len(units) == len(defaults) == len(ranges) == len(ranges[0]) == len(ranges[1]) == 2:
        raise ValueError(f"parameter [{unit}]: give units, defaults and bounds (low, high) once, or as a pair of each")
    return Parameter(units, identity, defaults, ranges, nominal, possible, tried=tried)


@dataclass(frozen=True)
class Form:
    """What kind of an effect it is, where real ones differ: no magnitude, so that nothing is fitted; the diagnosis
    tries each.

    Attributes:
        values: that are possible, the usual one first.
        name: as in the class.
    """

    values: tuple[float, ...]
    name: str = ""

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)


def form(*values: float) -> Any:
    """Declare in an effect's body what forms it has, as numbers, the usual one first."""
    return Form(tuple(float(value) for value in values))


#: Of what a detail's usual size is a share: of the joint's inertia, or of the damping that is critical for that inertia
#: on the servo's stiffness, 2 √(stiffness · inertia).
USUAL_SHARES: Final = ("inertia", "critical_damping")


@dataclass(frozen=True)
class Usual:
    """How large a detail usually is: a normal prior of its value, or of its logarithm.

    Attributes:
        middle: its mean, or its median where the logarithm is normal.
        deviation: one standard deviation, of the value or of its logarithm; a pair is (on a sliding joint, on a hinge).
        of_logarithm: which of them is normal.
        share_of: of which the middle is a share, one of :data:`USUAL_SHARES`; None: it is a value.
    """

    middle: float
    deviation: float | tuple[float, float]
    of_logarithm: bool = False
    share_of: str | None = None

    def deviation_on(self, side: int) -> float:
        """One standard deviation on a sliding joint (0) or on a hinge (1)."""
        return self.deviation[side] if isinstance(self.deviation, tuple) else self.deviation


@dataclass(frozen=True)
class Detail:
    """What more there is to say of an effect, 0 where nobody does: where that is of which its first parameter is the
    amount, sought only once the amount is known (of two amounts on one target it is their common centre); or a number
    of the effect's form, which is fitted with the amount wherever the effect is tried.

    Attributes:
        unit: (on a sliding joint, on a hinge); one serves both.
        bounds: (low, high), what a fit may try.
        name: as in the class.
        usual: prior of a number that is fitted with the amount; None: it says where the amount is.
        moment: whether efforts along a motion change in proportion to the amount times it, as they do where it is a
            place: there it is sought as one.
    """

    unit: tuple[str, str]
    bounds: tuple[float, float]
    name: str = ""
    usual: Usual | None = None
    moment: bool = False

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)


def detail(
    unit: str | tuple[str, str], bounds: tuple[float, float], *, usual: Usual | None = None, moment: bool | None = None
) -> Any:
    """Declare in an effect's body a number that says more of it; see :class:`Detail`. A place is a moment."""
    return Detail(
        (unit, unit) if isinstance(unit, str) else unit,
        bounds,
        usual=usual,
        moment=usual is None if moment is None else moment,
    )


def usually(median: float, *, within: float = 10.0, share_of: str | None = None) -> Usual:
    """Declare how large a detail usually is: its median, in its unit or as a share, and within which factor of it the
    detail lies at two standard deviations; see :class:`Usual`."""
    if share_of not in (None, *USUAL_SHARES) or not 0 < median < math.inf or not 1 < within < math.inf:
        raise ValueError(
            f"a detail is usually {median}, within={within}, share_of={share_of!r}: give a positive median, a factor "
            f"above 1, and share_of={', '.join(map(repr, USUAL_SHARES))} or None"
        )
    return Usual(median, math.log(within) / 2, True, share_of)


#: Of what a prior's deviation may be a share: of what the nominal model has of it (``takes_from``), of the inertia that
#: a joint moves at the start of a recording, of the nominal limit in which the parameter is stated, of the largest
#: effort that was measured of the target (a quarter of its drive's limit at least), of the time between two recorded
#: rows, or of how far what the joint moves reaches up to the next joint.
SHARES: Final = ("stock", "inertia", "limit", "effort", "row", "reach")


@dataclass(frozen=True)
class NominalPrior:
    """How well the number of the nominal model is known that an effect's first parameter changes: a normal prior.

    Attributes:
        deviation: (slide, hinge), one standard deviation, in the parameter's unit, of a factor of its logarithm; of
            ``share_of`` where that is given.
        share_of: one of :data:`SHARES`, or None.
        each: whether every target has its own.
        per_trial: whether every trial has its own.
    """

    deviation: tuple[float, float]
    share_of: str | None = None
    each: bool = True
    per_trial: bool = False


def known_to(
    deviation: float | tuple[float, float], *, share_of: str | None = None, each: bool = True, per_trial: bool = False
) -> NominalPrior:
    """Declare in an effect's body how well the nominal model's own number is known; see :class:`NominalPrior`."""
    pair = deviation if isinstance(deviation, tuple) else (deviation, deviation)
    if share_of not in (None, *SHARES) or not all(0 < one < float("inf") for one in pair):
        raise ValueError(
            f"a nominal number known to {deviation}, share_of={share_of!r}: give positive deviations, once or (slide, "
            f"hinge), and share_of={', '.join(map(repr, SHARES))} or None"
        )
    return NominalPrior(pair, share_of, each, per_trial)
