"""A nominal simulator that diverges under the recorded commands: where, and what is likely to mend it.

The likely causes are tried, one after the other, on the trial that diverged.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Final

import mujoco
import numpy as np

from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Grid, Signals
from tiago_mj.recordings.recording import RecordingError

#: Physics steps that are tried, as shares of the one that diverges.
STEP_SHARES: Final = (1 / 2, 1 / 4, 1 / 10)
#: A hinge that was recorded so many times beyond its range has a range in the wrong unit: 180 / π.
RADIAN_MISTAKE_RATIO: Final = 10.0


def check_nominal(plant: Plant, on: Grid, nominal: Signals) -> None:
    """Refuse a nominal replay that did not reach its end.

    Args:
        plant, on: what was replayed.
        nominal: one row a trial, without effects.

    Raises:
        RecordingError: with the trial, the time, and the likely mend; one line.
    """
    gone = np.flatnonzero(nominal.diverged)
    if not len(gone):
        return
    trial = int(gone[0])
    row = int(np.argmin(np.isfinite(nominal.velocity[trial]).all(axis=-1)))
    others = f" and {len(gone) - 1} more" if len(gone) > 1 else ""
    raise RecordingError(
        f"{on.trials[trial].source}{others}: {plant.name} diverges after {on.trials[trial].time[row]:.2g} s under the "
        f"recorded commands, so nothing can be compared: {likely_mend(plant, on, trial)}"
    )


def likely_mend(plant: Plant, on: Grid, trial: int) -> str:
    """What keeps the simulation of a trial from diverging, or else what to look at."""
    beyond = _beyond_its_range(plant, on, trial)
    if beyond:
        return f'{beyond} was recorded far beyond its range: are the model\'s angles radians? Add angle="radian"'
    step = min(plant.max_timestep, plant.period)
    for share in STEP_SHARES:
        if _survives(replace(plant, max_timestep=step * share), on, trial):
            return f'with a shorter step it does not: set <option timestep="{step * share:.2g}"/>'
    damped = copy.copy(plant.model)
    damped.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    if _survives(replace(plant, model=damped), on, trial):
        return 'with another integrator it does not: set <option integrator="implicitfast"/>'
    damped.dof_damping[:] += 2 * np.sqrt(_stiffness(plant) * plant.model.dof_M0)
    if _survives(replace(plant, model=damped), on, trial):
        return 'with damped joints it does not: give the joints damping, or the servos kv (or dampratio="1")'
    return "look at the units of commands and model (radians or degrees), at the gains, at masses and inertias"


def _survives(plant: Plant, on: Grid, trial: int) -> bool:
    return not bool(replay.simulate(plant, on, [(trial, ())]).diverged[0])


def _stiffness(plant: Plant) -> float:
    """Of the stiffest servo [N/m, N·m/rad]; 1 where there is none."""
    return float(max(-plant.model.actuator_biasprm[:, 1].min(initial=0.0), 1.0))


def _beyond_its_range(plant: Plant, on: Grid, trial: int) -> str:
    """A hinge that was measured or commanded many times beyond its range; "" if there is none."""
    recorded = on.trials[trial]
    for name in plant.joints:
        joint = plant.model.joint(name)
        seen = recorded.positions.get(name)
        if joint.type[0] != mujoco.mjtJoint.mjJNT_HINGE or not joint.limited[0] or seen is None:
            continue
        if np.nanmax(np.abs(seen), initial=0.0) > RADIAN_MISTAKE_RATIO * max(abs(joint.range[0]), abs(joint.range[1])):
            return name
    return ""
