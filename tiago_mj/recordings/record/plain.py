"""Recording any MJCF: its actuators driven by a motion, its joints and touch sensors measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from tiago_mj import __version__
from tiago_mj.effects import read_effects
from tiago_mj.effects.runner import LoadCells, Log, Readings, Runner
from tiago_mj.effects.wiring import wire
from tiago_mj.io.quoting import quoted
from tiago_mj.models import as_driven
from tiago_mj.models.actuators import actuator_interface
from tiago_mj.recordings.motions.play import Motion, random_motion
from tiago_mj.recordings.recording import SCHEMA, Array, Sidecar, Trial
from tiago_mj.recordings.usable import RATE as A_RATE
from tiago_mj.recordings.usable import is_rate

#: Control rate where neither the motion nor the command line says one [Hz].
RATE: Final = 100.0
#: Length of a random motion [s]: ten periods of its middle frequency.
SECONDS: Final = 12.0
#: A random motion keeps to this share of what the limits allow.
SHARE: Final = 0.5
_SCALAR_JOINTS: Final = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_TOUCH: Final = mujoco.mjtSensor.mjSENS_TOUCH


def interface_of(model: mujoco.MjModel) -> str:
    """What the model's actuators take: ``position``, ``velocity`` (integrating servos, too) or ``effort``.

    Raises:
        ValueError: it has no actuator, or of several kinds.
    """
    kinds = {actuator_interface(model, k): model.actuator(k).name for k in range(model.nu)}
    if not kinds:
        raise ValueError("the model has no actuator, so there is nothing to command: add one")
    if len(kinds) > 1:
        listed = ", ".join(f"{name} {kind}" for kind, name in kinds.items())
        raise ValueError(f"the model's actuators take commands of several kinds ({listed}): give a model with one")
    return next(iter(kinds))


def scalar_joints(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the hinges and slides.

    Raises:
        ValueError: one of them, or an actuator, has no name.
    """
    joints = [j for j in range(model.njnt) if int(model.jnt_type[j]) in _SCALAR_JOINTS]
    for kind, index in [("joint", j) for j in joints] + [("actuator", a) for a in range(model.nu)]:
        if not getattr(model, kind)(index).name:
            raise ValueError(f"{kind} {index} of the model has no name: columns are matched by name, so give it one")
    return tuple(model.joint(j).name for j in joints)


@dataclass(frozen=True)
class ModelPlan:
    """What is recorded.

    Attributes:
        path: of the MJCF.
        motion: what to play; None: another smooth random motion every episode.
        label: for names of trials.
        effects: that reality is to have; None: none.
        rate_hz: control rate [Hz]; None: the motion's, else :data:`RATE`. It becomes a whole number of physics steps.
        robot: what the sidecar calls it; None: the file's name.
        facts: what more the sidecar says of the robot; ``base`` (``fixed``) and ``gains`` of its motors are simulated.
    """

    path: Path
    motion: Motion | None
    label: str
    effects: Any = None
    rate_hz: float | None = None
    robot: str | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)


def record_model(plan: ModelPlan, *, episodes: int, seed: int) -> Iterator[Trial]:
    """Record a plain MJCF from its first keyframe, or its reference pose.

    Args:
        plan: what to record.
        episodes: how many.
        seed: of the first; each later one adds 1.

    Raises:
        ValueError: model, motion or effects are unusable, or the simulation diverges.
    """
    motion, facts = plan.motion, plan.facts
    model = as_driven.load(plan.path, fixed=facts.get("base") == "fixed", stated=facts.get("gains"))
    joints, interface, servo = scalar_joints(model), interface_of(model), _servo_facts(model)
    _check_motion(motion, _actuators(model), interface)
    wanted = plan.rate_hz or (motion.rate_hz if motion else None) or RATE
    if not is_rate(wanted):
        raise ValueError(f"the control rate is {quoted(wanted)}: {A_RATE}")
    substeps = max(round(1 / (wanted * model.opt.timestep)), 1)
    simulation = _Simulation(model, joints, interface, substeps, plan.effects)
    rate = 1 / simulation.period
    for number in range(seed, seed + episodes):
        simulation.restore()
        played = motion or _random(model, simulation.data, interface, rate, number)
        name = f"{plan.label}-{number:03d}"
        commands, log = simulation.play(played, number)
        if log.ends[0] <= len(commands):
            raise ValueError(
                f"{plan.path.name} diverges after {log.ends[0] * simulation.period:.2g} s of {name}, so nothing is "
                'recorded: try a shorter <option timestep="…"/> or integrator="implicitfast", or damp joints and servos'
            )
        yield simulation.trial(
            commands,
            log.readings,
            Sidecar(
                schema=SCHEMA,
                trial=name,
                robot=plan.robot or plan.path.name,
                rate_hz=rate,
                interface=interface,
                servo=servo,
                motion={"file": played.name} if motion else {"policy": "random"},
                source={"tool": "tiago-mj record", "version": __version__, "seed": number},
                raw=dict(facts),
            ),
        )


@dataclass(frozen=True)
class TouchSensors:
    """A model's touch sensors.

    Attributes:
        names: in the model's order.
        addresses: of each in ``sensordata``.
    """

    names: tuple[str, ...]
    addresses: tuple[int, ...]

    def newtons(self, sensordata: Array) -> Array:
        """Their forces, (..., nsensordata) to (..., nsensors) [N]."""
        return sensordata[..., list(self.addresses)]


def touch_sensors(model: mujoco.MjModel) -> TouchSensors:
    """The touch sensors of a model; there may be none."""
    ids = [s for s in range(model.nsensor) if model.sensor_type[s] == _TOUCH]
    return TouchSensors(tuple(model.sensor(s).name for s in ids), tuple(int(model.sensor_adr[s]) for s in ids))


