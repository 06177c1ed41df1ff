"""The scale of a load cell: measured readings over the contact forces that the simulator of the same grasp has.

Matched grasps are recordings whose commands, replayed through the simulator of the same robot and object, press the
same pads. Per grasp: least squares of (reading - bias) on simulated newtons over loading and hold, through zero; the
scale is the mean over grasps, its 90 % interval Student's over them.

The simulated force is (servo stiffness) × (servo error), so what is found is in units of the model's servo: 5 % in its
stiffness are 5 % in the scale. What the real drive loses on the way to the pad widens the interval by as much, or makes
a scale impossible (:mod:`tiago_mj.sensor_calibration.drive`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tiago_mj.gap.simulation import phases, replay, stability
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.io.quantities import NINETY
from tiago_mj.recordings.autocorrelation import integrated_time
from tiago_mj.recordings.recording import Array, Trial
from tiago_mj.sensor_calibration import drive
from tiago_mj.sensor_calibration.rest import Rest

#: A pad is pressed above this [N]; rows pressed less than this share of the largest force tell no slope.
TOUCHING: Final = 0.05
SHARE: Final = 0.1
#: Rows of one grasp that a slope needs.
MIN_ROWS: Final = 20
#: Largest rms residual of a matched grasp, as a share of its rms reading: beyond, simulator and recording do not show
#: the same grasp.
UNLIKE: Final = 0.3
#: Beyond this share of the newtons that press a pad, what the drive loses leaves no scale: it would be known to a
#: factor of two.
TOO_MUCH: Final = 1 / 3
#: A pad presses that reads so many deviations above its rest.
READS: Final = 6.0


@dataclass(frozen=True)
class Scale:
    """Scale of one load cell and its uncertainty.

    Attributes:
        sensor: name.
        per_newton: [sensor units / N].
        interval: 90 %.
        grasps: recordings it is from.
        unlike: recordings that press the pad, but otherwise than simulated: left out.
        misfit: rms residual as a share of the rms reading, of those used.
        lost: by how much the drive's force may be off [N], and of how many newtons.
        turned: scale where the force had fallen over that where it had risen, less 1; 0 where not told from it.
    """

    sensor: str
    per_newton: float
    interval: tuple[float, float]
    grasps: int
    unlike: int
    misfit: float
    lost: tuple[float, float] = (0.0, 0.0)
    turned: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the scale is known at all, given the loss of the drive."""
        return self.lost[0] <= TOO_MUCH * self.lost[1]


@dataclass(frozen=True)
class Simulated:
    """Simulated forces on the pads, from the recorded commands.

    Attributes:
        newtons: by sensor, one (T,) a trial [N].
        slope: rows of loading and hold, (T,) a trial.
        touched: rows in which any pad is pressed, (T,) a trial.
        signals: everything, one row a trial.
    """

    newtons: Mapping[str, list[Array]]
    slope: list[NDArray[np.bool_]]
    touched: list[NDArray[np.bool_]]
    signals: replay.Signals


def simulated(plant: Plant, trials: Sequence[Trial], *, threads: int = 0) -> Simulated:
    """Simulate the recorded commands with the nominal model."""
    on = replay.grid(plant, trials)
    signals = replay.simulate(plant, on, [(k, ()) for k in range(len(trials))], replay.Run(threads))
    stability.check_nominal(plant, on, signals)
    phase = phases.phases(plant, signals)
    rows = [len(trial.time) for trial in trials]
    force = signals.newtons
    return Simulated(
        newtons={name: [force[k, :n, s] for k, n in enumerate(rows)] for s, name in enumerate(plant.sensors)},
        slope=[np.isin(phase[k, :n], (phases.LOADING, phases.HOLD)) for k, n in enumerate(rows)],
        touched=[np.any(force[k, :n] > TOUCHING, axis=1) for k, n in enumerate(rows)],
        signals=signals,
    )


def scales(plant: Plant, trials: Sequence[Trial], known: Simulated, rests: Sequence[Rest]) -> tuple[Scale, ...]:
    """Scale of every load cell that was pressed, by regression of readings on simulated forces.

    Args:
        plant: of the trials.
        trials: recordings.
        known: what was simulated of them.
        rests: readings without contact.
    """
    by_name = {rest.sensor: rest for rest in rests}
    free = [~known.touched[k] & ~_reads(trial, by_name) for k, trial in enumerate(trials)]
    lost = drive.lost(plant, trials, known.signals, free)
    found = (
        _sensor(name, trials, known, by_name[name].bias, lost.get(name)) for name in known.newtons if name in by_name
    )
    return tuple(scale for scale in found if scale is not None)


