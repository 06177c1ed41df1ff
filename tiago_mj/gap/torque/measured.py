"""Recordings of motion and efforts as trials on one grid, with what every reading is known to.

What is compared is the effort behind a low-pass, row by row of a grid as coarse as its cut-off allows, so that the
noise of one row tells nothing of the next one's. A reading is known to the effort's own noise and to what the noise of
the positions makes of the torque that is computed from them, differentiated twice: that is drawn once along every
trial and goes the way of the measured motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.now import Wiring
from tiago_mj.gap.inference.noise_model import BLOCK_SECONDS, Data
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Grid, Signals
from tiago_mj.gap.simulation.session import Session, split
from tiago_mj.gap.torque.channels import Usable, Wanted, choose
from tiago_mj.gap.torque.predictor import ROWS_PER_PERIOD, EffortPredictor
from tiago_mj.gap.torque.strips import Course
from tiago_mj.gap.torque.torques import Torques
from tiago_mj.io.deadline import Deadline
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]

#: Fewer trials are cut into parts, about so many of all together, none shorter than so many periods of the cut-off.
ENOUGH_TRIALS: Final = 6
PARTS: Final = 12
SHORTEST_PERIODS: Final = 6.0
#: Share of a drive's limit that a motion is taken to use at least where it is asked how large efforts are: the zero of
#: a torque sensor is a share of what it can measure, 0.5 % in the blind check, and 2 % of this is as much.
USED: Final = 0.25
#: Share of a channel's effort to which torques along a filtered motion are known at best: what filtering,
#: differentiating and the instant of a reversal cost on simulated arms that the model describes exactly.
METHOD: Final = 5e-3


@dataclass(frozen=True)
class Measured:
    """What is compared along the motion.

    Attributes:
        session: trials on the grid that is compared, by their splits, and the plant with the joints that move.
        predict: efforts along their motions.
        assumed: what they are compared with, to what can be expected of trials that were not seen.
        motion: as it was measured, filtered, one row a trial.
        usable: channels, and what was found of them.
        course: motion and efforts on the finer grid of the torques.
    """

    session: Session
    predict: EffortPredictor
    assumed: Data
    motion: Signals
    usable: Usable
    course: Course


def measured(session: Session, trials: Sequence[Trial], wanted: Wanted, share: float) -> Measured:
    """Trials at one cut-off.

    Args:
        session: the recordings.
        trials: with positions and efforts.
        wanted: what is asked for.
        share: of the highest cut-off.

    Raises:
        OutOfTimeError: the deadline is over.
        RecordingError: nothing can be compared; one line.
        ValueError: the model lacks a joint.
    """
    plant, deadline = session.plant, wanted.deadline
    usable = choose(trials, plant.model, wanted, share)
    course = usable.course if len(trials) >= ENOUGH_TRIALS else _in_parts(usable.course)
    names = list(dict.fromkeys(strip.trial for strip in course.strips))
    every = max(int(course.rate / (ROWS_PER_PERIOD * course.cutoff)), 1)
    torques = tuple(Torques(plant.model, course.of_trial(name), plant.given, deadline) for name in names)
    torques = tuple(one for one in torques if _moving(one)[::every].any()) or torques  # the others tell nothing
    names = [one.course.strips[0].trial for one in torques]
    whole = replace(course, strips=tuple(strip for one in torques for strip in one.course.strips))
    along = replace(
        plant,
        wiring=usable.torques.wiring,
        period=every / course.rate,
        effort_row=course.period,
        largest_effort=_largest(course, usable.torques.wiring),
        cell=None,
        pads=None,
    )
    there = {trial.name: trial for trial in trials}
    resampled = [
        _resampled(replace(there.get(one) or there[one.rpartition("-")[0]], name=one), torques[k].course, every)
        for k, one in enumerate(names)
    ]
    compared = Session(along, resampled, session.recorded, split(names))
    data = _data(along, torques, every, wanted.seed)
    predict = EffortPredictor(
        plant=along,
        on=_grid(along, resampled),
        data=data,
        seed=wanted.seed,
        corrected=0.0,
        deadline=deadline or Deadline(),
        torques=torques,
        whole=Torques(plant.model, whole, plant.given, deadline),
        every=every,
    )
    return Measured(compared, predict, data, _motion(torques, every, data.value.shape[1]), usable, course)


def _in_parts(course: Course) -> Course:
    """Few trials in parts, each long enough to tell its rows from its neighbours'."""
    seconds = sum(course.lengths) / course.rate
    return course.in_parts(max(seconds / PARTS, SHORTEST_PERIODS / course.cutoff))


def _resampled(trial: Trial, course: Course, every: int) -> Trial:
    """A trial as it is compared: times, motion, efforts where the joint moves."""
    moving = course.moving()
    efforts = {
        name: np.where(moving[:, j], values, np.nan)[::every]
        for name, j, values in zip(course.channels, course.columns, course.stack("effort").T, strict=True)
    }
    positions, velocities = (
        dict(zip(course.joints, course.stack(kind)[::every].T, strict=True)) for kind in ("position", "velocity")
    )
    return replace(
        trial,
        time=np.concatenate([strip.time for strip in course.strips])[::every],
        commands={},
        positions=positions,
        velocities=velocities,
        efforts=efforts,
        forces={},
        extras={},
    )


