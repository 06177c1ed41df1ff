"""Executed set points of the servos, estimated from their motion.

The likelihood has no useful gradient in a quantization or a dead band of the set point. A servo follows its set point
with a lag, so that its deviation from the predicted motion shows the difference of the set points. The magnitudes that
explain this best are the starts of ordinary fits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.detectors.liveliest import liveliest
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Grid, Signals, only_commands
from tiago_mj.io.deadline import Deadline

Array = NDArray[np.float64]

#: Parameter of effects that is how often a driver looks at its set point [s]; 0: at every command.
PERIOD: Final = "period"
#: Magnitudes that are looked at, from a hundredth of the bound to the bound, and around each of the best; how many of
#: them are simulated.
DENSE_MAGNITUDES: Final = 400
MAGNITUDES_AROUND_BEST: Final = 21
MAX_SIMULATED: Final = 3
#: Beside them grids of set points, from one to the next of which the lines farthest from the joint's zero move by this
#: share of a step: between them is nothing to see. No more than so many, the widest steps.
GRID_SHIFT: Final = 0.25
MAX_GRIDS: Final = 8000
#: Share of the way that a servo is behind by which its position is known worse: what nominal gains are known to.
LAG_SHARE: Final = 0.1
#: Squared residuals are clipped at this, in units of their variance, since other causes may act there: five deviations,
#: which Gaussian noise exceeds in one of 1.7 million samples.
MAX_SQUARED_RESIDUAL: Final = 25.0
#: Longest step at which a driver is followed that looks now and then [s].
DRIVER_STEP: Final = 2e-3


@dataclass(frozen=True)
class ServoMotion:
    """Measured motion of the servos and what it says about their set points.

    A servo is modelled as first order: from one row to the next it covers ``share`` of the remaining distance.

    Attributes:
        start: set points before the first command, (ntrials, nactuators) [m, rad].
        requested: what the commands ask for, after each row's command, (ntrials, T - 1, nactuators).
        position_residual: measured minus predicted position, by row, (ntrials, T, nactuators).
        deviation: one standard deviation of that; infinite where it says nothing (in contact, unmeasured).
        share: (nactuators,).
    """

    start: Array
    requested: Array
    position_residual: Array
    deviation: Array
    share: Array


def servo_motion(plant: Plant, on: Grid, data: Data, nominal: Signals) -> ServoMotion | None:
    """Residual of the measured motion from the nominal one, by servo; None for a plant without position servos.

    Args:
        plant, on, data: what was recorded.
        nominal: the nominal replay, one row a trial.
    """
    wiring = plant.wiring
    if wiring.interface == "effort" or not wiring.servo.all() or plant.relative:
        return None
    joints = list(wiring.targets.actuated)
    start = np.stack([plant.starts[trial.name].set_point for trial in on.trials])
    wanted = _requested(plant, on, start)
    rows = wanted.shape[1] + 1
    lead = _slewed(plant, on, start, wanted) - nominal.position[:, :rows][:, :, joints]
    speed = nominal.velocity[:, :rows][:, :, joints]
    free = untouched(data, nominal, rows)
    ahead, deviation = np.zeros(lead.shape), np.full(lead.shape, np.inf)
    share = np.ones(len(joints))
    columns = {name: c for c, name in enumerate(data.channels)}
    for a, joint in enumerate(joints):
        column = columns.get(f"position.{plant.joints[joint]}")
        if column is None:
            continue
        v = speed[:, :, a][free]
        lag = float(np.clip(v @ lead[:, :, a][free] / max(float(v @ v), 1e-12), 1e-6, 1.0))
        share[a] = 1 - np.exp(-plant.period / lag)
        measured = data.value[:, :rows, column] - nominal.position[:, :rows, joint]
        known = free & np.isfinite(measured)
        ahead[:, :, a] = np.where(known, measured, 0.0)
        noise = data.reading_noise[:, :rows, column]
        deviation[:, :, a] = np.where(known, np.hypot(noise, LAG_SHARE * lead[:, :, a]), np.inf)
    return ServoMotion(start, wanted, ahead, deviation, share)


def shares(plant: Plant, motion: ServoMotion | None) -> Array:
    """Fraction of its response to a force step that each joint completes in one row, (njoints,); 1 without a servo."""
    out = np.ones(len(plant.joints))
    if motion is not None:
        out[list(plant.wiring.targets.actuated)] = motion.share
    return out


def untouched(data: Data, nominal: Signals, rows: int) -> NDArray[np.bool_]:
    """Mask of the rows without contact, (ntrials, T)."""
    touching = np.zeros((nominal.position.shape[0], rows), dtype=bool)
    if nominal.newtons.shape[2]:
        touching |= np.any(nominal.newtons[:, :rows] > 0, axis=2)
        for c, name in enumerate(data.channels):
            if name.startswith("force."):
                touching |= np.nan_to_num(np.abs(data.value[:, :rows, c])) > 5 * data.noise[c]
    return ~touching


def magnitudes(
    plant: Plant,
    on: Grid,
    motion: ServoMotion,
    pool: Sequence[Candidate],
    trials: Sequence[int],
    deadline: Deadline | None = None,
) -> tuple[Candidate, ...]:
    """The pool, its effects on set points at the magnitudes of their grids that best explain the motion.

    Args:
        plant, on, motion: as of :func:`servo_motion`.
        pool: candidates.
        trials: that are looked at, in the liveliest of them at all magnitudes.
        deadline: asked before each of them; None: there is none.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    by = deadline or Deadline()
    commands = plant.wiring.targets.command

    first = liveliest_trials(motion, trials)

    def costs(wide: Candidate, values: Array, trials: Sequence[int]) -> Array:
        """Weighted sum of squares of the residual at each magnitude, (nvalues, nactuators)."""
        total = np.zeros((len(values), motion.requested.shape[2]))
        for t in trials:
            by.check()
            for squares in _squares(motion, t, passed(plant, on, motion, wide, values, t) - motion.requested[t]):
                total += squares
        return total

    out = list(pool)
    for name in dict.fromkeys(c.effect for c in pool):
        declared = EFFECTS[name]
        mine = [k for k, c in enumerate(pool) if c.effect == name and not dict(c.fixed).get(PERIOD)]
        wide = pool[mine[0]] if mine else next(c for c in pool if c.effect == name)
        if declared.stage != "command" or not overrides(declared, "set_point") or not np.isfinite(wide.identity):
            continue  # a limit is reached smoothly
        values = dense(wide, float(np.nanmax(np.abs(motion.requested))))
        cost = costs(wide, values, first)
        columns = [_columns(pool[k], commands) for k in mine]
        near = sorted({b for column in columns for b in minima(cost[:, column].sum(axis=1))})
        around = [
            np.linspace(values[max(b - 1, 0)], values[min(b + 1, len(values) - 1)], MAGNITUDES_AROUND_BEST)
            for b in near
        ]
        fine = np.unique(np.concatenate(around or [values[:1]]))
        cost = costs(wide, fine, trials)
        for k, column in zip(mine, columns, strict=True):
            total = cost[:, column].sum(axis=1)
            best = fine[minima(total)]
            if len(best):
                like = fine[total <= total.min() + 1.0]
                spread = max(float(np.ptp(like)) / 2, 1e-4 * float(best[0]))
                out[k] = replace(pool[k], grid=tuple(sorted({*pool[k].grid, *best.tolist()})), spread=spread)
    return tuple(out)


