"""The runner: one or many simulations, commanded and read through the effects that each of them has.

Environments, vectors of them, replays, recordings of plain models and the stepper of a repaired one all step their
simulations here, so that an effect is the same in each to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects.chain import Chain
from tiago_mj.effects.host import BatchHost, ScalarHost, Watched, span
from tiago_mj.effects.nominal import check_entries
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.servo_inputs import ServoInputs
from tiago_mj.effects.spec import Entry
from tiago_mj.effects.step_forces import StepForces

Array = NDArray[np.float64]

#: Physics steps that an open loop runs at once: few enough to stay within memory.
MAX_ROLLOUT_STEPS: Final = 512


@dataclass(frozen=True)
class LoadCells:
    """How forces are read.

    Attributes:
        newtons: of ``sensordata``, (..., nsensordata), the force on each pad or touch sensor, (..., nsensors) [N].
        signal: of newtons what a cell gives, (..., nsensors) [sensor units].
    """

    newtons: Callable[[Array], Array]
    signal: Callable[[Array], Array] = lambda newtons: newtons


class Readings(NamedTuple):
    """What is measured at one time or at many, (nsim, ..., n).

    Attributes:
        position, velocity: of the joints, measured [m, rad], per second.
        effort: actuator forces on the joints [N, N·m].
        newtons: on the load cells, true.
        reading: of the load cells, free of noise [sensor units].
    """

    position: Array
    velocity: Array
    effort: Array
    newtons: Array
    reading: Array


class Log:
    """Readings of a run, sample by sample.

    Args:
        runner: what is run.
        cells: how forces are read.
        samples: T, how many.
        poses: whether all of MuJoCo's positions are kept, too.

    Attributes:
        readings: (nsim, T, n) each; of no meaning from where a simulation diverged.
        poses: (nsim, T, nq) [m, rad], NaN where nothing was simulated; None: not kept.
        ends: number of samples until a simulation diverged, or T, (nsim,).
    """

    def __init__(self, runner: Runner, cells: LoadCells, samples: int, *, poses: bool = False) -> None:
        self._runner, self._cells = runner, cells
        nsim, joints = runner.host.nsim, len(runner.wiring.dof)
        sizes = (joints, joints, joints, *(len(runner.wiring.targets.sensor) for _ in range(2)))
        self.readings = Readings(*(np.zeros((nsim, samples, size)) for size in sizes))
        self.poses = np.full((nsim, samples, runner.host.model.nq), np.nan) if poses else None
        self.ends = np.full(nsim, samples)

    def note(self, k: int | slice, seen: Sequence[Array]) -> None:
        """Read what :data:`SEEN` has of one sample, (nsim, ...), or of a range of them, (nsim, nsamples, ...)."""
        if self.poses is not None:
            self.poses[:, k] = seen[0]
        for kept, one in zip(self.readings, self._runner.measured(self._cells, seen), strict=True):
            kept[:, k] = one

    def note_ends(self, sample: int) -> None:
        """Whoever has diverged by now was simulated up to this sample, which is no more of the motion."""
        self.ends[:] = np.where(self._runner.host.diverged, np.minimum(self.ends, sample), self.ends)


#: What a sample is read of.
SEEN: Final = ("qpos", "qvel", "qfrc_actuator", "sensordata")


class Runner:
    """Simulations under effects.

    An episode: :meth:`restore` before the nominal model is changed; set the initial state; :meth:`start`; compute what
    follows from the state (``host.forward()``); then a command for each control period, by :meth:`advance` or, of a
    whole episode, by :meth:`run`.

    Args:
        host: the simulations.
        wiring: their parts.
        sims: entries of every simulation.
        uniform: draws uniform numbers of a shape whose first axis is the simulations.

    Attributes:
        chain: the effects.

    Raises:
        ValueError: an entry names a target that the plant does not have.
    """

    def __init__(
        self,
        host: Watched,
        wiring: Wiring,
        sims: Sequence[Sequence[Entry]],
        uniform: Callable[[tuple[int, ...]], Array],
    ) -> None:
        self.host, self.wiring = host, wiring
        self.chain = Chain(host, wiring, sims, uniform)
        self._inputs = ServoInputs(self.chain, host, wiring)
        self._forces = StepForces(self.chain, host, wiring)
        self._ctrl = span(wiring.ctrl.tolist())
        self._bare = not self.chain.effects  # then nobody asks for steps and time that have passed

    @classmethod
    def of_one(
        cls,
        data: mujoco.MjData,
        wiring: Wiring,
        entries: Sequence[Entry],
        uniform: Callable[[tuple[int, ...]], Array],
    ) -> Runner:
        """One simulation, whose model and data are changed in place.

        Raises:
            ValueError: the effects do not fit the model; one line.
        """
        check_entries(entries, data.model, wiring)
        return cls(ScalarHost(data), wiring, [entries], uniform)

    # An episode -----------------------------------------------------------------------------------------------------

    def restore(self) -> None:
        """Give every changed field of the models its nominal value back."""
        self.chain.restore()

    def start(
        self,
        period: float,
        substeps: int,
        contact: tuple[float, float, int] | None = None,
        held: Array | None = None,
    ) -> None:
        """Apply the effects to the nominal model and the initial state, which must be set, and forget what was.

        Args:
            period: nominal control period [s].
            substeps: physics steps in it.
            contact: stiffness [N/m], damping [N·s/m] and contact points of one pad with the object.
            held: set points of plain position servos before the first command, (nsim, nactuators) [m, rad]; None: where
                the joints are.
        """
        self.chain.change(period, substeps, contact)
        self._forces.start()
        self._inputs.start(held)
        self.chain.begin()

    def set_points(self) -> Array:
        """The servos' set points, (nsim, nactuators) [m, rad]; the joint's first position where there is no servo."""
        return self._inputs.set_points()

    def advance(
        self,
        command: Array,
        seconds: Array | None = None,
        parts: int = 1,
        between: Callable[[int], None] = lambda part: None,
    ) -> None:
        """Let the commands act for one control period.

        Args:
            command: (nsim, nactuators) in the interface's unit.
            seconds: length of this period by the recorder's clock, (nsim,) [s], where it is not the nominal one.
            parts: of the period, of whole physics steps each.
            between: told the number of each part but the last, from 1, once it is simulated.
        """
        now, host = self.chain.now, self.host
        if self.wiring.ideal:
            self._inputs.hold()
        if self._bare and seconds is None and parts == 1:
            host.state("ctrl")[:, self._ctrl] = self._inputs.of(command)
            host.step(now.substeps)
            return
        if seconds is not None:
            now.dt = seconds * now.clock
            host.set_timestep(now.dt / now.substeps)
        self._step(self._inputs.of(command), parts, between)
        now.step += 1
        now.elapsed = now.elapsed + now.dt

    def _step(self, inputs: Array, parts: int, between: Callable[[int], None]) -> None:
        """Physics steps of a control period, with what is held for all of it or what arrives in each."""
        host, substeps = self.host, self.chain.now.substeps
        ctrl, steps = host.state("ctrl"), substeps // parts
        arriving = self._inputs.arriving(inputs)
        if arriving is None:
            ctrl[:, self._ctrl] = inputs
            if not self._forces.any:
                for part in range(1, parts):
                    host.step(steps)
                    between(part)
                host.step(steps)
                return
        for k in range(substeps):
            if k and k % steps == 0:
                between(k // steps)
            if arriving is not None:
                ctrl[:, self._ctrl] = arriving[:, k]
            if self._forces.any:
                self._forces.write()
            host.step(1)

    # Readings -------------------------------------------------------------------------------------------------------

    def seen(self) -> tuple[Array, ...]:
        """What there is to be read now: :data:`SEEN`, (nsim, ...) each."""
        host = self.host
        return host.state("qpos"), host.state("qvel"), host.output("qfrc_actuator"), host.output("sensordata")

    def measured(self, cells: LoadCells, seen: Sequence[Array] | None = None) -> Readings:
        """What the sensors say, free of noise.

        Args:
            cells: how forces are read.
            seen: :data:`SEEN` of one sample, (nsim, ...), or, where no effect remembers readings, of many, (nsim,
                nsamples, ...); None: of now.
        """
        qpos, qvel, force, sensordata = self.seen() if seen is None else seen
        position = self.chain.position(qpos[..., self.wiring.qpos])
        velocity = self.chain.velocity(qvel[..., self.wiring.dof])
        newtons = cells.newtons(sensordata)
        reading = self.chain.reading(newtons, cells.signal, np.zeros(newtons.shape)) if newtons.shape[-1] else newtons
        return Readings(position, velocity, force[..., self.wiring.dof], newtons, reading)

    # A whole run ----------------------------------------------------------------------------------------------------

    @property
    def open_loop(self) -> bool:
        """Whether what the servos are given depends on commands alone, so that a run needs no one between its steps."""
        return self._inputs.open_loop

    def run(
        self,
        commands: Array,
        log: Log,
        *,
        seconds: Array | None = None,
        parts: int = 1,
        relative_to: Array | None = None,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Command row by row, and log what is measured at the start and after every part of a row.

        Derived fields must be those of the present state. It ends early where every simulation has diverged.

        Args:
            commands: (nsim, nrows, nactuators) in the interface's unit.
            log: of nrows * parts + 1 samples.
            seconds: length of each row by the recorder's clock, (nsim, nrows) [s]; None: the nominal period.
            parts: of each row, of whole physics steps each.
            relative_to: set points before the first command, (nsim, nactuators), where commands are changes from the
                measured position, NaN where a row has none; None: they are not.
            check: called from row to row, or from stretch to stretch of an open loop; it may raise.
        """
        log.note(0, self.seen())
        if isinstance(self.host, BatchHost) and seconds is None and relative_to is None and self.open_loop:
            self._roll_out(self.host, commands, log, parts, check)
            return
        held, joints = relative_to, self.wiring.qpos[list(self.wiring.targets.actuated)]
        for row in range(commands.shape[1]):
            check()
            sent, begun = commands[:, row], row * parts
            if held is not None:
                # The controller and the servo read one encoder, so that what is wrong with it cancels: the true one.
                sent = held = np.where(np.isnan(sent), held, self.host.state("qpos")[:, joints] + sent)
            self.advance(sent, None if seconds is None else seconds[:, row], parts, self._noting(log, begun))
            log.note_ends(begun + 1)
            log.note(begun + parts, self.seen())
            if (log.ends <= begun + 1).all():
                return

    def _noting(self, log: Log, begun: int) -> Callable[[int], None]:
        return lambda part: log.note(begun + part, self.seen())

    def _roll_out(self, host: BatchHost, commands: Array, log: Log, parts: int, check: Callable[[], None]) -> None:
        """The same in stretches of many physics steps, whose inputs are known beforehand."""
        now, idle, rows = self.chain.now, host.state("ctrl"), commands.shape[1]
        most = max(MAX_ROLLOUT_STEPS // now.substeps, 1)
        for first in range(0, rows, most):
            check()
            count = min(most, rows - first)
            inputs = np.repeat(idle[:, None], count * now.substeps, axis=1)
            inputs[:, :, self._ctrl] = self._inputs.ahead(commands[:, first : first + count])
            rolled = host.rollout(inputs, SEEN)
            log.note_ends(first * parts + 1)
            begun, steps = first * parts, now.substeps // parts
            if self.chain.passes_readings:
                ends_of_parts = [rolled[name][:, steps - 1 :: steps] for name in SEEN]
                log.note(slice(begun + 1, begun + count * parts + 1), ends_of_parts)
                continue
            then = now.elapsed
            for k in range(count * parts):
                now.step = first + k // parts + 1
                now.elapsed = (begun + k + 1) * now.dt / parts
                log.note(begun + k + 1, [rolled[name][:, (k + 1) * steps - 1] for name in SEEN])
            now.step, now.elapsed = first + count, then
