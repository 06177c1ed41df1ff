"""How far the simulated contact force may be off since the real drives are not the simulated ones.

A simulated contact force is the servo's force less what the simulated drive loses. Dry friction that the model lacks
takes as much of it when a finger closes, gives as much back when it opens, and anything in between at rest. Two things
show it: open fingers that move, where the servo then pushes with another force than simulated (seen in the effort, and
in how far the finger lags), and a scale that is another one when the force has risen than when it has fallen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Signals
from tiago_mj.io.quantities import NINETY
from tiago_mj.models import names
from tiago_mj.recordings import robust
from tiago_mj.recordings.recording import Array, Trial

Mask = NDArray[np.bool_]

#: A finger moves that is faster than this share of the fastest, in simulation and recording.
MOVING: Final = 0.05
#: What errs within so long errs together [s]; so many of these stretches are needed.
TOGETHER: Final = 0.1
MIN_STRETCHES: Final = 3
#: Speeds that span this factor tell dry friction from viscous.
SPEEDS: Final = 3.0
#: A force of the drive counts that is so many of its standard errors.
CLEAR: Final = 3.0
#: A force has turned when it is so far, of the largest, from where it was last highest or lowest.
TURNED: Final = 0.05


@dataclass(frozen=True)
class Lost:
    """Force that the drive of one finger loses beyond the simulated loss, while the finger moves freely.

    Attributes:
        force: [N]; negative where it loses less.
        error: one standard error [N].
    """

    force: float
    error: float

    @property
    def most(self) -> float:
        """Bound on the error of a simulated contact force [N]; 0 where no loss is significant."""
        return abs(self.force) + NINETY * self.error if abs(self.force) > CLEAR * self.error else 0.0


def lost(plant: Plant, trials: Sequence[Trial], signals: Signals, untouched: Sequence[Mask]) -> Mapping[str, Lost]:
    """Force that every finger's drive loses, by its load cell; without those that hardly move freely.

    Args:
        plant: of the trials.
        trials: recordings of commands.
        signals: simulated, one row a trial.
        untouched: rows in which no pad is pressed, neither in simulation nor in the recording, (T,) a trial.
    """
    found = {}
    for sensor, joint in zip(names.SIDES, names.FINGERS, strict=True):
        if sensor not in plant.sensors or joint not in plant.actuators:
            continue
        each = [
            one
            for kind in ("effort", "position")
            if (one := _lost(plant, trials, signals, untouched, joint, kind)) is not None
        ]
        if each:
            found[sensor] = min(each, key=lambda one: abs(one.force))
    return found


def _lost(
    plant: Plant, trials: Sequence[Trial], signals: Signals, untouched: Sequence[Mask], joint: str, kind: str
) -> Lost | None:
    """Lost force from one kind of channel; None without that channel or without free motion."""
    j = plant.joints.index(joint)
    fastest = MOVING * float(np.abs(signals.velocity[:, :, j]).max(initial=0.0))
    means, speeds = [], []
    for k, trial in enumerate(trials):
        position = trial.positions.get(joint)
        if position is None or (kind == "effort" and joint not in trial.efforts):
            continue
        rows = len(trial.time)
        speed = trial.velocities.get(joint)
        measured = np.gradient(position, trial.time) if speed is None else speed
        simulated = signals.velocity[k, :rows, j]
        if kind == "effort":
            apart = trial.efforts[joint] - signals.effort[k, :rows, j]
        else:
            apart = -_stiffness(plant, joint) * (position - signals.position[k, :rows, j])
        direction = np.sign(simulated)
        free = untouched[k] & np.isfinite(apart) & (np.abs(simulated) > fastest) & (measured * direction > fastest)
        length = max(round(TOGETHER / plant.period), 1)
        for first in range(0, rows, length):
            some = slice(first, first + length)
            if free[some].sum() * 2 > length:
                means.append(float(np.median((apart * direction)[some][free[some]])))
                speeds.append(float(np.median(np.abs(simulated[some][free[some]]))))
    if len(means) < MIN_STRETCHES:
        return None
    force, speed_of = np.array(means), np.array(speeds)
    if speed_of.max() > SPEEDS * speed_of.min():
        columns = np.stack([np.ones_like(speed_of), speed_of], axis=1)
        solved, *_ = np.linalg.lstsq(columns, force, rcond=None)
        left = force - columns @ solved
        spread = float(np.sqrt(left @ left / max(len(left) - 2, 1)))
        return Lost(float(solved[0]), spread * float(np.sqrt(np.linalg.inv(columns.T @ columns)[0, 0])))
    middle = float(np.median(force))
    spread = robust.deviation(force)
    return Lost(middle, 1.25 * spread / float(np.sqrt(len(force))))


def _stiffness(plant: Plant, joint: str) -> float:
    """Of the servo [N/m]."""
    index = plant.wiring.actuators[plant.actuators.index(joint)]
    return float(-plant.model.actuator_biasprm[index, 1])


def fallen(newtons: Array) -> Mask:
    """Mask of the rows that a falling force has reached, (T,); in the others it has risen."""
    turn = TURNED * float(newtons.max(initial=0.0))
    out = np.zeros(len(newtons), dtype=bool)
    falling, extreme = False, 0.0
    for t, value in enumerate(newtons):
        extreme = min(extreme, value) if falling else max(extreme, value)
        if abs(value - extreme) > turn:
            falling, extreme = not falling, value
        out[t] = falling
    return out
