"""Reality in which user robots are recorded: MuJoCo at another time step, numbers off by a few per cent, with encoders.

The user's model is loaded anew, every mass, gain and damping is made a little different, and it is stepped at 0.5 ms
with ``implicitfast``, whatever the model says. What is written is what the contract asks of a user: columns ``time``,
``command.ACTUATOR``, ``position.JOINT``, sometimes ``velocity.JOINT``, and a sidecar. Nothing of ``tiago_mj.gap`` is
imported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.user_robots import motions, truths
from benchmarks.user_robots.models import USER_ROBOTS, UserRobot
from benchmarks.user_robots.truths import Truth

Array = NDArray[np.float64]

STEP: Final = 5e-4
#: Standard deviation of what nobody knows of masses, gains and damping; cut at two.
JITTER: Final = 0.03
RATES: Final = (50.0, 100.0, 125.0, 200.0, 250.0, 500.0)
#: The user's computed torques: bandwidth [rad/s] at critical damping.
BANDWIDTH: Final = 9.0
#: A truth is enlarged until the first log differs by so many standard deviations of an encoder, and by so many times
#: what the jitter alone makes (rms); at most so often, by half each time.
CLEAR: Final = (8.0, 1.0)
ENLARGED: Final = 2
STILL: Final = 2.0


@dataclass(frozen=True)
class Plan:
    """How a case is recorded; drawn from its seed.

    Attributes:
        rate: of the log [Hz].
        logs: how many.
        seconds: of one log.
        noise: of an encoder [rad]; a tenth of it [m].
        bits: of an encoder, over a turn or over 0.4 m.
        velocity: whether velocities are logged.
        parquet: or CSV.
    """

    rate: float
    logs: int
    seconds: float
    noise: float
    bits: int
    velocity: bool
    parquet: bool

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Plan:
        """A careful user's session."""
        return cls(
            rate=float(rng.choice(RATES)),
            logs=int(rng.integers(3, 21)),
            seconds=float(np.round(rng.uniform(2.5, 6.0), 1)),
            noise=float(rng.uniform(5e-5, 3e-4)),
            bits=int(rng.integers(15, 18)),
            velocity=bool(rng.random() < 0.5),
            parquet=bool(rng.random() < 0.5),
        )


@dataclass(frozen=True)
class Log:
    """One recorded motion: (T,), (T, nu), (T, nj), and what the actuators pulled, (T, nu)."""

    time: Array
    command: Array
    position: Array
    velocity: Array
    force: Array
    begin: Array


@dataclass(frozen=True)
class Reality:
    """A robot as it really is.

    Attributes:
        robot: its kind.
        nominal: the user's model.
        model: what it is.
        truth: what it has that the model lacks.
    """

    robot: UserRobot
    nominal: mujoco.MjModel
    model: mujoco.MjModel
    truth: Truth

    @property
    def actuators(self) -> tuple[str, ...]:
        return tuple(self.nominal.actuator(k).name for k in range(self.nominal.nu))

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(self.nominal.joint(k).name for k in range(self.nominal.njnt))

    @property
    def driven(self) -> NDArray[np.intp]:
        """Joint of each actuator."""
        return self.nominal.actuator_trnid[:, 0].astype(np.intp)