def _data(plant: Plant, torques: Sequence[Torques], every: int, seed: int) -> Data:
    """Efforts of all trials, with their noise and tolerance."""
    course = torques[0].course
    values = [np.where(_moving(one), one.course.stack("effort"), np.nan)[::every] for one in torques]
    value = _padded(values, np.nan)
    noise = np.max([strip.noise for one in torques for strip in one.course.strips], axis=0)
    size = np.sqrt(np.nanmean(value**2, axis=(0, 1)))
    own = np.maximum(np.hypot(noise, _noise_of_motion(torques, seed)), 1e-9)
    leaked = _padded([_leaked(one)[::every] for one in torques], 0.0)
    whole = np.hypot(np.hypot(own, METHOD * size), leaked)
    return Data(
        tuple(f"effort.{name}" for name in course.channels),
        np.array(course.columns, dtype=int),
        value,
        np.maximum(own, METHOD * size),  # logs that were filtered before look as if they had no noise at all
        whole,
        np.zeros_like(whole),
        block=max(round(BLOCK_SECONDS / plant.period), 1),
    )


def _noise_of_motion(torques: Sequence[Torques], seed: int) -> Array:
    """Standard deviation of the torque that the noise of the positions makes, (c,) [N, N·m]."""
    rng = np.random.default_rng(seed)
    square = count = np.zeros(len(torques[0].course.channels))
    for one in torques:
        change = (one.with_noise(rng).nominal - one.nominal)[:, one.course.columns]
        moving = _moving(one)
        square, count = square + np.where(moving, change**2, 0.0).sum(axis=0), count + moving.sum(axis=0)
    noise: Array = np.sqrt(square / np.maximum(count, 1))
    return noise


def _leaked(torques: Torques) -> Array:
    """How unsure rows are for a joint that sticks, (T, c) [N, N·m]: by all of its friction, the model's own too."""
    course = torques.course
    return course.leaked(course.stack("effort") - torques.frictionless[:, course.columns])


def known_at_best(data: Data, spread: Array) -> Data:
    """Data no better known than to a deviation by channel, (C,) [N, N·m]; what the filter mixes in comes on top."""
    least = data.sigma.min(axis=(0, 1))
    return replace(data, sigma=np.sqrt(data.sigma**2 + np.maximum(spread, least) ** 2 - least**2))


def clear(data: Data) -> NDArray[np.bool_]:
    """Rows that were measured, (ntrials, T, C), and of which less is mixed in than they are known to; all, where these
    are no more than half of a channel's."""
    seen = np.isfinite(data.value)
    little = seen & (data.sigma < np.sqrt(2) * data.sigma.min(axis=(0, 1)))
    return np.asarray(np.where(2 * little.sum(axis=(0, 1)) > seen.sum(axis=(0, 1)), little, seen))


def _moving(torques: Torques) -> NDArray[np.bool_]:
    return np.asarray(torques.course.moving()[:, torques.course.columns])


def _largest(course: Course, wiring: Wiring) -> tuple[float, ...]:
    """Effort of every joint at most: measured, or a share of its drive's limit where that is more; 0 of joints without
    a channel [N, N·m]."""
    targets, largest = wiring.targets, np.zeros(len(course.joints))
    largest[course.columns] = np.nanmax(np.abs(course.stack("effort")), axis=0)
    for a, j in enumerate(targets.actuated):
        limit, at = targets.nominal("effort", "command", a), course.joints.index(targets.joint[j])
        if at in course.columns and np.isfinite(limit):
            largest[at] = max(largest[at], USED * limit)
    return tuple(largest.tolist())


def _motion(torques: Sequence[Torques], every: int, rows: int) -> Signals:
    """The measured motion, padded with its end; effort is what was measured, 0 of joints without a channel."""
    position: list[Array] = []
    velocity: list[Array] = []
    effort: list[Array] = []
    for one in torques:
        course = one.course
        given = np.zeros((len(course.stack("time")), len(course.joints)))
        given[:, course.columns] = course.stack("effort")
        for found, values in zip(
            (position, velocity, effort), (course.stack("position"), course.stack("velocity"), given), strict=True
        ):
            found.append(values[::every])
    none = np.zeros((len(torques), rows, 0))
    moved = [np.pad(one, ((0, rows - len(one)), (0, 0)), mode="edge") for one in position]
    return Signals(np.stack(moved), _padded(velocity, 0.0, rows), _padded(effort, 0.0, rows), none, none)


def _padded(values: Sequence[Array], by: float, rows: int = 0) -> Array:
    """One row a trial, (ntrials, T, n)."""
    length = max(rows, *(len(one) for one in values))
    out = np.full((len(values), length, values[0].shape[1]), by)
    for k, one in enumerate(values):
        out[k, : len(one)] = one
    return out


def _grid(plant: Plant, trials: Sequence[Trial]) -> Grid:
    """Times of the trials; nothing is commanded."""
    rows = np.array([len(trial.time) for trial in trials])
    length = max(int(rows.max()) - 1, 1)
    period = np.full((len(trials), length), plant.period)
    return Grid(tuple(trials), rows, period, True, np.zeros((len(trials), length, len(plant.actuators))))
