"""What the nominal model has of what effects change: how much of it can be taken away.

The environments, ``record``, a replay and the diagnosis ask here, so that what a user may give and what a search may
try end at the same number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import mujoco
import numpy as np

from tiago_mj.effects.contact import THINNEST
from tiago_mj.effects.declare import EFFECTS, Effect
from tiago_mj.effects.fields import NominalPrior
from tiago_mj.effects.inertia import removable_inertia
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.spec import Entry, arrays, check_sizes

#: Sums of what several entries say are off by rounding.
ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Stock:
    """What a model has of a quantity that effects may take away.

    Attributes:
        what: it is, in words.
        amount: of a target, by its index among the effect's targets, in the effect's unit; inf where nothing is known
            to end it.
        vanishes: whether reality may lack all of it, so that an estimate there is no sign of something else.
    """

    what: str
    amount: Callable[[mujoco.MjModel, Wiring, int], float]
    vanishes: bool


def _friction(model: mujoco.MjModel, wiring: Wiring, joint: int) -> float:
    return float(model.dof_frictionloss[wiring.dof[joint]])


def _damping(model: mujoco.MjModel, wiring: Wiring, joint: int) -> float:
    return float(np.max(model.dof_damping[wiring.dof[joint]]))


def _servo_damping(model: mujoco.MjModel, wiring: Wiring, actuator: int) -> float:
    return float(-model.actuator_biasprm[wiring.actuators[actuator], 2])


def _inertia(model: mujoco.MjModel, wiring: Wiring, joint: int) -> float:
    return float(removable_inertia(model, wiring.dof)[joint])


def _tool_mass(model: mujoco.MjModel, wiring: Wiring, _: int) -> float:
    return float(model.body_mass[wiring.tool])


def _half_width(model: mujoco.MjModel, wiring: Wiring, _: int) -> float:
    return math.inf if wiring.object_geom is None else THINNEST * float(model.geom_size[wiring.object_geom, 0])


#: By the names that :attr:`tiago_mj.effects.declare.Effect.takes_from` has.
STOCKS: Final[Mapping[str, Stock]] = MappingProxyType(
    {
        "frictionloss": Stock("dry friction", _friction, vanishes=True),
        "damping": Stock("damping", _damping, vanishes=True),
        "servo_damping": Stock("damping of the servo", _servo_damping, vanishes=True),
        "inertia": Stock("inertia that can be taken away", _inertia, vanishes=False),
        "tool_mass": Stock("mass of the tool", _tool_mass, vanishes=False),
        "object_half_width": Stock("half width of the object that can be taken away", _half_width, vanishes=False),
    }
)


def removable(declared: type[Effect], model: mujoco.MjModel, wiring: Wiring, index: int) -> float:
    """How far below 0 an effect's first parameter may lie on a target, in its unit; inf where the effect takes nothing
    from the model.

    Args:
        declared: the effect.
        model: nominal.
        wiring: of the model.
        index: of the target among the effect's targets.
    """
    if declared.takes_from is None:
        return math.inf
    return max(STOCKS[declared.takes_from].amount(model, wiring, index), 0.0)


@dataclass(frozen=True)
class Seen:
    """In what a nominal model is seen.

    Attributes:
        own_model: whether it is a user's own, and no environment of the project.
        efforts: whether efforts are compared along a motion, not replays of commands.
        doubted: whether numbers count that are exact until the recordings say otherwise.
    """

    own_model: bool = False
    efforts: bool = False
    doubted: bool = False


#: Order in which a fit has the numbers of the library: its sums depend on it in their last digit.
ORDER: Final = (
    *("servo_stiffness", "servo_damping", "viscous_friction", "coulomb_friction", "armature", "force_limit", "payload"),
    *("contact_stiffness", "contact_damping", "contact_inertia", "contact_friction"),
    *("object_mass", "object_size", "object_offset"),
    *("force_gain", "force_bias", "encoder_bias", "command_delay"),
)


def prior_of(declared: type[Effect], seen: Seen) -> NominalPrior | None:
    """How well the nominal model's own number is known that an effect changes; None: exactly, or there is none."""
    if seen.efforts:
        doubted = declared.doubted_prior if seen.doubted else None
        return declared.effort_prior or declared.nominal_prior or doubted
    return (declared.own_model_prior if seen.own_model else None) or declared.nominal_prior


