"""The repaired simulator of a user's own model, beside the verdict: a model file, and what it cannot hold."""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import mujoco

from tiago_mj.effects import model_file
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.spec import Entry
from tiago_mj.effects.wiring import wire
from tiago_mj.gap.report.json import clean
from tiago_mj.gap.result import Diagnosis, Named, Repaired
from tiago_mj.gap.simulation.plant import Plant

#: Width of the comment in a repaired model.
WIDTH: Final = 100


def with_model(found: Diagnosis, plant: Plant) -> Diagnosis:
    """A diagnosis with what the model's drives can give, and with the repaired model if it is of a plain one."""
    found = replace(found, limits=limits(plant))
    return found if plant.file is None else replace(found, repaired=repaired(found, plant))


def limits(plant: Plant) -> dict[str, dict[str, float]]:
    """The most that the nominal model's drives give, by ``joint`` and ``command``, then by name [N, N·m]; without those
    that have no limit."""
    wiring, model = _wiring(plant), plant.model
    commands: dict[str, float] = {}
    joints: dict[str, float] = {}
    for k, actuator in enumerate(wiring.actuators):
        joint = int(model.actuator_trnid[actuator, 0])
        gear = abs(float(model.actuator_gear[actuator, 0])) or 1.0
        own = _own_limit(model, int(actuator))
        held = float(model.jnt_actfrcrange[joint, 1]) if model.jnt_actfrclimited[joint] else math.inf
        commands[wiring.targets.command[k]] = min(own, held / gear)
        joints[wiring.targets.joint[wiring.targets.actuated[k]]] = min(own * gear, held)
    return {
        "joint": {name: limit for name, limit in joints.items() if math.isfinite(limit)},
        "command": {name: limit for name, limit in commands.items() if math.isfinite(limit)},
    }


def _own_limit(model: mujoco.MjModel, actuator: int) -> float:
    """Of an actuator's force, before its gear."""
    if model.actuator_forcelimited[actuator]:
        return float(model.actuator_forcerange[actuator, 1])
    motor = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    if motor and model.actuator_ctrllimited[actuator] and model.actuator_actadr[actuator] < 0:
        return float(model.actuator_ctrlrange[actuator, 1] * model.actuator_gainprm[actuator, 0])
    return math.inf


def repaired(found: Diagnosis, plant: Plant) -> Repaired:
    """The user's model with what was known before and what was found."""
    assert plant.file is not None
    substeps = plant.substeps
    wiring, timestep = _wiring(plant), plant.period / substeps
    known = (*found.given, *(entry(effect) for effect in found.best.effects))
    fitted = tuple(entry(one.effect) for one in found.numbers)
    named, both = model_file.by_effect(known), model_file.by_effect((*known, *fitted))
    kept: tuple[str, ...] = ()
    xml = fault = ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the user's file, which was compiled before
            model = model_file.read(plant.file, timestep).compile()
            wiring = _of(model, wiring)
            kept = tuple(name for name, own in both.items() if _holds(model, wiring, own, plant.period, substeps))
            spec = model_file.read(plant.file, timestep)
            entries = [one for name in kept for one in both[name]]
            said = _comment(found, plant, known, fitted, kept)
            xml = model_file.write(spec, wiring, entries, plant.period, substeps, said)
    except (ValueError, OSError, mujoco.FatalError) as reason:
        fault, kept = " ".join(str(reason).split()), ()
    return Repaired(
        xml=xml,
        fault=fault,
        holds=tuple(name for name in named if name in kept),
        lacks=tuple(name for name in named if name not in kept),
        rate_hz=1 / plant.period,
        interface=wiring.interface,
        timestep=timestep,
        joints=wiring.targets.joint,
        actuators=wiring.targets.command,
        numbers=sum(one.name in kept for one in fitted),
    )


def entry(effect: Named) -> Entry:
    """An effect that was found as it is read from ``calibration.yaml``, whose numbers are rounded."""
    found = effect.entry()
    return replace(found, parameters=clean(found.parameters))


def _wiring(plant: Plant) -> Wiring:
    """Of the plant; recordings without commands name no actuators, and effects on them are those of the joints."""
    if plant.actuators:
        return plant.wiring
    model = plant.model
    joints = [model.joint(name).id for name in plant.joints]
    on_them = [a for a in range(model.nu) if model.actuator_trntype[a] == 0 and model.actuator_trnid[a, 0] in joints]
    names = [model.actuator(a).name for a in on_them]
    return wire(model, joints=plant.joints, actuators=names, interface=plant.wiring.interface)


def _of(model: mujoco.MjModel, wiring: Wiring) -> Wiring:
    """The same joints and actuators in the file's own model, whose base floats where it was held to be diagnosed."""
    targets = wiring.targets
    return wire(model, joints=targets.joint, actuators=targets.command, interface=wiring.interface)


def _holds(model: mujoco.MjModel, wiring: Wiring, entries: Sequence[Entry], period: float, substeps: int) -> bool:
    try:
        return model_file.holds(model, wiring, entries, period, substeps)
    except ValueError:  # a target that is the recording's own: of efforts, say
        return False


def _comment(
    found: Diagnosis, plant: Plant, named: Sequence[Entry], fitted: Sequence[Entry], kept: Sequence[str]
) -> str:
    """What the model is, with its effects and its numbers as fitted, and which of them a file lacks."""
    assert plant.file is not None
    said = [f"Made by tiago-mj diagnose {found.version}: {plant.file.name} with what diagnosis.json beside this names."]
    said += [_line(one, kept) for one in named]
    if not named:
        nothing = "" if fitted else ", so that nothing is changed but the time step"
        said.append(f"  No effect is named{nothing}.")
    if fitted:
        said += ["The model's own numbers as they were fitted:", *(_line(one, kept) for one in fitted)]
    if {one.name for one in (*named, *fitted)} - set(kept):
        said += textwrap.wrap(
            f'tiago_mj.gap.apply(model, "calibration.yaml") has all of them, the model being {plant.file.name}.', WIDTH
        )
    said += textwrap.wrap(
        f"Simulated with {plant.substeps} steps of {plant.period / plant.substeps:g} s to a command, at "
        f"{1 / plant.period:g} Hz.",
        WIDTH,
    )
    return "\n".join(said)


def _line(one: Entry, kept: Sequence[str]) -> str:
    where = "all" if one.target is None else ", ".join(one.target)
    values = ", ".join(f"{key} {value:g}" for key, value in sorted(one.parameters.items()))
    held = "" if one.name in kept else ": NOT HELD by a model file, see below"
    return f"  {one.name} on {where}{f': {values}' if values else ''}{held}"
