"""Replay the recorded commands through the simulator: what it predicts for every row, with and without effects.

Every simulation is one trial with one set of effects; hundreds run at once in a ``mujoco.batch.Batch``. The true
signals of a run are kept, so that effects of the sensors are applied to them without another run.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.effects.chain import EACH_STEP, EACH_SUBSTEP, Chain
from tiago_mj.effects.declare import only_measures, overrides
from tiago_mj.effects.host import BatchHost
from tiago_mj.effects.runner import LoadCells, Log, Runner
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.simulation.initial_state import set_initial
from tiago_mj.gap.simulation.plant import Plant
from tiago_mj.io.deadline import Deadline
from tiago_mj.models import scene
from tiago_mj.recordings.recording import Trial

Array = NDArray[np.float64]
Effects = tuple[Entry, ...]

#: Simulations in one batch: enough to fill any number of threads, few enough to stay within memory.
BATCH_SIZE = 256
#: A sensor with a memory takes its signal in steps of at most this [s], a plain model's physics step. Its input is
#: straight in between: at 25 Hz, row by row, filters and delays were off by up to twenty deviations of a joint's noise;
#: at 240 Hz, row by row, a clock 34.8 ms late was one 33.6 ms late and commands 1.2 ms late (hinges_5002.json, 55).
MAX_PART: Final = 2.1e-3


@dataclass(frozen=True)
class Grid:
    """Commands and times of trials, padded to one length.

    Attributes:
        trials: their order.
        rows: number of rows of each, (ntrials,).
        period: length of every row, (ntrials, T - 1) [s].
        uniform: whether all rows have the plant's nominal period.
        delivered: 1 for a command that reaches its servo, 0 for a lost one, (ntrials, T - 1, nactuators); None: drawn.
        commands: held where a row has none, (ntrials, T - 1, nactuators); of a plant whose commands are relative NaN
            where a row has none.
    """

    trials: tuple[Trial, ...]
    rows: NDArray[np.int_]
    period: Array
    uniform: bool
    commands: Array
    delivered: Array | None = None


@dataclass(frozen=True)
class Signals:
    """What was simulated, row by row or in parts of rows, (nsim, T, ...); NaN from where a simulation diverged.

    Attributes:
        position, velocity, effort: of the joints, measured, (nsim, T, njoints).
        reading: of the load cells, free of noise, (nsim, T, nsensors).
        newtons: on the pads, true, (nsim, T, nsensors).
    """

    position: Array
    velocity: Array
    effort: Array
    reading: Array
    newtons: Array

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Simulations that did not reach their end, (nsim,)."""
        return np.asarray(~np.isfinite(self.velocity[:, -1]).all(axis=-1))

    def thinned(self, parts: int) -> Signals:
        """Each so many-th sample: the rows, of what was simulated in parts of them."""
        return Signals(*(getattr(self, f)[:, ::parts] for f in Signals.__dataclass_fields__))

    def until(self, rows: NDArray[np.int_]) -> Signals:
        """With NaN from a sample on, (nsim,) of them."""
        length = self.position.shape[1]
        if (rows >= length).all():
            return self
        gone = np.arange(length) >= rows[:, None]
        return Signals(*(np.where(gone[..., None], np.nan, getattr(self, f)) for f in Signals.__dataclass_fields__))


@dataclass(frozen=True)
class Run:
    """How simulations are run.

    Attributes:
        threads: of the batch; 0 is all processors. The result does not depend on it.
        seed: of what effects draw at random: the same for every simulation of a trial.
        deadline: asked from row to row.
        parts: samples of each row's period, equally long; 1: the rows.
    """

    threads: int = 0
    seed: int = 0
    deadline: Deadline = field(default_factory=Deadline)
    parts: int = 1


#: By all processors, at the rows, without a deadline.
PLAIN: Final = Run()


def physics_steps(plant: Plant, on: Grid) -> int:
    """Physics steps of one simulation of a trial."""
    return on.commands.shape[1] * math.ceil(plant.period / plant.max_timestep)