def jittered(path: Path, rng: np.random.Generator, spread: float, payload: tuple[str, float] | None) -> mujoco.MjModel:
    """The model with every mass, gain and damping a little off, stepped finely; a payload on a body, if any."""
    spec, nominal = mujoco.MjSpec.from_file(str(path)), mujoco.MjModel.from_xml_path(str(path))
    if payload is not None:
        name, mass = payload
        ball = spec.body(name).add_body(name="payload", pos=nominal.body(name).ipos)
        ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], mass=mass, contype=0, conaffinity=0)
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model = spec.compile()

    def factor(count: int) -> Array:
        return 1 + spread * np.clip(rng.standard_normal(count), -2, 2)

    scale = np.ones(model.nbody)
    ids = [model.body(nominal.body(k).name).id for k in range(nominal.nbody)]
    scale[ids] = factor(nominal.nbody)  # the payload is what it is said to be
    model.body_mass *= scale
    model.body_inertia *= scale[:, None]
    model.dof_damping *= factor(model.nv).reshape(-1, *[1] * (model.dof_damping.ndim - 1))
    model.dof_armature *= factor(model.nv)
    gain, damping = factor(model.nu), factor(model.nu)
    servo = model.actuator_biasprm[:, 1] < 0
    speed = ~servo & (model.actuator_biasprm[:, 2] < 0)
    model.actuator_gainprm[:, 0] *= np.where(speed, damping, gain)
    model.actuator_biasprm[:, 1] *= gain
    model.actuator_biasprm[:, 2] *= damping
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def play(reality: Reality, wanted: Array, rate: float, user: Callable[[Array, int], Array] | None) -> Log:
    """Run one motion.

    Args:
        reality: the robot.
        wanted: (T, nu) commands; of motors ignored, where ``user`` gives them.
        rate: [Hz].
        user: torques that the user's controller sends, from the measured positions and the row.
    """
    model, truth = reality.model, reality.truth
    data = mujoco.MjData(model)
    home = np.array([reality.robot.home[name] for name in reality.actuators])
    _put(model, data, reality, home)
    parts = round(1 / (rate * STEP))
    late = round(truth.value / STEP) if truth.kind == "delay" and truth.value else 0
    bristles, dof = None, -1
    if truth.kind == "friction" and truth.value:
        dof = int(model.joint(truth.joint).dofadr[0])
        whole = np.zeros((model.nv, model.nv))
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, whole)
        bristles = truths.Bristles(truth.value, 1 / np.linalg.inv(whole)[dof, dof], STEP)

    def run(count: int) -> None:
        if bristles is None:
            mujoco.mj_step(model, data, nstep=count)
            return
        for _ in range(count):
            data.qfrc_applied[dof] = bristles(float(data.qvel[dof]))
            mujoco.mj_step(model, data)

    if reality.robot.interface == "position" or model.na:
        data.ctrl[:] = wanted[0] if reality.robot.interface == "position" else 0.0
        run(round(STILL / STEP))
        data.time = 0.0
    begin = data.act.copy() if model.na else home
    q = [int(model.joint(name).qposadr[0]) for name in reality.joints]
    v = [int(model.joint(name).dofadr[0]) for name in reality.joints]
    rows = len(wanted)
    idle = np.zeros(model.nu)
    if reality.robot.interface == "position":
        idle = wanted[0]
    sent = np.zeros((rows, model.nu))
    position, velocity, force = np.zeros((rows, len(q))), np.zeros((rows, len(v))), np.zeros((rows, model.nu))
    for row in range(rows):
        position[row], velocity[row] = data.qpos[q], data.qvel[v]
        sent[row] = wanted[row] if user is None else user(position[row], row)
        if row == 0 and user is not None:
            idle = sent[0]
        done = 0
        while done < parts:  # at most two commands are in force within a row
            given = truths.queued(row, done, parts, late)
            until = done + 1
            while until < parts and truths.queued(row, until, parts, late) == given:
                until += 1
            data.ctrl[:] = sent[given] if given >= 0 else idle
            run(until - done)
            done = until
        force[row] = data.actuator_force
    return Log(np.arange(rows) / rate, sent, position, velocity, force, begin)


def _put(model: mujoco.MjModel, data: mujoco.MjData, reality: Reality, home: Array) -> None:
    for k, joint in enumerate(reality.driven):
        data.qpos[model.joint(reality.nominal.joint(int(joint)).name).qposadr[0]] = home[k]
    for k in range(model.neq):  # a coupled finger begins where its partner is
        if model.eq_type[k] == mujoco.mjtEq.mjEQ_JOINT:
            one, other = model.eq_obj1id[k], model.eq_obj2id[k]
            data.qpos[model.jnt_qposadr[one]] = data.qpos[model.jnt_qposadr[other]]
    if model.na:
        data.act[:] = home
    mujoco.mj_forward(model, data)


class ComputedTorque:
    """The user's own controller of motors: torques of the nominal model for a motion, and of its errors.

    Args:
        reality: of which the nominal model and the order of joints are used.
        path: (T, nu) where to be.
        rate: [Hz].
    """

    def __init__(self, reality: Reality, path: Array, rate: float) -> None:
        self._model, self._path, self._rate = reality.nominal, path, rate
        self._data = mujoco.MjData(self._model)
        self._speed = np.gradient(path, axis=0) * rate
        self._change = np.gradient(self._speed, axis=0) * rate
        self._joints = [reality.joints.index(reality.nominal.joint(int(j)).name) for j in reality.driven]
        self._q = [int(self._model.jnt_qposadr[j]) for j in reality.driven]
        self._v = [int(self._model.jnt_dofadr[j]) for j in reality.driven]
        self._before: Array | None = None
        self._slip = np.zeros(len(self._q))

    def __call__(self, measured: Array, row: int) -> Array:
        here = measured[self._joints]
        slip = np.zeros_like(here) if self._before is None else (here - self._before) * self._rate
        self._before = here.copy()
        self._slip += min(1.0, 120 / self._rate) * (slip - self._slip)  # an estimate that noise does not shake
        model, data = self._model, self._data
        data.qpos[self._q], data.qvel[self._v] = here, self._slip
        mujoco.mj_forward(model, data)
        wanted = self._change[row] + BANDWIDTH**2 * (self._path[row] - here)
        wanted += 2 * BANDWIDTH * (self._speed[row] - self._slip)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        torque = mass[np.ix_(self._v, self._v)] @ wanted + (data.qfrc_bias - data.qfrc_passive)[self._v]
        return np.clip(torque, *model.actuator_ctrlrange.T)


