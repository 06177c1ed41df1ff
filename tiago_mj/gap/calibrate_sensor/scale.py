"""The scale of a load cell: measured readings over the contact forces that the simulator of the same grasp has.

Matched grasps are recordings whose commands, replayed through the simulator of the same robot and object, press the
same pads. Per grasp: least squares of (reading - bias) on simulated newtons over loading and hold, through zero; the
scale is the mean over grasps, its 90 % interval Student's over them.

The simulated force is (servo stiffness) × (servo error), so what is found is in units of the model's servo: 5 % in its
stiffness are 5 % in the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tiago_mj.gap import phases, replay
from tiago_mj.gap.plant import Plant
from tiago_mj.gap.recording import Array, Trial

#: A pad is pressed above this [N]; rows pressed less than this share of the largest force tell no slope.
TOUCHING: Final = 0.05
SHARE: Final = 0.1
#: Rows of one grasp that a slope needs.
LEAST: Final = 20
#: Largest rms residual of a matched grasp, as a share of its rms reading: beyond, simulator and recording do not show
#: the same grasp.
UNLIKE: Final = 0.3


@dataclass(frozen=True)
class Scale:
    """Of one load cell.

    Attributes:
        sensor: name.
        per_newton: [sensor units / N].
        interval: 90 %.
        grasps: recordings it is from.
        unlike: recordings that press the pad, but otherwise than simulated: left out.
        misfit: rms residual as a share of the rms reading, of those used.
    """

    sensor: str
    per_newton: float
    interval: tuple[float, float]
    grasps: int
    unlike: int
    misfit: float


@dataclass(frozen=True)
class Simulated:
    """The recordings' commands, replayed.

    Attributes:
        newtons: by sensor, one (T,) a trial [N].
        slope: rows of loading and hold, (T,) a trial.
        touched: rows in which any pad is pressed, (T,) a trial.
    """

    newtons: Mapping[str, list[Array]]
    slope: list[NDArray[np.bool_]]
    touched: list[NDArray[np.bool_]]


def simulated(plant: Plant, trials: Sequence[Trial], *, threads: int = 0) -> Simulated:
    """Replay the commands of trials with the nominal model."""
    on = replay.grid(plant, trials)
    signals = replay.simulate(plant, on, [(k, ()) for k in range(len(trials))], threads=threads)
    phase = phases.phases(plant, on, signals)
    rows = [len(trial.time) for trial in trials]
    force = signals.newtons
    return Simulated(
        newtons={name: [force[k, :n, s] for k, n in enumerate(rows)] for s, name in enumerate(plant.sensors)},
        slope=[np.isin(phase[k, :n], (phases.LOADING, phases.HOLD)) for k, n in enumerate(rows)],
        touched=[np.any(force[k, :n] > TOUCHING, axis=1) for k, n in enumerate(rows)],
    )


def scales(trials: Sequence[Trial], known: Simulated, bias: Mapping[str, float]) -> tuple[Scale, ...]:
    """Scale of every load cell that was pressed.

    Args:
        trials: recordings.
        known: what was simulated of them.
        bias: reading without contact, by sensor [sensor units].
    """
    found = (_sensor(name, trials, known, bias[name]) for name in known.newtons if name in bias)
    return tuple(scale for scale in found if scale is not None)


def _sensor(name: str, trials: Sequence[Trial], known: Simulated, bias: float) -> Scale | None:
    slopes, errors, misfits, unlike = [], [], [], 0
    for k, trial in enumerate(trials):
        newtons = known.newtons[name][k]
        if name not in trial.forces:
            continue
        values = trial.forces[name] - bias
        rows = known.slope[k] & np.isfinite(values) & (newtons > max(TOUCHING, SHARE * float(newtons.max(initial=0.0))))
        if rows.sum() < LEAST:
            continue
        x, y = newtons[rows], values[rows]
        slope = float(x @ y / (x @ x))
        left = y - slope * x
        misfit = float(np.sqrt(np.mean(left**2) / np.mean(y**2)))
        if slope <= 0 or misfit > UNLIKE:
            unlike += 1
            continue
        slopes.append(slope)
        misfits.append(misfit)
        errors.append(float(np.sqrt(np.mean(left**2) / (x @ x) * _correlation(left))))
    if not slopes:
        return None
    mean, count = float(np.mean(slopes)), len(slopes)
    within = float(np.sqrt(np.sum(np.square(errors))) / count)
    between = float(np.std(slopes, ddof=1) / np.sqrt(count)) if count > 1 else 0.0
    factor = float(stats.t.ppf(0.95, count - 1)) if count > 1 else 0.0
    half = max(1.645 * within, factor * between)
    return Scale(name, mean, (mean - half, mean + half), count, unlike, float(np.sqrt(np.mean(np.square(misfits)))))


def _correlation(left: Array) -> float:
    """Residuals that are worth one independent one."""
    x = left - left.mean()
    power, total = float(x @ x), 1.0
    for lag in range(1, len(x) // 3):
        rho = float(x[:-lag] @ x[lag:]) / power if power else 0.0
        if rho < 2 / np.sqrt(len(x)):
            break
        total += 2 * rho
    return total
