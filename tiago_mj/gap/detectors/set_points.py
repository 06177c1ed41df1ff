"""Set points that the servos really had, estimated from their motion.

The likelihood has no useful gradient for a grid or a dead band of the set point. A servo follows its set point with a
lag, so its departure from the predicted motion shows by how much the set point differed. The magnitudes that explain
this best become starts of ordinary fits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tiago_mj.deadline import Deadline
from tiago_mj.effects import EFFECTS
from tiago_mj.effects.declare import overrides
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.gap.simulation.replay import Grid, Signals, only_commands

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
#: How often a driver may look at its set point, where that is a number of the effect [s], each beside so many
#: magnitudes; then from half as often to twice as often, in so many steps. On dead bands of 0.2 and 0.9 mm that were
#: looked at every 5 ms it finds 0.29 and 0.88 mm (benchmarks/truth_audit.py, gripper/command_deadband).
DRIVER_PERIODS: Final = (0.001, 0.002, 0.004, 0.008, 0.016, 0.032)
DRIVER_WIDTHS: Final = 60
DRIVER_RANGE: Final = 2.0
DRIVER_STEPS: Final = 13
#: Longest steps at which a driver is followed, first and then [s], and trials in which it is: those that move most.
DRIVER_STEP: Final = (2e-3, 1e-3)
DRIVER_TRIALS: Final = 3
#: Share of the way that a servo is behind by which its position is known worse: what nominal gains are known to.
LAG_SHARE: Final = 0.1
#: Squared residuals are clipped at this, in units of their variance, since other causes may act there. Chosen by hand;
#: no ablation.
MAX_SQUARED_RESIDUAL: Final = 25.0


@dataclass(frozen=True)
class ServoMotion:
    """Measured motion of the servos as evidence on their set points.

    A servo follows its set point with a lag: between two rows it covers ``share`` of the way that is left.

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
    """Compare the motion with the nominal one; None for a plant without position servos.

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
        deviation[:, :, a] = np.where(known, np.hypot(data.noise[column], LAG_SHARE * lead[:, :, a]), np.inf)
    return ServoMotion(start, wanted, ahead, deviation, share)


def shares(plant: Plant, motion: ServoMotion | None) -> Array:
    """Share of the way to where a force pushes it that each joint covers in a row, (njoints,): all, where no servo says
    otherwise."""
    out = np.ones(len(plant.joints))
    if motion is not None:
        out[list(plant.wiring.targets.actuated)] = motion.share
    return out


def untouched(data: Data, nominal: Signals, rows: int) -> NDArray[np.bool_]:
    """Rows in which nothing is touched, (ntrials, T)."""
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
    """The pool, in which effects on set points have the magnitudes on their grids that explain what was seen best.

    Args:
        plant, on, motion: as of :func:`servo_motion`.
        pool: candidates.
        trials: that are looked at.
        deadline: asked before each of them; None: there is none.

    Raises:
        OutOfTimeError: the deadline is over.
    """
    by = deadline or Deadline()
    commands = plant.wiring.targets.command
    out = list(pool)
    for name in dict.fromkeys(c.effect for c in pool):
        declared = EFFECTS[name]
        mine = [k for k, c in enumerate(pool) if c.effect == name and not dict(c.fixed).get(PERIOD)]
        wide = pool[mine[0]] if mine else next(c for c in pool if c.effect == name)
        if declared.stage != "command" or not overrides(declared, "set_point") or not np.isfinite(wide.identity):
            continue  # a limit is reached smoothly
        values = dense(wide, float(np.nanmax(np.abs(motion.requested))))
        cost = _costs(plant, on, motion, wide, values, trials, by)
        columns = [_columns(pool[k], commands) for k in mine]
        near = sorted({b for column in columns for b in minima(cost[:, column].sum(axis=1))})
        around = [
            np.linspace(values[max(b - 1, 0)], values[min(b + 1, len(values) - 1)], MAGNITUDES_AROUND_BEST)
            for b in near
        ]
        fine = np.unique(np.concatenate(around or [values[:1]]))
        cost = _costs(plant, on, motion, wide, fine, trials, by)
        for k, column in zip(mine, columns, strict=True):
            total = cost[:, column].sum(axis=1)
            best = fine[minima(total)]
            if len(best):
                like = fine[total <= total.min() + 1.0]
                spread = max(float(np.ptp(like)) / 2, 1e-4 * float(best[0]))
                out[k] = replace(pool[k], grid=tuple(sorted({*pool[k].grid, *best.tolist()})), spread=spread)
    for name in dict.fromkeys(c.effect for c in pool):
        if EFFECTS[name].stage == "command" and PERIOD in EFFECTS[name].parameters:
            out = _with_driver(plant, on, motion, out, name, trials)
    return tuple(out)


def _with_driver(
    plant: Plant, on: Grid, motion: ServoMotion, pool: Sequence[Candidate], name: str, trials: Sequence[int]
) -> list[Candidate]:
    """The pool, in which an effect that acts whenever a driver looks at the set point is left with one period for each
    choice of targets: the one that explains best what was seen, with the magnitude that does."""
    mine = [k for k, c in enumerate(pool) if c.effect == name and dict(c.fixed).get(PERIOD)]
    first = {pool[k].target: k for k in reversed(mine)}
    if len(first) == len(mine):  # nothing to choose
        return list(pool)
    columns = {target: _columns(pool[k], plant.wiring.targets.command) for target, k in first.items()}
    lively = sorted(trials, key=lambda t: -float(np.nansum(np.abs(np.diff(motion.requested[t], axis=0)))))
    some, wide = sorted(lively[:DRIVER_TRIALS]), pool[mine[0]]
    even = np.geomspace(0.01, 1.0, DRIVER_WIDTHS) * (wide.high - wide.identity) + wide.identity
    pairs = np.array([(width, period) for width in even for period in DRIVER_PERIODS])
    cost = _driver_costs(plant, on, motion, wide, pairs, some, DRIVER_STEP[0])
    best = {target: pairs[int(np.argmin(cost[:, column].sum(axis=1)))] for target, column in columns.items()}
    factors = np.geomspace(1 / DRIVER_RANGE, DRIVER_RANGE, DRIVER_STEPS)
    widths = np.geomspace(even[0] / even[1], even[1] / even[0], DRIVER_STEPS)
    around = {t: np.array([(w * a, p * b) for a in widths for b in factors]) for t, (w, p) in best.items()}
    near = _driver_costs(plant, on, motion, wide, np.concatenate(list(around.values())), some, DRIVER_STEP[1])
    out = dict(enumerate(pool))
    for target, each in zip(around, np.split(near, len(around)), strict=True):
        total = each[:, columns[target]].sum(axis=1)
        width, period = around[target][int(np.argmin(total))]
        like = around[target][total <= total.min() + 1.0, 0]
        one = pool[first[target]]
        out[first[target]] = replace(
            one,
            fixed=tuple((key, float(f"{period:.3g}") if key == PERIOD else v) for key, v in one.fixed),
            grid=tuple(sorted({*one.grid, float(min(width, one.high))})),
            spread=max(float(np.ptp(like)) / 2, 1e-4 * float(width)),
        )
    return [out[k] for k in sorted(out) if k not in mine or k in first.values()]


def _driver_costs(
    plant: Plant,
    on: Grid,
    motion: ServoMotion,
    wide: Candidate,
    pairs: Array,
    trials: Sequence[int],
    longest: float,
) -> Array:
    """Misfit of pairs of a magnitude and a driver's period, (npairs, 2) to (npairs, nactuators); the servo follows what
    the driver passes on in steps of at most ``longest`` [s]."""
    total = np.zeros((len(pairs), motion.requested.shape[2]))
    entries = [(Entry(wide.effect, None, {wide.parameter: float(w), PERIOD: float(p)}),) for w, p in pairs]
    parts = max(math.ceil(plant.period / longest - 1e-6), 1)
    share = 1 - (1 - np.minimum(motion.share, 1 - 1e-9)) ** (1 / parts)
    path = _slewed(plant, on, motion.start, motion.requested)
    for t in trials:
        chain = only_commands(plant, entries)
        now = chain.now
        now.set_point, now.substeps = np.broadcast_to(motion.start[t], total.shape).copy(), parts
        now.dt = np.full(len(pairs), plant.period)
        now.takes_set_points = plant.wiring.servo & (plant.wiring.act < 0)
        effect = next(each for each in chain.effects if each.name == wide.effect)  # beside those that are given
        effect.start(now)
        passed, ahead = now.set_point.copy(), np.zeros(total.shape)
        for k in range(motion.requested.shape[1]):
            now.dt = np.full(len(pairs), on.period[t, k])
            step = on.period[t, k] / parts
            speed = (path[t, k + 1] - path[t, k]) / on.period[t, k]
            asked = np.where(now.takes_set_points, path[t, k + 1], speed)
            jumps = effect.given(np.broadcast_to(asked, (len(pairs), parts, total.shape[1])), now)
            for j in range(parts):
                passed = np.where(now.takes_set_points, jumps[:, j], passed + jumps[:, j] * step)
                nominal = np.where(now.takes_set_points, path[t, k + 1], path[t, k] + (j + 1) * step * speed)
                ahead = ahead + share * (passed - nominal - ahead)
            total += np.minimum(
                ((motion.position_residual[t, k + 1] - ahead) / motion.deviation[t, k + 1]) ** 2, MAX_SQUARED_RESIDUAL
            )
    return total


def dense(wide: Candidate, farthest: float) -> Array:
    """Magnitudes to look at, rising; set points are as far as that from the joint's zero [m, rad]."""
    even = wide.identity + np.geomspace(0.01, 1.0, DENSE_MAGNITUDES) * (wide.high - wide.identity)
    if wide.parameter != "step":
        return even
    lines = np.arange(1 / even[-1], 1 / even[0], GRID_SHIFT / max(farthest, even[-1]))[:MAX_GRIDS]
    return np.unique(np.concatenate([even, 1 / lines]))