def session(reality: Reality, plan: Plan, seed: int, logs: range) -> list[Log]:
    """Logs of a plan; the motions depend on seed and number alone, so that truths can be compared."""
    robot, made = reality.robot, []
    time = np.arange(round(plan.seconds * plan.rate) + 1) / plan.rate
    home = np.array([robot.home[name] for name in reality.actuators])
    swing = np.array([robot.swing[name] for name in reality.actuators])
    smooth = robot.interface != "position"
    for number in logs:
        rng = np.random.default_rng([seed, 1, number])
        away = [motions.motion(number, time, rng, robot.pace, smooth=smooth) for _ in home]
        path = home + swing * np.stack(away, axis=1)
        if robot.interface == "position":
            made.append(play(reality, path, plan.rate, None))
        elif robot.interface == "velocity":
            speed = np.vstack([np.diff(path, axis=0) * plan.rate, np.zeros_like(home)])
            limit = reality.nominal.actuator_ctrlrange[:, 1]
            bounded = np.where(reality.nominal.actuator_ctrllimited == 1, limit, np.inf)
            made.append(play(reality, np.clip(speed, -bounded, bounded), plan.rate, None))
        else:
            made.append(play(reality, path, plan.rate, ComputedTorque(reality, path, plan.rate)))
    return made


def make(
    robot: UserRobot,
    kind: str,
    seed: int,
    model: Path,
    *,
    spread: float = JITTER,
    asked: Mapping[str, Any] | None = None,
) -> tuple[Reality, Plan]:
    """The reality of a case and the plan of its session; a truth is made as large as it takes to be clear.

    Args:
        robot: to be recorded.
        kind: truth.
        seed: of jitter, motions, rate, number of logs, noise and the truth's size.
        model: the user's MJCF.
        spread: of the jitter; 0 for the very model.
        asked: numbers of the plan that are not drawn.
    """
    number = list(USER_ROBOTS).index(robot.name)
    plan = replace(Plan.drawn(np.random.default_rng([seed, 2, number])), **(asked or {}))
    nominal = mujoco.MjModel.from_xml_path(str(model))

    def real(truth: Truth, spread: float) -> Reality:
        load = (robot.tool, truth.value) if truth.kind == "payload" and truth.value else None
        made = jittered(model, np.random.default_rng([seed, 3, number]), spread, load)
        return Reality(robot, nominal, made, truth)

    plain = real(Truth("none"), spread)
    rng = np.random.default_rng([seed, 4, number, truths.TRUTHS.index(kind)])
    driven = tuple(nominal.joint(int(j)).name for j in plain.driven)
    truth = truths.draw(kind, rng, driven, robot.loads)
    if kind == "none":
        return plain, plan
    probe = range(min(3, plan.logs))
    without, exact = session(plain, plan, seed, probe), session(real(Truth("none"), 0.0), plan, seed, probe)
    noise = noise_of(plain, plan)
    jitter = _difference(without, exact, noise, plain)
    if truth.kind == "friction":
        pulls = np.concatenate([log.force for log in without])[:, driven.index(str(truth.joint))]
        span = float(np.ptp(np.percentile(pulls, [2.5, 97.5])))
        truth = replace(truth, value=truth.facts["share"] * span)
    elif truth.kind == "payload":
        truth = replace(truth, value=truth.facts["share"] * float(nominal.body(robot.tool).mass[0]))
    for _ in range(ENLARGED + 1):
        shows = _difference(without, session(real(truth, spread), plan, seed, probe), noise, plain)
        if kind == "delay" or shows > max(CLEAR[0], CLEAR[1] * jitter):
            break
        truth = replace(truth, value=1.5 * float(truth.value or 0.0))
    clear = {"shows": round(shows, 2), "jitter_shows": round(jitter, 2)}
    return real(replace(truth, facts={**truth.facts, **clear}), spread), plan


def _difference(one: list[Log], other: list[Log], noise: Array, reality: Reality) -> float:
    """Root mean square of the joint that differs most, in standard deviations of its encoder; of motors, of torques."""
    if reality.robot.interface == "effort":
        far = np.concatenate([a.command - b.command for a, b in zip(one, other, strict=True)])
        unit = 0.002 * np.ptp(np.concatenate([a.command for a in one]), axis=0)
    else:
        far = np.concatenate([a.position - b.position for a, b in zip(one, other, strict=True)])
        unit = noise
    return float((np.sqrt((far**2).mean(axis=0)) / unit).max())


def noise_of(reality: Reality, plan: Plan) -> Array:
    slides = reality.nominal.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    return plan.noise * np.where(slides, 0.1, 1.0)