def liveliest_trials(motion: ServoMotion, trials: Sequence[int]) -> list[int]:
    """Those of some trials in which the commands move most, see :func:`~tiago_mj.gap.detectors.liveliest.liveliest`."""
    some = list(trials)
    moved = np.nansum(np.abs(np.diff(motion.requested[some], axis=1)), axis=(1, 2))
    rows = np.isfinite(motion.requested[some]).all(axis=2).sum(axis=1)
    return [some[k] for k in liveliest(moved, rows)]


def driven(
    plant: Plant, on: Grid, motion: ServoMotion, wide: Candidate, pairs: Array, trials: Sequence[int]
) -> Iterator[Array]:
    """Offset of the set points for each pair of magnitude and driver's period, for each of the T - 1 commands (npairs,
    ntrials, nsteps, nactuators), in steps of at most :data:`DRIVER_STEP`."""
    these, parts = list(trials), max(math.ceil(plant.period / DRIVER_STEP - 1e-6), 1)
    shape = (len(pairs), len(these), motion.requested.shape[2])
    size = shape[0] * shape[1]

    def flat(each: Array) -> Array:  # of every trial, for every pair
        return np.broadcast_to(each, (len(pairs), *each.shape)).reshape(size, *each.shape[1:])

    entries = [(Entry(wide.effect, None, {wide.parameter: float(w), PERIOD: float(p)}),) for w, p in pairs]
    path = _slewed(plant, on, motion.start, motion.requested)[these]
    chain = only_commands(plant, [entry for entry in entries for _ in these])
    now = chain.now
    now.set_point, now.substeps, now.dt = flat(motion.start[these]), parts, np.full(size, plant.period)
    now.takes_set_points = plant.wiring.servo & (plant.wiring.act < 0)
    effect = next(each for each in chain.effects if each.name == wide.effect)  # beside those that are given
    effect.start(now)
    passed = now.set_point.reshape(shape)
    for k in range(motion.requested.shape[1]):
        now.dt = flat(on.period[these, k])
        period = on.period[these, k, None]
        step, speed = period / parts, (path[:, k + 1] - path[:, k]) / period
        asked = flat(np.where(now.takes_set_points, path[:, k + 1], speed))
        jumps = effect.given(np.repeat(asked[:, None], parts, axis=1), now).reshape(*shape[:2], parts, shape[2])
        off = np.empty(jumps.shape)
        for j in range(parts):
            passed = np.where(now.takes_set_points, jumps[:, :, j], passed + jumps[:, :, j] * step)
            nominal = np.where(now.takes_set_points, path[:, k + 1], path[:, k] + (j + 1) * step * speed)
            off[:, :, j] = passed - nominal
        yield off