def _reads(trial: Trial, rests: Mapping[str, Rest]) -> NDArray[np.bool_]:
    """Mask of the rows in which a cell reads significantly more than at rest, (T,)."""
    out = np.zeros(len(trial.time), dtype=bool)
    for name, values in trial.forces.items():
        if name in rests:
            out |= np.nan_to_num(values - rests[name].bias) > READS * rests[name].noise
    return out


def _sensor(name: str, trials: Sequence[Trial], known: Simulated, bias: float, lost: drive.Lost | None) -> Scale | None:
    most = 0.0 if lost is None else lost.most
    slopes, errors, misfits, sizes, unlike, turned = [], [], [], [], 0, []
    for k, trial in enumerate(trials):
        newtons = known.newtons[name][k]
        if name not in trial.forces:
            continue
        values = trial.forces[name] - bias
        rows = known.slope[k] & np.isfinite(values) & (newtons > max(TOUCHING, SHARE * float(newtons.max(initial=0.0))))
        if rows.sum() < MIN_ROWS:
            continue
        x, y = newtons[rows], values[rows]
        sizes.append(float(np.sqrt(np.mean(x**2))))
        slope, error, misfit = _slope(x, y)
        if slope <= 0 or misfit > UNLIKE:
            unlike += 1
            continue
        slopes.append(slope)
        misfits.append(misfit)
        errors.append(error)
        turned += _turned(x, y, drive.fallen(newtons)[rows])
    size = float(np.mean(sizes)) if sizes else 0.0
    if not slopes:
        lost_it = Scale(name, 0.0, (0.0, 0.0), 0, unlike, 0.0, (most, size))
        return None if lost_it.known else lost_it
    mean, count = float(np.mean(slopes)), len(slopes)
    within = float(np.sqrt(np.sum(np.square(errors))) / count)
    half = max(NINETY * within, _between(slopes))
    share = min(most / size, 0.9)  # beyond a third nothing is said of it
    ratio = _apart(turned)
    low = min(mean - half, mean / (1 + share) - half, mean * (1 - abs(ratio)) - half)
    high = max(mean + half, mean / (1 - share) + half, mean * (1 + abs(ratio)) + half)
    misfit = float(np.sqrt(np.mean(np.square(misfits))))
    return Scale(name, mean, (low, high), count, unlike, misfit, (most, size), ratio)


def _slope(x: Array, y: Array) -> tuple[float, float, float]:
    """Slope through zero, its standard error, and the rms residual as a share of the rms reading."""
    slope = float(x @ y / (x @ x))
    left = y - slope * x
    error = float(np.sqrt(np.mean(left**2) / (x @ x) * integrated_time(left - left.mean())))
    return slope, error, float(np.sqrt(np.mean(left**2) / np.mean(y**2)))


def _turned(x: Array, y: Array, fallen: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Ratio of the slopes after a fall and after a rise of the force, minus 1, and its standard error; None without
    both."""
    if min(int(fallen.sum()), int((~fallen).sum())) < MIN_ROWS:
        return []
    (down, down_error, _), (up, up_error, _) = _slope(x[fallen], y[fallen]), _slope(x[~fallen], y[~fallen])
    return [(down / up - 1, float(np.hypot(down_error, up_error)) / abs(up))] if up > 0 else []


def _apart(turned: Sequence[tuple[float, float]]) -> float:
    """Mean over grasps of the ratio of :func:`_turned`; 0 where it is not significant."""
    if not turned:
        return 0.0
    values = np.array([value for value, _ in turned])
    mean, within = float(values.mean()), float(np.sqrt(np.mean([error**2 for _, error in turned]) / len(turned)))
    return mean if abs(mean) > max(drive.CLEAR * within, _between(values)) else 0.0


def _between(values: Sequence[float] | Array) -> float:
    """Half-width of Student's 90 % interval of a mean; 0 for one value."""
    count = len(values)
    if count < 2:
        return 0.0
    return float(stats.t.ppf(0.95, count - 1)) * float(np.std(values, ddof=1) / np.sqrt(count))
