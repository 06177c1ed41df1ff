"""The simulations behind a vector environment: started, driven and read by the scalar environment's own functions."""

from __future__ import annotations

import math
from typing import Any, Final

import mujoco
import mujoco.batch
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from tiago_mj.envs.robot_env import RobotEnv
from tiago_mj.envs.start import contact_of
from tiago_mj.envs.state import State
from tiago_mj.envs.stepped import UNSTABLE
from tiago_mj.models.objects import GraspObject
from tiago_mj.sensing.load_cell import MovingAverage
from tiago_mj.sensing.noise import NOISE_BLOCK, NoiseBlocks
from tiago_mj.vector.batch import CopiedBatch
from tiago_mj.vector.cohorts import Cohorts, DrawEffects
from tiago_mj.vector.models import Models

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]

#: Fields of the batch that are read and written in every step.
BOUND: Final = ("qpos", "qvel", "act", "ctrl", "sensordata")


class Simulations:
    """Many simulations of one scalar environment.

    Args:
        core: the scalar environment: it holds the model, the task and what is drawn, and is not stepped.
        count: how many.
        threads: to step them on. The result does not depend on it.
        draw_effects: of a simulation's generator the effects of its next episode, beside those of the environment.

    Attributes:
        state: what was measured last, each (nsim, ...).
        goal: of each, (nsim, g).
        generators: one each: what a simulation draws does not depend on the others.
    """

    def __init__(self, core: RobotEnv, count: int, threads: int, draw_effects: DrawEffects | None = None) -> None:
        self._core = core
        self._changed = bool(core.effects) or draw_effects is not None
        core.make_nominal()  # the batch is made of its model
        self.batch = CopiedBatch(core.model, count, threads)
        self._bind()
        self.generators: list[np.random.Generator] = [seeding.np_random()[0] for _ in range(count)]
        self.models = Models(self.batch, core.model, core.item)
        self._cohorts = Cohorts(self.batch, core.wiring(), core.effects, self.generators, draw_effects)
        self._noise = NoiseBlocks(count, core.load_cell.noises)
        self._average = MovingAverage(core.load_cell.average, count)
        self._tare = np.zeros((count, 2))
        self._every = np.arange(count)
        self.goal = np.zeros((count, len(core.bounds()[1])))
        blank = [np.zeros(shape) for shape in _shapes(core.state, count)]
        self.state = State(*blank)

    def _bind(self) -> None:
        for name in BOUND:
            setattr(self, f"_{name}", self.batch.bind(name))

    def __getstate__(self) -> dict[str, Any]:
        """Without the views of the batch's memory, which a copy makes of its own batch."""
        views = {f"_{name}" for name in BOUND}
        return {name: value for name, value in vars(self).items() if name not in views}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._bind()

    _qpos: Array
    _qvel: Array
    _act: Array
    _ctrl: Array
    _sensordata: Array

    @staticmethod
    def memory(core: RobotEnv) -> int:
        """About what one simulation takes [B]: state, what is read, noise, and model values of its own."""
        model = core.model
        numbers = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION) + 4 * model.nsensordata
        own_model = 0
        if core.effects or (core.object_choice is not None and not core.object_choice.fixed):
            own_model = 8 * (40 * model.ngeom + 40 * model.nbody + 30 * model.nv)
        return int(8 * (numbers + 2 * NOISE_BLOCK + 200) + own_model)

    # Start ----------------------------------------------------------------------------------------------------------

    def restart(self, rows: Rows) -> None:
        """Begin another episode of some simulations; nothing of the one before remains."""
        core = self._core
        items: list[GraspObject | None] = []
        self._cohorts.leave(rows)
        self.batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE)
        for row in rows.tolist():
            start = core.draw_start(self.generators[row])
            items.append(None if start is None else start.item)
            self._qpos[row] = core.start_qpos(items[-1], None if start is None else start.place)
        self._act[rows] = core.start_act(self._qpos[rows])
        self.models.give(rows, items, restore=self._changed)
        self._cohorts.start(rows, core.dt, core.n_substeps, [contact_of(item) for item in items])
        if self._changed:
            self.models.note_expanded()
        self.batch.forward(rows)
        self._average.reset(rows)
        self._noise.forget(rows)
        self._tare[rows] = core.sensors.tare(self._sensordata[rows])
        self._read(rows)
        for row in rows.tolist():
            self.goal[row] = core.draw_goal(self.generators[row], self.state.object_pose[row, :3])

    # A control step -------------------------------------------------------------------------------------------------

    def advance(self, action: Array, idle: Mask | None, rows: Rows | None) -> Rows:
        """Let actions act for one control period, and read the sensors.

        Args:
            action: (nsim, N) in [-1, 1].
            idle: simulations whose set points stay where they are instead; None: none.
            rows: which are stepped; None: all.

        Returns:
            Those that have diverged: their state is that before the step.
        """
        core, before = self._core, self.state
        command = core.drive.command(action, self._act)
        if idle is not None:
            command = np.where(idle[:, None], core.drive.idle(self._act), command)
        failed = self._cohorts.advance(command, rows)
        self._read(rows)
        diverged = self._diverged(failed, rows)
        if len(diverged):
            self._keep(before, diverged)
        return diverged

    def _diverged(self, failed: list[int], rows: Rows | None) -> Rows:
        counters, state = self.batch.warning[:, UNSTABLE, 1], self.batch.state
        if not failed and not np.count_nonzero(counters) and math.isfinite(np.add.reduce(state, axis=None)):
            return self._every[:0]
        given_up = counters.any(axis=1) | ~np.isfinite(state).all(axis=1)
        given_up[failed] = True
        gone = np.flatnonzero(given_up)
        return gone if rows is None else np.intersect1d(gone, rows)

    # Sensors --------------------------------------------------------------------------------------------------------

    def _read(self, rows: Rows | None) -> None:
        """Take one reading of every sensor of some simulations; None: of all."""
        if self._cohorts.lasting:
            self._read_some(rows, None)
            return
        wanted = self._every if rows is None else rows
        for cohort in self._cohorts.now:
            left = cohort.members.left
            if np.isin(left, wanted).all():
                chosen = None if len(left) == len(self._every) else left
                self._read_some(chosen, None if cohort.passes_readings else cohort)

    def _read_some(self, rows: Rows | None, effects: object) -> None:
        core = self._core
        qpos, qvel, sensed, tare = self._qpos, self._qvel, self._sensordata, self._tare
        if rows is not None:
            qpos, qvel, sensed, tare = qpos[rows], qvel[rows], sensed[rows], tare[rows]
        which = ... if rows is None else rows
        state = core.sensors.read(
            qpos,
            qvel,
            sensed,
            tare=tare,
            noise=None if core.sensors.pads is None else self._noise.take(self.generators, rows),
            average=lambda sample: self._average(sample, which),
            effects=effects,  # type: ignore[arg-type]
        )
        self.state = state if rows is None else _merged(self.state, state, rows)

    def _keep(self, before: State, rows: Rows) -> None:
        self.state = _merged(self.state, State(*(values[rows] for values in before)), rows)


def _merged(whole: State, some: State, rows: Rows) -> State:
    """The states of all simulations with new ones of some; nothing that was handed out before is changed."""
    merged = State(*(values.copy() for values in whole))
    for values, new in zip(merged, some, strict=True):
        values[rows] = new
    return merged


def _shapes(one: State, count: int) -> list[tuple[int, ...]]:
    return [(count, *values.shape) for values in one]
