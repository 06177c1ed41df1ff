"""The true numbers and the true effect of a case, as entries of the library."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import cases, robots
from benchmarks.blind.cases import Case, EffectChoice, Made
from benchmarks.blind.dictionary import ARM, CONSTANT, PLAIN
from benchmarks.blind.effects.gears import ROTOR, SPRING_DAMPING, TwoMass
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.models import names

Array = NDArray[np.float64]

#: Where reality's lump hangs on the arm's tool, from its centre of mass along its axes [m].
PLACE: Final = {"z": -0.05}
#: Numbers of a case over the library's: the middle of rubber's two time constants, 0.7 and 1.4 of the drawn one.
SCALE: Final = {"pad_creep": {"time_constant": 1.05}}


# The true numbers ----------------------------------------------------------------------------------------------------


def numbers(made: Made, plant: Plant, folder: Path) -> tuple[tuple[Entry, ...], ...]:
    """What of reality's numbers differs from the nominal ones, as effects of the library, trial by trial."""
    case = made.case
    real = cases.real_robot(case, folder)  # as it was before its effects changed it
    nominal = robots.robot_of(case.setting, robots.Jitter(np.random.default_rng(0), 0.0), folder=folder)
    shared = list(_of_joints(real, nominal, case))
    if case.setting == PLAIN:
        shared += _of_the_link(real, nominal, plant)
        (link,) = (e for e in shared if e.name == "payload")
        shared.append(Entry("armature", (real.joints[0],), {"mass": _moved(real, case, link.parameters)}))
    if real.item is None or nominal.item is None:
        return (tuple(shared),) * case.trials
    shared += [
        Entry("contact_stiffness", None, {"factor": real.item.stiffness / nominal.item.stiffness}),
        Entry("contact_damping", None, {"factor": real.item.damping / nominal.item.damping}),
        Entry("contact_inertia", None, {"factor": _virtual_mass(real, nominal, plant)}),
        Entry("contact_friction", None, {"factor": real.item.friction / nominal.item.friction}),
        Entry("object_mass", None, {"factor": real.item.mass / nominal.item.mass}),
        Entry("object_size", None, {"radius": (real.item.width - nominal.item.width) / 2}),
    ]
    for side, sensor in enumerate(plant.sensors):
        shared.append(Entry("force_gain", (sensor,), {"factor": float(real.units[side] / nominal.units[side])}))
    offsets = made.setup.offsets - case.offset
    return tuple((*shared, Entry("object_offset", None, {"distance": float(away)})) for away in offsets)


def _of_joints(real: robots.Robot, nominal: robots.Robot, case: Case) -> Iterator[Entry]:
    inertia, drag = _inertia(real) - _inertia(nominal), _on_motors(real, case)
    for j, joint in enumerate(real.joints):
        on, dof, dof_then = (joint,), real.dof[j], nominal.dof[j]
        yield Entry("servo_stiffness", on, {"factor": float(real.stiffness[j] / nominal.stiffness[j])})
        yield Entry("servo_damping", on, {"damping": float(real.damping[j] - nominal.damping[j] + drag[j])})
        yield Entry("force_limit", on, {"limit": float(real.limit[j])})
        viscous = real.model.dof_damping[dof] - nominal.model.dof_damping[dof_then] - drag[j]
        yield Entry("viscous_friction", on, {"damping": float(viscous)})
        dry = real.model.dof_frictionloss[dof] - nominal.model.dof_frictionloss[dof_then]
        if dry:
            yield Entry("coulomb_friction", on, {"force": float(dry)})
        if len(real.joints) > 1:  # a single link's inertia goes with its mass and where that is
            yield Entry("armature", on, {"mass": float(inertia[j])})


def _on_motors(real: robots.Robot, case: Case) -> Array:
    """Damping that reality's gears move from the joints to the motors before them, (n,)."""
    moved = np.zeros(len(real.joints))
    for effect in cases.effects_of(case):
        if isinstance(effect, TwoMass):
            effect.build(copy.deepcopy(real))
            moved += effect._drag
    return moved


def _moved(real: robots.Robot, case: Case, link: Mapping[str, float]) -> float:
    """What else the only joint has of inertia [kg·m²]: what a payload and the link's own change have about their common
    centre, which the library takes for one point."""
    moved = 0.0
    for choice in case.effects:
        if choice.name == "payload":
            both = choice.parameters["mass"] * link["mass"] / (choice.parameters["mass"] + link["mass"])
            moved += both * sum(link[axis] ** 2 for axis in "xyz")
    return float(moved)


