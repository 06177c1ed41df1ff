"""Labels: the truth of a case, with parameters as they can be measured."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from benchmarks.blind import robots
from benchmarks.blind.cases import Made, real_robot
from benchmarks.blind.dictionary import kind_of
from tiago_mj.models import names


def label(made: Made) -> dict[str, Any]:
    """The truth, as far as the case alone says it; the oracle adds its part."""
    case = made.case
    out = asdict(case)
    for name in ("effort", "off_centre"):
        if not out[name]:
            del out[name]
    out["kind"] = case.kind
    out["classes"] = [kind_of(effect.name).group for effect in case.effects]
    out["truth"] = made.truth
    if case.effects:
        out["effective"] = effective(made)
    return out


def effective(made: Made) -> dict[str, float]:
    """Parameters of a single effect as they stand against the *nominal* numbers, which is all that can be measured.

    A servo 4 % stiffer than its data sheet with an effect of 0.8 is one of 0.832; where nominal numbers and effect do
    not mix, the parameter is the drawn one and is not listed.
    """
    case = made.case
    if len(case.effects) != 1:
        return {}
    choice = case.effects[0]
    real = real_robot(case, made.folder)
    nominal = robots.robot_of(case.setting, robots.Jitter(np.random.default_rng(0), 0.0), folder=made.folder)
    named = names.SIDES if kind_of(choice.name).on == "sensor" else real.joints
    columns = list(range(len(named))) if choice.target == "all" else [named.index(t) for t in choice.target]
    value = next(iter(choice.parameters.values()))
    first = next(iter(choice.parameters))

    def factor(a: Any, b: Any) -> dict[str, float]:
        return {first: value * float(np.mean(np.asarray(a) / np.asarray(b)))}

    def added(a: Any, b: Any) -> dict[str, float]:
        return {first: value + float(np.mean(np.asarray(a) - np.asarray(b)))}

    name = choice.name
    if name in ("servo_stiffness", "torque_constant"):
        return factor(real.stiffness[columns], nominal.stiffness[columns])
    if name == "servo_damping":
        return added(real.damping[columns], nominal.damping[columns])
    if name == "viscous_friction":
        dof = real.dof[columns]
        return added(real.model.dof_damping[dof], nominal.model.dof_damping[dof])
    if name == "coulomb_friction":
        dof = real.dof[columns]
        return added(real.model.dof_frictionloss[dof], nominal.model.dof_frictionloss[dof])
    if name == "force_gain":
        return factor(real.units[columns], nominal.units[columns])
    if real.item is None or nominal.item is None:
        return {}
    if name in ("contact_stiffness", "contact_damping", "contact_friction"):
        field_name = name.removeprefix("contact_")
        return factor(getattr(real.item, field_name), getattr(nominal.item, field_name))
    if name == "object_mass":
        return factor(real.item.mass, nominal.item.mass)
    if name == "object_size":
        return added(real.item.width / 2, nominal.item.width / 2)
    if name == "object_offset":
        return added(made.setup.offsets, case.offset)
    return {}