def dense(wide: Candidate, farthest: float, shift: float = GRID_SHIFT) -> Array:
    """Ascending grid of magnitudes on which the lines of a quantization move by ``shift`` of a step from one to the
    next, at the set point farthest from the joint's zero [m, rad]."""
    even = wide.identity + np.geomspace(0.01, 1.0, DENSE_MAGNITUDES) * (wide.high - wide.identity)
    if wide.parameter != "step":
        return even
    lines = np.arange(1 / even[-1], 1 / even[0], shift / max(farthest, even[-1]))[:MAX_GRIDS]
    return np.unique(np.concatenate([even, 1 / lines]))


def _columns(candidate: Candidate, commands: tuple[str, ...]) -> list[int]:
    """Indices of the actuators that a candidate acts on."""
    return [commands.index(name) for name in candidate.target or commands]


def _requested(plant: Plant, on: Grid, start: Array) -> Array:
    """Set points that the commands ask for, (ntrials, T - 1, nactuators)."""
    if plant.wiring.interface == "position":
        return on.commands.copy()
    out, set_point = np.empty(on.commands.shape), start
    for k in range(on.commands.shape[1]):
        set_point = np.clip(set_point + on.commands[:, k] * on.period[:, k, None], *plant.wiring.span.T)
        out[:, k] = set_point
    return out


def _slewed(plant: Plant, on: Grid, start: Array, wanted: Array) -> Array:
    """Set points by row, (ntrials, T, nactuators), rate-limited to the joint's velocity limit."""
    out = np.empty((wanted.shape[0], wanted.shape[1] + 1, wanted.shape[2]))
    out[:, 0] = start
    for k in range(wanted.shape[1]):
        most = plant.wiring.targets.velocity * on.period[:, k, None]
        out[:, k + 1] = out[:, k] + np.clip(np.clip(wanted[:, k], *plant.wiring.span.T) - out[:, k], -most, most)
    return out


def _squares(motion: ServoMotion, trial: int, off: Array) -> Iterator[Array]:
    """Weighted squares of a trial's residual after each command, (nvalues, nactuators), where the set points are off by
    so much at each magnitude, (nvalues, T - 1, nactuators)."""
    ahead = np.zeros((len(off), off.shape[2]))
    for k in range(off.shape[1]):
        ahead = ahead + motion.share * (off[:, k] - ahead)
        residual = (motion.position_residual[trial, k + 1] - ahead) / motion.deviation[trial, k + 1]
        yield np.minimum(residual**2, MAX_SQUARED_RESIDUAL)


def passed(plant: Plant, on: Grid, motion: ServoMotion, wide: Candidate, values: Array, trial: int) -> Array:
    """Executed set points of a trial at each magnitude of an effect, (nvalues, T - 1, nactuators)."""
    chain = only_commands(plant, [(wide.entry(float(v)),) for v in values])
    asked = motion.requested[trial]
    chain.now.set_point = np.broadcast_to(motion.start[trial], (len(values), asked.shape[1])).copy()
    for effect in chain.effects:
        effect.start(chain.now)
    out = np.empty((len(values), *asked.shape))
    for k, target in enumerate(asked):
        chain.now.dt = np.full(len(values), on.period[trial, k])
        out[:, k] = chain.set_point(np.broadcast_to(target, out[:, k].shape))
    return out


def has_driver(candidate: Candidate) -> bool:
    """Whether a candidate has a driver's period; a period over position has the same name."""
    return EFFECTS[candidate.effect].stage == "command" and PERIOD in dict(candidate.fixed)


def minima(cost: Array) -> list[int]:
    """Indices of the lowest local minima of a curve, lowest first, at most :data:`MAX_SIMULATED`."""
    inner = np.nonzero((cost[1:-1] <= cost[:-2]) & (cost[1:-1] <= cost[2:]))[0] + 1
    return sorted(inner.tolist(), key=lambda k: float(cost[k]))[:MAX_SIMULATED]
