"""One case: recorded, simulated at the truth, and what that leaves."""

from __future__ import annotations

import copy
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from benchmarks.blind import cases, recordings, robots
from benchmarks.blind.cases import Case, Made
from benchmarks.blind.dictionary import ARM, GRIPPER, PLAIN
from benchmarks.machine import machine
from benchmarks.truth_audit.residuals import Left, left, noise_of
from benchmarks.truth_audit.truths import lost, numbers, truths
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant, plant_of
from tiago_mj.recordings.read import read_recordings

#: Physics steps of the library that are tried [s]: the environments' own, and one at which halving it changes what is
#: left by no more than 0.02 noise variances (measured with no effect), by setting.
COARSE: Final = 2.1e-3
FINE: Final = {GRIPPER: 1.25e-4, PLAIN: 1.25e-4, ARM: 2.5e-4}
#: Integrators at the fine step, where the model's own needs a finer one: ``implicitfast`` adds damping to the inertia
#: after dry friction was found, so that a wrist that friction holds gives way as if it were heavier. In ``arm/none/0``
#: it leaves 50, 15, 4.4, 1.9 and 1.3 at 2, 1, 0.5, 0.25 and 0.125 ms, Euler 1.2 at each of them; at 2 ms Euler would
#: not bear a wrist that moves.
INTEGRATOR: Final = {ARM: mujoco.mjtIntegrator.mjINT_EULER}


@dataclass(frozen=True)
class Opened:
    """A case recorded, and read as a diagnosis reads it."""

    made: Made
    plant: Plant
    on: replay.Grid
    data: noise_model.Data
    numbers: tuple[tuple[Entry, ...], ...]


def opened(case: Case) -> Opened:
    """Record a case, read its recordings, and find the true numbers."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if case.setting == PLAIN:
            (folder / robots.PLAIN_FILE).write_text(robots.PLAIN)
        made = cases.simulate(case, folder)
        recordings.write(made, folder)
        trials = read_recordings([folder]).trials
        plant = plant_of(trials)
        on, data = replay.grid(plant, trials), noise_model.collect(plant, trials)
        missed = lost(made)
        if missed is not None and case.effects[0].name == "dropped_commands":
            on = replace(on, delivered=1.0 - missed)
        elif missed is not None:
            value = data.value.copy()
            for c, name in enumerate(data.channels):
                if name.startswith("force."):
                    value[..., c][missed[..., plant.sensors.index(name.partition(".")[2])]] = np.nan
            data = replace(data, value=value)
        return Opened(made, _begun(made, plant, on), on, data, numbers(made, plant, folder))


def _begun(made: Made, plant: Plant, on: replay.Grid) -> Plant:
    """The plant with its joints where they truly are at first: a replay begins at the first reading, whose noise stays
    where friction or play holds a joint. Behind an encoder's own effect it begins there."""
    sensed = any(overrides(EFFECTS[effect.name], "measure_position") for effect in made.case.effects)
    if sensed or made.recorded.begun is None:
        return plant
    columns = [made.robot.joints.index(joint) for joint in plant.joints]
    starts = dict(plant.starts)
    for trial, true in zip(on.trials, made.recorded.begun, strict=True):
        qpos = starts[trial.name].qpos.copy()
        qpos[plant.wiring.qpos] = true[columns]
        starts[trial.name] = replace(starts[trial.name], qpos=qpos)
    return replace(plant, starts=starts)


@dataclass(frozen=True)
class Audited:
    """What the library leaves of a case: apart from rows at which a touch begins or ends, of all rows, and the form of
    the effect that leaves least."""

    rest: Left
    of_all: Left
    form: Mapping[str, float]


def audited(one: Opened, step: float, *, with_effect: bool = True) -> Audited:
    """What the library leaves at a physics step [s]: of the forms of the effect, the one that leaves least."""
    plant = replace(one.plant, max_timestep=min(step, one.plant.max_timestep))
    if step < COARSE and one.made.case.setting in INTEGRATOR:
        model = copy.copy(plant.model)
        model.opt.integrator = int(INTEGRATOR[one.made.case.setting])
        plant = replace(plant, model=model)
    predict = Predictor(plant, one.on, one.data, threads=1, corrected=False)
    sigma, grid = noise_of(one.made, one.data.channels)
    found = []
    for effects in truths(one.made.case, one.made.robot) if with_effect else [()]:
        predicted = predict([(k, (*effects, *numbers)) for k, numbers in enumerate(one.numbers)])
        both = (left(one.data.value, predicted, sigma, grid, one.data.channels, onsets=o) for o in (False, True))
        forms = {n: v for e in effects for n, v in e.parameters.items() if n in EFFECTS[e.name].forms}
        found.append(Audited(*both, forms))
    return min(found, key=lambda one: float(one.rest.pooled.max()))


def row(name: str, case: Case, ways: Sequence[str] = ("coarse", "fine")) -> dict[str, Any]:
    """One case as it is kept."""
    begun, fine = time.perf_counter(), FINE[case.setting]
    one, commit = opened(case), machine()["commit"]
    out: dict[str, Any] = {
        "case": name,
        "rate_hz": case.rate,
        "interface": case.interface,
        "effects": [{"name": e.name, "target": e.target, "parameters": e.parameters} for e in case.effects],
        "without": round(float(audited(one, COARSE, with_effect=False).rest.pooled.max()), 2),
    }
    for way in ways:
        step = fine if way == "fine" else COARSE
        found = audited(one, step)
        rest, strict, forms = found.rest, found.of_all, found.form
        out[way] = {
            "step_ms": 1e3 * step,
            "commit": commit,
            "channels": {n: round(float(v), 3) for n, v in zip(rest.channels, rest.pooled, strict=True)},
            "worst": round(float(rest.pooled.max()), 3),
            "worst_trial": round(float(np.nanmax(rest.trial)), 3),
            "beyond_chance": rest.beyond_chance,
            "passes": rest.passes,
            "onset_rows": rest.onsets[0],
            "worst_at_onsets": round(rest.onsets[1], 1),
            "worst_with_onsets": round(float(strict.pooled.max()), 3),
            "passes_with_onsets": strict.passes,
            **({"form": forms} if forms else {}),
        }
    return {**out, "seconds": round(time.perf_counter() - begun, 1)}
