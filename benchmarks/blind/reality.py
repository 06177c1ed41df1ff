"""The simulation of reality: commands in, what a logger would have written out; all trials of a case at once.

Every physics step runs through the same chain: what was sent and when it arrives, the set point, the servo, the drive,
what loads the joint, the bodies (MuJoCo), the sensors. An effect is a hook somewhere in that chain
(:class:`benchmarks.blind.effects.base.Effect`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.effects.base import Effect, World
from benchmarks.blind.effort_sensors import EffortSensor
from benchmarks.blind.robots import FINE_STEP, Robot
from tiago_mj.models import names, scene

Array = NDArray[np.float64]

#: Asks for the next command: (row, time, positions, readings, set points) -> commands, all (ntrials, n).
Planner = Callable[[int, float, Array, Array], Array]


#: A robot stands still so long before it is recorded [s].
SETTLING: Final = 0.6


@dataclass(frozen=True)
class Recorded:
    """What was logged, row by row.

    Attributes:
        time: (ntrials, T) [s], by the recorder's clock.
        commands: (ntrials, T, n); the last row is NaN.
        position, velocity: (ntrials, T, n), measured.
        force: (ntrials, T, 2) [sensor units], measured; (ntrials, T, 0) without load cells.
        begun: where the joints are at the first row, true, (ntrials, n); no file has it.
        effort: (ntrials, T, n) [N, N·m], measured; None where nothing measures it.
    """

    time: Array
    commands: Array
    position: Array
    velocity: Array
    force: Array
    begun: Array | None = None
    effort: Array | None = None


@dataclass(frozen=True)
class Setup:
    """How the trials are run.

    Attributes:
        interface: ``velocity`` or ``position``.
        rate: of the commands [Hz].
        rows: control steps.
        offsets: of the object from the middle along the grasp axis, per trial [m]; empty without an object.
        start: joints' initial positions, (ntrials, n).
        noise_seed: of the sensors' noise.
        silent: no noise, for oracles.
        effort: what measures the drives' torques; None: nothing.
        instants: of the rows, (rows + 1,) [s], where they are not evenly apart; None: they are.
    """

    interface: str
    rate: float
    rows: int
    offsets: Array
    start: Array
    noise_seed: int
    silent: bool = False
    instants: Array | None = None
    effort: EffortSensor | None = None


def simulate(robot: Robot, effects: Sequence[Effect], setup: Setup, plan: Planner | Array) -> Recorded:
    """Run all trials.

    Args:
        robot: as :mod:`benchmarks.blind.robots` made it; effects edit it, so it serves once.
        effects: of this reality.
        setup: see there.
        plan: what to command, or the recorded commands (ntrials, T, n).
    """
    for effect in effects:
        effect.build(robot)
    return run_built(robot, effects, setup, plan)


def run_built(robot: Robot, effects: Sequence[Effect], setup: Setup, plan: Planner | Array) -> Recorded:
    """As :func:`simulate`, of a robot that the effects have already changed."""
    ntrials, n = setup.start.shape
    period = 1 / setup.rate
    step = min(_stiffest(effects), robot.step)
    substeps = int(np.ceil(period / step - 1e-9))
    h = period / substeps
    for model in {id(m): m for m in (robot.model, *robot.models)}.values():
        model.opt.timestep = h
    batch = mujoco.batch.Batch(robot.model, ntrials, 1)
    if robot.models:
        batch.set_models(robot.models)
    _place(batch, robot, setup)
    world = World(
        robot=robot,
        h=h,
        period=period,
        ahead=period if setup.interface == "position" else 0.0,
        q=setup.start.copy(),
        v=np.zeros((ntrials, n)),
        newtons=np.zeros((ntrials, 2 if robot.pads is not None else 0)),
        idle=np.zeros_like(setup.start) if setup.interface == "velocity" else setup.start.copy(),
        rng=np.random.default_rng([setup.noise_seed, 1]),
    )
    for effect in effects:
        effect.start(world)
    return _Loop(robot, list(effects), setup, plan, world, batch, substeps).run()


def _stiffest(effects: Sequence[Effect]) -> float:
    """Longest step that bristles and gear teeth bear [s]: they are as stiff as it allows, so that it is a fine one. At
    0.5 ms bristles on a finger bent by 36 µm under 1.75 N, its encoder's noise is 27 µm; at 0.125 ms by 2 µm."""
    return FINE_STEP if any(effect.stiff for effect in effects) else np.inf


#: Of effects, in the order in which they are asked.
HOOKS: Final = (
    *("sent", "shaped", "executed", "control", "drive", "load"),
    *("joints_read", "forces_read", "converted", "sampled"),
)