def _columns(candidate: Candidate, commands: tuple[str, ...]) -> list[int]:
    """Actuators that a candidate acts on."""
    return [commands.index(name) for name in candidate.target or commands]


def _requested(plant: Plant, on: Grid, start: Array) -> Array:
    """Set points that the commands ask for, (ntrials, T - 1, nactuators)."""
    if plant.wiring.interface == "position":
        return on.commands.copy()
    out, at = np.empty(on.commands.shape), start
    for k in range(on.commands.shape[1]):
        at = np.clip(at + on.commands[:, k] * on.period[:, k, None], *plant.wiring.span.T)
        out[:, k] = at
    return out


def _slewed(plant: Plant, on: Grid, start: Array, wanted: Array) -> Array:
    """Set points by row, (ntrials, T, nactuators): they move no faster than the joint's limit."""
    out = np.empty((wanted.shape[0], wanted.shape[1] + 1, wanted.shape[2]))
    out[:, 0] = start
    for k in range(wanted.shape[1]):
        most = plant.wiring.targets.velocity * on.period[:, k, None]
        out[:, k + 1] = out[:, k] + np.clip(np.clip(wanted[:, k], *plant.wiring.span.T) - out[:, k], -most, most)
    return out


def _costs(
    plant: Plant,
    on: Grid,
    motion: ServoMotion,
    wide: Candidate,
    values: Array,
    trials: Sequence[int],
    deadline: Deadline,
) -> Array:
    """Misfit of each magnitude, (nvalues, nactuators)."""
    total = np.zeros((len(values), motion.requested.shape[2]))
    for t in trials:
        deadline.check()
        off = passed(plant, on, motion, wide, values, t) - motion.requested[t]
        ahead = np.zeros(total.shape)
        for k in range(motion.requested.shape[1]):
            ahead = ahead + motion.share * (off[:, k] - ahead)
            total += np.minimum(
                ((motion.position_residual[t, k + 1] - ahead) / motion.deviation[t, k + 1]) ** 2, MAX_SQUARED_RESIDUAL
            )
    return total


def passed(plant: Plant, on: Grid, motion: ServoMotion, wide: Candidate, values: Array, trial: int) -> Array:
    """What magnitudes of an effect make of the set points of a trial, (nvalues, T - 1, nactuators)."""
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


def minima(cost: Array) -> list[int]:
    """The lowest points of a curve, each lower than both neighbours."""
    inner = np.nonzero((cost[1:-1] <= cost[:-2]) & (cost[1:-1] <= cost[2:]))[0] + 1
    return sorted(inner.tolist(), key=lambda k: float(cost[k]))[:MAX_SIMULATED]