class _Simulation:
    """One simulation of a plain model under effects, which plays motions."""

    def __init__(
        self, model: mujoco.MjModel, joints: tuple[str, ...], interface: str, substeps: int, effects: Any
    ) -> None:
        self._model, self.data = model, mujoco.MjData(model)
        self._substeps, self.period = substeps, substeps * model.opt.timestep
        touch = touch_sensors(model)
        self._cells = LoadCells(touch.newtons)
        self._wiring = wire(
            model,
            joints=joints,
            actuators=_actuators(model),
            sensors=touch.names,
            interface=interface,
        )
        self._rng = np.random.default_rng()
        self._runner = Runner.of_one(self.data, self._wiring, read_effects(effects), self._uniform)

    def _uniform(self, shape: tuple[int, ...]) -> Array:
        return self._rng.random(shape)

    def restore(self) -> None:
        """Make the model nominal again."""
        self._runner.restore()

    def play(self, motion: Motion, seed: int) -> tuple[Array, Log]:
        """Commands of a motion, (nrows, nactuators), and what is measured before, between and after them."""
        self._rng = np.random.default_rng(seed)
        self.restore()
        _reset(self._model, self.data)
        self._runner.start(self.period, self._substeps)
        mujoco.mj_forward(self._model, self.data)
        names = self._wiring.targets.command
        still = self._runner.set_points()[0] if self._wiring.interface == "position" else np.zeros(len(names))
        commands = np.tile(still, (motion.steps(1 / self.period), 1))
        sequence = motion.at(1 / self.period)
        for column, actuator in enumerate(names):
            if actuator in sequence:
                commands[:, column] = sequence[actuator]
        self._held = self._runner.set_points()[0]
        log = Log(self._runner, self._cells, len(commands) + 1)
        self._runner.run(commands[None], log)
        return commands, log

    def trial(self, commands: Array, readings: Readings, sidecar: Sidecar) -> Trial:
        """A recording of what was played; after the last command nothing was sent any more."""
        targets = self._wiring.targets
        position, velocity = readings.position[0], readings.velocity[0]
        sent = np.concatenate([commands, np.full((1, commands.shape[1]), np.nan)])
        initial = {
            "position": dict(zip(targets.joint, position[0].tolist(), strict=True)),
            "velocity": dict(zip(targets.joint, velocity[0].tolist(), strict=True)),
            "set_point": dict(zip(targets.command, self._held.tolist(), strict=True)),
        }
        return Trial(
            name=sidecar.trial,
            time=np.arange(len(sent)) * self.period,
            commands=_by_name(targets.command, sent),
            positions=_by_name(targets.joint, position),
            velocities=_by_name(targets.joint, velocity),
            efforts=_by_name(targets.joint, readings.effort[0]),
            forces=_by_name(targets.sensor, readings.reading[0]),
            sidecar=replace(sidecar, initial=initial),
            source=f"{sidecar.trial}.parquet",
        )


def _actuators(model: mujoco.MjModel) -> tuple[str, ...]:
    return tuple(model.actuator(a).name for a in range(model.nu))


def _check_motion(motion: Motion | None, actuators: tuple[str, ...], interface: str) -> None:
    if motion is None:
        return
    unknown = sorted(set(motion.commands) - set(actuators))
    if unknown:
        raise ValueError(
            f"motion {motion.name}: there is no actuator {unknown[0]!r}: the model has {', '.join(actuators)}"
        )
    if motion.interface not in (None, interface):
        raise ValueError(
            f"motion {motion.name} commands a {motion.interface}, the model's actuators take a {interface}"
        )


def _by_name(names: tuple[str, ...], values: Array) -> dict[str, Array]:
    return {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(names)}


def _reset(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """The first keyframe, or the reference pose; set points of integrating servos where their joints are."""
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    else:
        mujoco.mj_resetData(model, data)
    for actuator in range(model.nu):
        if model.actuator_actnum[actuator] == 1:
            joint = model.actuator_trnid[actuator, 0]
            data.act[model.actuator_actadr[actuator]] = data.qpos[model.jnt_qposadr[joint]]


def _random(model: mujoco.MjModel, data: mujoco.MjData, interface: str, rate_hz: float, seed: int) -> Motion:
    """A smooth random motion around the start, within :data:`SHARE` of the limits."""
    _reset(model, data)
    low, high = {}, {}
    for k in range(model.nu):
        name, joint = model.actuator(k).name, int(model.actuator_trnid[k, 0])
        if model.actuator_ctrllimited[k]:
            bounds = model.actuator_ctrlrange[k]
        elif interface == "position" and model.jnt_limited[joint]:
            bounds = model.jnt_range[joint]
        elif interface == "effort" and model.actuator_forcelimited[k]:
            bounds = model.actuator_forcerange[k]
        else:
            raise ValueError(
                f"actuator {name!r} has no ctrlrange, so how far it may go is unknown: write its ctrlrange into the "
                "model, or give --motion"
            )
        middle = float(data.qpos[model.jnt_qposadr[joint]]) if interface == "position" else 0.0
        reach = SHARE * max(float(min(bounds[1] - middle, middle - bounds[0])), 0.0)
        low[name], high[name] = middle - reach, middle + reach
    return random_motion(low, high, SECONDS, rate_hz, seed)


def _servo_facts(model: mujoco.MjModel) -> dict[str, Any]:
    actuators = _actuators(model)
    return {
        "name": "model",
        "stiffness": {name: float(0.0 - model.actuator_biasprm[k, 1]) for k, name in enumerate(actuators)},
        "damping": {name: float(0.0 - model.actuator_biasprm[k, 2]) for k, name in enumerate(actuators)},
    }