def known_to_some_percent(seen: Seen) -> tuple[type[Effect], ...]:
    """Effects that change a number of the nominal model which is known to a prior only, in the order of a fit; those
    that are not the library's come last."""
    mine = [one for one in EFFECTS.values() if prior_of(one, seen)]
    places = {name: place for place, name in enumerate(ORDER)}
    return tuple(sorted(mine, key=lambda declared: places.get(declared.name, len(places))))


def check_entries(entries: Sequence[Entry], model: mujoco.MjModel, wiring: Wiring) -> None:
    """Refuse what a user gave where it cannot be meant of this model: sizes that are a slip of the unit, and more
    taken away than there is. What a diagnosis found is not questioned.

    Args:
        entries: of one simulator; those of one effect on one target count together.
        model: nominal.
        wiring: of the model.

    Raises:
        ValueError: an entry names a target that the model does not have, or has a value as above; one line that says
            what the model has.
    """
    check_sizes(entries, wiring.targets)
    check_stock(entries, model, wiring, names={entry.name for entry in entries if not entry.fitted})


def check_stock(
    entries: Sequence[Entry], model: mujoco.MjModel, wiring: Wiring, names: Container[str] | None = None
) -> None:
    """Refuse what takes more from a model than there is, or is on a part that it does not have, found or given.

    Args:
        entries, model, wiring: see :func:`check_entries`.
        names: of the effects that are looked at; None: all.

    Raises:
        ValueError: as above; one line.
    """
    for name in dict.fromkeys(entry.name for entry in entries if names is None or entry.name in names):
        declared = EFFECTS[name]
        first = next(iter(declared.parameters.values()))
        same = [entry for entry in entries if entry.name == name]
        values = getattr(arrays(declared, [same], wiring.targets), first.name)[0]
        if declared.common:
            values = values.sum(keepdims=True)
        for index, value in enumerate(values.tolist()):
            _check_taken(declared, value, index, model, wiring)


def _check_taken(declared: type[Effect], value: float, index: int, model: mujoco.MjModel, wiring: Wiring) -> None:
    if declared.takes_from is None or value >= 0:
        return
    there = removable(declared, model, wiring, index)
    if value >= -there * (1 + ROUNDING):
        return
    what, unit = STOCKS[declared.takes_from].what, _unit(declared, index, wiring)
    least = f"at least -{_said(there)}" if there else "0 or more"
    raise ValueError(
        f"{_given(declared, value, index, wiring)}, but the model has {_said(there)} {unit} of {what}: give {least}"
    )


def _given(declared: type[Effect], value: float, index: int, wiring: Wiring) -> str:
    """What was given, as a message begins."""
    first = next(iter(declared.parameters))
    several = declared.targets in ("command", "joint", "sensor") and not declared.common
    whose = f" on {wiring.targets.names(declared.targets)[index]}" if several else ""
    return f"effect {declared.name!r}: {first} is {value:g} {_unit(declared, index, wiring)}{whose}"


def _unit(declared: type[Effect], index: int, wiring: Wiring) -> str:
    first = next(iter(declared.parameters.values()))
    return first.unit[wiring.targets.side(declared.targets, index)]


def _said(amount: float) -> str:
    """To four digits, rounded down: what is said to be there can be taken."""
    if not amount:
        return "0"
    grain = 10.0 ** (math.floor(math.log10(amount)) - 3)
    return f"{math.floor(amount / grain * (1 + ROUNDING)) * grain:.4g}"