class _Loop:
    """One run; splits the chain into steps that each do one thing."""

    def __init__(
        self,
        robot: Robot,
        effects: list[Effect],
        setup: Setup,
        plan: Planner | Array,
        world: World,
        batch: mujoco.batch.Batch,
        substeps: int,
    ) -> None:
        self.robot, self.setup, self.plan, self.world, self.batch = robot, setup, plan, world, batch
        self.substeps = substeps
        self.effects = sorted(effects, key=lambda effect: effect.order)
        self.noise = np.random.default_rng([setup.noise_seed, 0])
        self.latency = np.max([e.latency(world) for e in effects], axis=0) if effects else np.zeros(world.q.shape[1])
        self.late = max((e.late for e in effects), default=0.0)
        self.noise_factor = math.prod((e.noise_factor(world) for e in effects), start=1.0)
        self.transmission = next((e for e in effects if e.two_mass), None)
        self.sent: list[tuple[float, Array]] = []
        self.latest = np.full(world.q.shape[1], -np.inf)
        self.command = world.idle.copy()
        self.set_point = setup.start.copy()
        self.speed = np.zeros_like(world.q)
        self.past: list[tuple[float, Array, Array, Array]] = []
        self.given: list[tuple[float, Array]] = []
        self.effort_noise = np.random.default_rng([setup.noise_seed, 3])
        for name in HOOKS:
            setattr(self, f"_{name}", [e for e in self.effects if e.has(name)])

    def run(self) -> Recorded:
        """All rows of all trials."""
        batch, world, setup = self.batch, self.world, self.setup
        self.qpos, self.qvel = batch.bind("qpos"), batch.bind("qvel")
        self.applied = batch.bind("qfrc_applied")
        self.lifting = batch.bind("qfrc_gravcomp")
        self.address, self.dof = self.robot.qpos, self.robot.dof
        self.sensors = batch.bind("sensordata") if self.robot.pads is not None else None
        ntrials, n = world.q.shape
        nforce = world.newtons.shape[1]
        rows = setup.rows + 1
        commands = np.full((ntrials, rows, n), np.nan)
        position, velocity = np.zeros((ntrials, rows, n)), np.zeros((ntrials, rows, n))
        force = np.zeros((ntrials, rows, nforce))
        effort = np.zeros((ntrials, rows, n)) if setup.effort is not None else None
        time = np.zeros(rows)
        steps = np.full(setup.rows, self.substeps)
        if setup.instants is not None:
            steps = np.maximum(np.diff(np.round(setup.instants / world.h).astype(int)), 1)
        world.t = -round(SETTLING / world.h) * world.h
        self.seen = self._sense()
        while world.t < -world.h / 2:  # a robot that is switched on has settled before anything is logged
            self._step()
        world.t = 0.0
        begun = np.array(world.q)
        for k in range(rows):
            world.row = k
            time[k] = world.t
            position[:, k], velocity[:, k], force[:, k] = self._log()
            if effort is not None:
                effort[:, k] = self._effort()
            if k == rows - 1:
                break
            if callable(self.plan):
                commands[:, k] = self.plan(k, world.t, position[:, k], force[:, k])
            else:
                commands[:, k] = self.plan[:, k]
            sent = commands[:, k]
            for effect in self._sent:  # type: ignore[attr-defined]
                sent = effect.sent(sent, world)
            self.sent.append((world.t, sent))
            if setup.instants is not None:
                world.period = steps[k] * world.h
            for _ in range(steps[k]):
                self._step()
        stamps = time.copy()
        for effect in self.effects:
            stamps = effect.stamp(stamps)
        return Recorded(np.tile(stamps, (ntrials, 1)), commands, position, velocity, force, begun, effort)

    def _step(self) -> None:
        world, robot = self.world, self.robot
        point = self._aim()
        if self.transmission is not None:
            seen_q, seen_v = self.transmission.motor(world)
        else:
            seen_q, seen_v = world.q, world.v
        force = world.stiffness * (point - seen_q) - world.damping * seen_v
        for effect in self._control:  # type: ignore[attr-defined]
            force = effect.control(force, world)
        world.free = np.abs(force) < robot.limit
        asked = force = np.clip(force, -robot.limit, robot.limit)
        for effect in self._drive:  # type: ignore[attr-defined]
            force = effect.drive(force, world)
        world.force = force
        if self.transmission is not None:
            force = self.transmission.through(force, world)
        for effect in self._load:  # type: ignore[attr-defined]
            force = force + effect.load(world)
        self.applied[:, self.dof] = force
        self.batch.step()
        world.t += world.h
        world.lifted = self.lifting[:, self.dof]
        if self.setup.effort is not None:
            self._keep(asked if self.setup.effort.of_current else world.force)
        world.q = self.qpos[:, self.address]
        world.v = self.qvel[:, self.dof]
        if self.sensors is not None:
            contact, axis = robot.pads  # type: ignore[misc]
            world.newtons = -np.einsum("tsk,tsk->ts", self.sensors[:, contact], self.sensors[:, axis])
        if self._joints_read or self._forces_read or self.late:  # type: ignore[attr-defined]
            self.seen = self._sense()

    def _aim(self) -> Array:
        """The set point that the servo follows now."""
        world, setup, robot = self.world, self.setup, self.robot
        arrived = np.zeros(world.q.shape[1], dtype=bool)
        for instant, command in self.sent:
            due = world.t - instant >= self.latency - 1e-9
            if not due.any():
                break
            self.command = np.where(due, command, self.command)
            arrived = arrived | (due & (instant > self.latest))
            self.latest = np.where(due, np.maximum(instant, self.latest), self.latest)
        while self.sent and world.t - self.sent[0][0] >= self.latency.max() - 1e-9:
            self.sent.pop(0)
        wanted = self.command
        for effect in self._shaped:  # type: ignore[attr-defined]
            wanted = effect.shaped(wanted, world)
            arrived |= self._tick()
        if setup.interface == "velocity":
            self.speed = np.clip(wanted, -robot.speed, robot.speed)
        else:
            speed = np.clip((wanted - self.set_point) / world.period, -robot.speed, robot.speed)
            self.speed = np.where(arrived, speed, self.speed)
        if setup.interface == "direct":  # a plain position servo: the target is the set point
            self.set_point = np.clip(wanted, robot.low, robot.high)
        point = self.set_point  # of this instant, as the joints are; the end of the step's would lead them by it
        if setup.interface != "direct":
            self.set_point = np.clip(self.set_point + self.speed * world.h, robot.low, robot.high)
        for effect in self._executed:  # type: ignore[attr-defined]
            point = effect.executed(point, world)
        return point

    def _tick(self) -> bool:
        """Whether a control period begins now."""
        phase = self.world.t / self.world.period
        return abs(phase - round(phase)) * self.world.period < self.world.h / 2

    def _sense(self) -> tuple[Array, Array, Array]:
        """What the sensors' electronics give now, free of the noise of sampling."""
        world = self.world
        q, v, x = world.q, world.v, world.newtons * self.robot.units
        for effect in self._joints_read:  # type: ignore[attr-defined]
            q, v = effect.joints_read(q, v, world)
        for effect in self._forces_read:  # type: ignore[attr-defined]
            x = effect.forces_read(x, world)
        if self.late:
            self.past.append((world.t, q.copy(), v.copy(), x.copy()))
            while len(self.past) > 2 and self.past[1][0] <= world.t - self.late - 2 * world.h:
                self.past.pop(0)
        return q, v, x

    def _keep(self, force: Array) -> None:
        """Remember what the drives give, with what lifts the robot's own weight, as long as a sensor may be late."""
        assert self.setup.effort is not None
        self.given.append((self.world.t, force + self.world.lifted))
        while len(self.given) > 1 and self.given[1][0] <= self.world.t - self.setup.effort.delay + 1e-9:
            self.given.pop(0)

    def _effort(self) -> Array:
        """A row of the drives' torques as they are measured, (ntrials, n)."""
        sensor = self.setup.effort
        assert sensor is not None
        out = sensor.gain * self.given[0][1] + sensor.offset
        return out if self.setup.silent else out + sensor.noise * self.effort_noise.standard_normal(out.shape)

    def _log(self) -> tuple[Array, Array, Array]:
        """A row of the log: late, noisy, digitised."""
        world = self.world
        if not (self._joints_read or self._forces_read or self.late):  # type: ignore[attr-defined]
            self.seen = self._sense()
        q, v, x = self.seen if not self.late else self._then(world.t - self.late)
        for effect in self._converted:  # type: ignore[attr-defined]
            q, v, x = effect.converted(q, v, x, world)
        drawn = self.noise.standard_normal((3, *world.q.shape))
        noise = self.noise.standard_normal(world.newtons.shape)
        if not self.setup.silent:
            q = q + drawn[0] * self.robot.noise[0]
            v = v + drawn[1] * self.robot.noise[1]
            x = x + noise * self.robot.force_noise * self.noise_factor
        for effect in self._sampled:  # type: ignore[attr-defined]
            q, v, x = effect.sampled(q, v, x, world)
        return q, v, x

    def _then(self, when: float) -> tuple[Array, Array, Array]:
        """The sensors at an earlier instant, between the two that were kept around it."""
        if when <= self.past[0][0]:
            return self.past[0][1:]
        for earlier, later in zip(self.past, self.past[1:], strict=False):
            if earlier[0] <= when <= later[0]:
                w = (when - earlier[0]) / (later[0] - earlier[0])
                return tuple((1 - w) * a + w * b for a, b in zip(earlier[1:], later[1:], strict=True))  # type: ignore
        return self.past[-1][1:]


def _place(batch: mujoco.batch.Batch, robot: Robot, setup: Setup) -> None:
    batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
    qpos = batch.bind("qpos")
    qpos[:] = robot.start
    qpos[:, robot.qpos] = setup.start
    if robot.item is not None:
        address = int(robot.model.joint(names.OBJECT_JOINT).qposadr[0])
        qpos[:, address : address + 2] = robot.middle + setup.offsets[:, None] * robot.along
        qpos[:, address + 2] = scene.TABLE_TOP + robot.item.half_extents()[2]  # every object is as high
        qpos[:, address + 3 : address + 7] = robot.turned
    batch.bind("qvel")[:] = 0
    batch.forward()