def grid(plant: Plant, trials: Sequence[Trial]) -> Grid:
    """Commands and times on rows."""
    rows = np.array([len(trial.time) for trial in trials])
    length = max(int(rows.max()) - 1, 1)
    period = np.full((len(trials), length), plant.period)
    commands = np.zeros((len(trials), length, len(plant.actuators)))
    uniform = True
    for k, trial in enumerate(trials):
        count = rows[k] - 1
        steps = np.diff(trial.time)
        if np.abs(steps - plant.period).max(initial=0.0) > 1e-6:
            uniform = False
            period[k, :count] = steps
        for a, name in enumerate(plant.actuators):
            sent = trial.commands.get(name)
            idle = plant.starts[trial.name].set_point[a] if plant.wiring.interface == "position" else 0.0
            if plant.relative:
                commands[k, :count, a] = np.nan if sent is None else sent[:count]
                continue
            commands[k, :count, a] = _held(sent[:count], idle) if sent is not None else idle
            commands[k, count:, a] = commands[k, count - 1, a] if count else idle
    return Grid(tuple(trials), rows, period, uniform, commands)


def parts_of(plant: Plant) -> int:
    """Into how many parts sensors with a memory need a row cut: the fewest of whole physics steps that last no longer
    than :data:`MAX_PART`; 1 where a row lasts no longer."""
    steps = plant.substeps
    fitting = (n for n in range(1, steps) if steps % n == 0 and plant.period / n <= MAX_PART * (1 + 1e-6))
    return next(fitting, steps)


def simulate(plant: Plant, on: Grid, sims: Sequence[tuple[int, Effects]], how: Run = PLAIN) -> Signals:
    """Run simulations.

    Args:
        plant: the nominal simulator; its given effects are part of every simulation.
        on: commands and times.
        sims: (trial index, effects) of each.
        how: they are run. There are (T - 1) * parts + 1 samples; of more than one part they are for :func:`measure`, as
            the effects here are none of the sensors'.

    Raises:
        OutOfTimeError: the deadline is over.
        ValueError: a part is of no whole physics steps, or a sensor's effect is among the effects of parts.
    """
    sims = [(trial, (*plant.given, *effects)) for trial, effects in sims]
    if plant.substeps % how.parts:
        raise ValueError(f"{plant.substeps} physics steps of a row in {how.parts} parts: give a divisor")
    if how.parts > 1 and any(sensor_only(entry) for _, effects in sims for entry in effects):
        raise ValueError("effects of the sensors in parts of rows: simulate without them, then measure")
    runs = [_in_batches(plant, on, sims[k : k + BATCH_SIZE], how) for k in range(0, len(sims), BATCH_SIZE)]
    return Signals(*(np.concatenate([getattr(r, f) for r in runs]) for f in Signals.__dataclass_fields__))


def motions(plant: Plant, on: Grid, sims: Sequence[tuple[int, Effects]], how: Run = PLAIN) -> tuple[Signals, Array]:
    """The same with all of MuJoCo's positions in every row, (nsim, T, nq) [m, rad]: where the bodies are.

    Args:
        plant, on, sims, how: as for :func:`simulate`, at the rows; few simulations, as all of it is kept.
    """
    whole = [(trial, (*plant.given, *effects)) for trial, effects in sims]
    poses = np.full((len(sims), on.commands.shape[1] + 1, plant.model.nq), np.nan)
    # Each alone: a batch runs as its slowest simulation has to.
    runs = [_batch(plant, on, [sim], how, poses[k : k + 1]) for k, sim in enumerate(whole)]
    return Signals(*(np.concatenate([getattr(r, f) for r in runs]) for f in Signals.__dataclass_fields__)), poses


def _in_batches(plant: Plant, on: Grid, sims: Sequence[tuple[int, Effects]], how: Run) -> Signals:
    """Simulations that need nobody between their steps apart from the others: they share all processors better."""
    alone = np.array([all(_acts_without_feedback(entry) for entry in effects) for _, effects in sims])
    if alone.all() or not alone.any():
        return _batch(plant, on, sims, how)
    order = np.argsort(~alone, kind="stable")
    count = int(alone.sum())
    runs = [_batch(plant, on, [sims[k] for k in some], how) for some in (order[:count], order[count:])]
    back = np.argsort(order)
    return Signals(*(np.concatenate([getattr(r, f) for r in runs])[back] for f in Signals.__dataclass_fields__))