def _virtual_mass(real: robots.Robot, nominal: robots.Robot, plant: Plant) -> float:
    """Of the contacts, over the nominal model's: d / (1 - d), in units of the bodies' inverse weights."""
    of_real, of_nominal = real.model.pair_solimp[0, 0], plant.model.pair_solimp[0, 0]
    bodies = [r.model.geom_bodyid[[r.model.pair_geom1[0], r.model.pair_geom2[0]]] for r in (real, nominal)]
    weights = [r.model.body_invweight0[b, 0].sum() for r, b in zip((real, nominal), bodies, strict=True)]
    return float(of_real / (1 - of_real) / (of_nominal / (1 - of_nominal)) * weights[1] / weights[0])


def _inertia(robot: robots.Robot) -> Array:
    return robot.model.dof_M0[robot.dof]


def _of_the_link(real: robots.Robot, nominal: robots.Robot, plant: Plant) -> list[Entry]:
    """Mass, centre of mass and inertia of the last link about its joint."""
    body = plant.wiring.tool
    mass, then = (float(r.model.body_mass[body]) for r in (real, nominal))
    first = [float(r.model.body_mass[body]) * r.model.body_ipos[body] for r in (real, nominal)]
    place = (first[0] - first[1]) / (mass - then) - nominal.model.body_ipos[body]
    added = {"mass": mass - then, **dict(zip("xyz", map(float, place), strict=True))}
    # What a point there lacks of the inertia about the joint is the rotor's.
    whole = _inertia(real)[0] - _inertia(nominal)[0]
    arm = nominal.model.body_ipos[body] + place
    point = (mass - then) * float(arm @ arm)
    return [Entry("payload", None, added), Entry("armature", (real.joints[0],), {"mass": float(whole - point)})]


# The true effect -----------------------------------------------------------------------------------------------------


def truths(case: Case, robot: robots.Robot | None = None) -> list[tuple[Entry, ...]]:
    """The case's effects at their true numbers, in each of their forms."""
    ways: list[list[tuple[Entry, ...]]] = []
    for choice in case.effects:
        declared = EFFECTS[choice.name]
        parameters = {n: v for n, v in choice.parameters.items() if n in declared.parameters}
        parameters |= CONSTANT.get(choice.name, {}) | (PLACE if (choice.name, case.setting) == ("payload", ARM) else {})
        if case.setting == PLAIN and robot is not None and choice.name in ("backlash", "joint_elasticity"):
            parameters |= _motor(choice, robot)
        target = None if choice.target == "all" else tuple(choice.target)
        parameters |= {name: factor * parameters[name] for name, factor in SCALE.get(choice.name, {}).items()}
        if choice.name == "force_crosstalk" and robot is not None:
            ways.append([_crosstalk(choice, robot)])
            continue
        forms = itertools.product(*(form.values for form in declared.forms.values()))
        ways.append(
            [(Entry(choice.name, target, parameters | dict(zip(declared.forms, form, strict=True))),) for form in forms]
        )
    return [tuple(itertools.chain(*one)) for one in itertools.product(*ways)]


def _crosstalk(choice: EffectChoice, robot: robots.Robot) -> tuple[Entry, ...]:
    """Crosstalk cell by cell: reality's comes after the cells' own gains, the library's before them."""
    units = dict(zip(names.SIDES, robot.units, strict=True))
    sides = names.SIDES if choice.target == "all" else choice.target
    return tuple(
        Entry(choice.name, (side,), {"ratio": choice.parameters["ratio"] * float(units[other] / units[side])})
        for side in sides
        for other in set(names.SIDES) - {side}
    )


def _motor(choice: EffectChoice, robot: robots.Robot) -> dict[str, float]:
    """Inertia of the motor, and damping of the spring before it, of the only joint."""
    (inertia,) = robot.inertia
    motor = {"motor": float(ROTOR * inertia)}
    if choice.name == "backlash":
        return motor
    return motor | {"damping": float(SPRING_DAMPING * np.sqrt(choice.parameters["stiffness"] * inertia))}


def lost(made: Made) -> NDArray[np.bool_] | None:
    """Which commands, or readings, reality lost, (ntrials, rows, n): its own draws; None: it loses none."""
    by_chance = [c for c in made.case.effects if c.name in ("dropped_commands", "force_dropout")]
    if not by_chance:
        return None
    (choice,) = by_chance
    rng = np.random.default_rng([made.setup.noise_seed, 1])
    rows, commands = made.setup.rows, choice.name == "dropped_commands"
    n = made.recorded.commands.shape[2] if commands else made.recorded.force.shape[2]
    columns = cases.effects_of(made.case)[0].targets
    chance = np.zeros(n)
    chance[columns] = choice.parameters["probability"]
    shape = (len(made.recorded.time), n)
    out = np.stack([rng.random(shape) < chance for _ in range(rows)], axis=1)
    # The first reading cannot be missed; the first command is what a receiver has, whatever becomes of it.
    return out if commands else np.concatenate([np.zeros_like(out[:, :1]), out], axis=1)