def _acts_without_feedback(entry: Entry) -> bool:
    """Whether an effect changes the model alone, or a signal without asking what the joints do."""
    hooks = (*EACH_SUBSTEP, *EACH_STEP)
    declared = EFFECTS[entry.name]
    asked = (declared.by_detail.get(hook) for hook in hooks if overrides(declared, hook))
    return declared.signal_only or all(key is not None and not entry.parameters.get(key) for key in asked)


def measure(
    plant: Plant, on: Grid, true: Signals, sims: Sequence[tuple[int, Effects]], *, seed: int = 0, parts: int = 1
) -> Signals:
    """Apply the sensors' effects to true signals, one row of ``true`` a simulation; the physics is not run again.

    What is returned is of the rows: the load cells are sampled there, as a logger reads them; what filters and delays
    do in between follows the parts.

    Args:
        plant, on, sims, seed: as for :func:`simulate`; effects that are not the sensors' are ignored.
        true: signals of runs without sensor effects, (nsim, ...), row by row those of ``sims``: of
            :func:`unmeasured` where sensors' effects are given.
        parts: of each row's period in ``true``, as :func:`simulate` made them.
    """
    sensing = [[e for e in (*plant.given, *entries) if sensor_only(e)] for _, entries in sims]
    chain = Chain.unsimulated(plant.model, plant.wiring, sensing, _uniform(sims, None, seed))
    chain.now.dt = np.full(len(sims), plant.period / parts)
    chain.begin()
    rows = true.thinned(parts)
    position, velocity, reading = (np.empty_like(of) for of in (rows.position, rows.velocity, rows.reading))
    trial = np.array([t for t, _ in sims])
    quiet = np.zeros((len(sims), true.reading.shape[2]))
    for k in range(true.position.shape[1]):
        row, inside = divmod(k, parts)
        chain.now.step = row
        if k:
            if not on.uniform:
                chain.now.dt = on.period[trial, (k - 1) // parts] / parts
            chain.now.elapsed = chain.now.elapsed + chain.now.dt
        here, speed = chain.position(true.position[:, k]), chain.velocity(true.velocity[:, k])
        if inside:
            if plant.cell is not None:
                chain.before_sampling(true.newtons[:, k], plant.cell.signal)
            continue
        position[:, row], velocity[:, row] = here, speed
        if plant.cell is not None:
            reading[:, row] = chain.reading(true.newtons[:, k], plant.cell.signal, quiet)
    return Signals(position, velocity, rows.effort, _averaged(plant, reading), rows.newtons)


def only_commands(plant: Plant, sims: Sequence[Effects]) -> Chain:
    """The chain of effects on commands, without a simulation: for what it makes of them before a servo moves. What is
    given beside them, such as friction, has no part in that."""
    given = [entry for entry in plant.given if EFFECTS[entry.name].stage in ("timing", "command")]
    sims = [(*given, *effects) for effects in sims]
    return Chain.unsimulated(plant.model, plant.wiring, sims, _uniform([(0, effects) for effects in sims], None, 0))


def unmeasured(plant: Plant) -> Plant:
    """The plant without the given effects that act on readings alone: its signals are what :func:`measure` takes."""
    return replace(plant, given=tuple(entry for entry in plant.given if not sensor_only(entry)))


def sensor_only(entry: Entry) -> bool:
    """Whether an effect acts on readings alone, so that the motion is the nominal one."""
    return only_measures(EFFECTS[entry.name])


def remembers(entry: Entry) -> bool:
    """Whether a sensor's effect depends on what was before its sample: it has something to begin with."""
    return sensor_only(entry) and overrides(EFFECTS[entry.name], "start")


def _batch(
    plant: Plant, on: Grid, sims: Sequence[tuple[int, Effects]], how: Run, poses: Array | None = None
) -> Signals:
    """Simulations in one batch; ``poses``, (nsim, T, nq), is filled where it is given."""
    trial = np.array([t for t, _ in sims])
    host = BatchHost(mujoco.batch.Batch(plant.model, len(sims), how.threads))
    starts = [plant.starts[on.trials[t].name] for t in trial]
    set_points = np.array([start.set_point for start in starts])
    set_initial(plant, host, starts, set_points)
    runner = Runner(host, plant.wiring, [entries for _, entries in sims], _uniform(sims, on.delivered, how.seed))
    qpos = host.state("qpos")
    qpos[:, plant.wiring.qpos] = runner.chain.true_position(qpos[:, plant.wiring.qpos])
    item = starts[0].item
    contact = None if item is None else (item.stiffness, item.damping, scene.CONTACT_POINTS[item.shape])
    if not on.uniform or plant.substeps * plant.model.opt.timestep != plant.period:
        host.set_timestep(np.full(len(sims), plant.period / plant.substeps))
    runner.start(plant.period, plant.substeps, contact, set_points)
    runner.seen()  # a batch fills what is asked for at its next call
    host.forward()
    log = Log(runner, _cells(plant, host), on.commands.shape[1] * how.parts + 1, poses=poses is not None)
    runner.run(
        on.commands[trial],
        log,
        seconds=None if on.uniform else on.period[trial],
        parts=how.parts,
        relative_to=set_points if plant.relative else None,
        check=how.deadline.check,
    )
    if poses is not None:
        poses[:] = log.poses
    at = log.readings
    return Signals(at.position, at.velocity, at.effort, _averaged(plant, at.reading, how.parts), at.newtons).until(
        log.ends
    )


def _cells(plant: Plant, host: BatchHost) -> LoadCells:
    """The plant's load cells, which read nothing at the start."""
    pads, cell = plant.pads, plant.cell
    if pads is None or cell is None:
        return LoadCells(lambda sensordata: np.zeros((*sensordata.shape[:-1], len(plant.sensors))))
    tare = np.asarray(pads.tare(host.output("sensordata")))

    def newtons(sensordata: Array) -> Array:
        return pads.read(sensordata, tare if sensordata.ndim == 2 else tare[..., None, :])

    return LoadCells(newtons, cell.signal)


def _averaged(plant: Plant, reading: Array, parts: int = 1) -> Array:
    """The driver's moving average over the last samples, of those that there are at the start: a row apart, also of
    what it would read between rows."""
    if plant.cell is None or plant.cell.average == 1:
        return reading
    if parts > 1:
        out = np.empty_like(reading)
        for part in range(parts):
            out[:, part::parts] = _averaged(plant, reading[:, part::parts])
        return out
    total = np.cumsum(reading, axis=1)
    count = plant.cell.average
    total[:, count:] -= np.cumsum(reading, axis=1)[:, :-count]
    return total / np.minimum(np.arange(1, reading.shape[1] + 1), count)[None, :, None]


def _held(values: Array, idle: float) -> Array:
    """A command stays in force until the next; before the first it is idle."""
    known = np.isfinite(values)
    if known.all():
        return values
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], idle)


def _uniform(
    sims: Sequence[tuple[int, Effects]], known_draws: Array | None, seed: int
) -> Callable[[tuple[int, ...]], Array]:
    """Uniform numbers that are the same for every simulation of a trial, whatever batch it runs in; once a control step
    those of ``known_draws``, where they are known."""
    trial = np.array([t for t, _ in sims])
    generators = {int(t): np.random.default_rng([seed, int(t)]) for t in np.unique(trial)}
    steps = itertools.count()

    def draw(shape: tuple[int, ...]) -> Array:
        if known_draws is not None:
            known: Array = known_draws[trial, next(steps)]
            return known
        drawn = {t: generator.random(shape[1:]) for t, generator in generators.items()}
        return np.stack([drawn[int(t)] for t in trial])

    return draw
