"""Recording any MJCF: its actuators driven by a motion, its joints and touch sensors measured."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from tiago_mj import __version__
from tiago_mj.effects import check_entries, read_effects
from tiago_mj.effects.chain import Chain
from tiago_mj.effects.host import ScalarHost, has_diverged
from tiago_mj.effects.wiring import wire
from tiago_mj.io.quoting import quoted
from tiago_mj.models import bounded
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


def load_model(path: Path) -> mujoco.MjModel:
    """Compile an MJCF file.

    Raises:
        ValueError: there is no such file, or MuJoCo cannot compile it; one line.
    """
    if not path.is_file():
        raise ValueError(f"model {path}: no such file")
    return bounded.load_model(path, f"model {path.name}")


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


def record_model(
    path: Path,
    motion: Motion | None,
    *,
    effects: Any,
    episodes: int,
    seed: int,
    label: str,
    rate_hz: float | None,
    robot: str | None = None,
) -> Iterator[Trial]:
    """Record a plain MJCF from its first keyframe, or its reference pose.

    Args:
        path: of the MJCF.
        motion: what to play; None: another smooth random motion every episode.
        effects: that reality is to have; None: none.
        episodes: how many.
        seed: of the first; each later one adds 1.
        label: for names of trials.
        robot: what the sidecar calls it; None: the file's name.
        rate_hz: control rate [Hz]; None: the motion's, else :data:`RATE`. It becomes a whole number of physics steps.

    Raises:
        ValueError: model, motion or effects are unusable, or the simulation diverges.
    """
    model = load_model(path)
    data = mujoco.MjData(model)
    joints, interface = scalar_joints(model), interface_of(model)
    actuators = tuple(model.actuator(a).name for a in range(model.nu))
    _check_motion(motion, actuators, interface)
    wanted = rate_hz or (motion.rate_hz if motion else None) or RATE
    if not is_rate(wanted):
        raise ValueError(f"the control rate is {quoted(wanted)}: {A_RATE}")
    substeps = max(round(1 / (wanted * model.opt.timestep)), 1)
    period = substeps * model.opt.timestep
    touch = [s for s in range(model.nsensor) if model.sensor_type[s] == _TOUCH]
    wiring = wire(
        model,
        joints=joints,
        actuators=actuators,
        sensors=tuple(model.sensor(s).name for s in touch),
        interface=interface,
    )
    rng = np.random.default_rng(seed)
    servo = _servo_facts(model, actuators)
    entries = read_effects(effects)
    check_entries(entries, model, wiring)
    chain = Chain(ScalarHost(data), wiring, [entries], lambda shape: rng.random(shape))
    for number in range(seed, seed + episodes):
        rng = np.random.default_rng(number)
        chain.restore()
        played = motion or _random(model, data, interface, 1 / period, number)
        name = f"{label}-{number:03d}"
        _reset(model, data, chain.set_points)
        chain.start(period, substeps)
        mujoco.mj_forward(model, data)
        sequence = played.at(1 / period)
        still = chain.set_points()[0] if interface == "position" else np.zeros(len(actuators))
        start = chain.set_points()[0]
        commands = np.tile(still, (played.steps(1 / period) + 1, 1))
        commands[-1] = np.nan
        for column, actuator in enumerate(actuators):
            if actuator in sequence:
                commands[:-1, column] = sequence[actuator]
        rows = []
        for row in commands:
            newtons = data.sensordata[[int(model.sensor_adr[s]) for s in touch]]
            rows.append(
                (
                    chain.position(data.qpos[wiring.qpos][None])[0],
                    chain.velocity(data.qvel[wiring.dof][None])[0],
                    data.qfrc_actuator[wiring.dof].copy(),
                    chain.reading(newtons[None], lambda force: force, np.zeros((1, len(touch))))[0],
                )
            )
            if not np.isnan(row).any():
                chain.advance(row[None])
                if has_diverged(data):
                    raise ValueError(
                        f"{path.name} diverges after {len(rows) * period:.2g} s of {name}, so nothing is recorded: try "
                        'a shorter <option timestep="…"/> or integrator="implicitfast", or damp joints and servos'
                    )
        position, velocity, effort, force = (np.array(part) for part in zip(*rows, strict=True))
        yield Trial(
            name=name,
            time=np.arange(len(commands)) * period,
            commands=_by_name(actuators, commands),
            positions=_by_name(joints, position),
            velocities=_by_name(joints, velocity),
            efforts=_by_name(joints, effort),
            forces=_by_name(wiring.targets.sensor, force),
            sidecar=Sidecar(
                schema=SCHEMA,
                trial=name,
                robot=robot or path.name,
                rate_hz=1 / period,
                interface=interface,
                servo=servo,
                initial={
                    "position": dict(zip(joints, position[0].tolist(), strict=True)),
                    "velocity": dict(zip(joints, velocity[0].tolist(), strict=True)),
                    "set_point": dict(zip(actuators, start.tolist(), strict=True)),
                },
                motion={"file": played.name} if motion else {"policy": "random"},
                source={"tool": "tiago-mj record", "version": __version__, "seed": number},
            ),
            source=f"{name}.parquet",
        )


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


def _reset(model: mujoco.MjModel, data: mujoco.MjData, set_points: Any) -> None:
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
    _reset(model, data, None)
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
            raise ValueError(f"actuator {name!r} has no ctrlrange, so how far it may go is unknown: give --motion")
        middle = float(data.qpos[model.jnt_qposadr[joint]]) if interface == "position" else 0.0
        reach = SHARE * max(float(min(bounds[1] - middle, middle - bounds[0])), 0.0)
        low[name], high[name] = middle - reach, middle + reach
    return random_motion(low, high, SECONDS, rate_hz, seed)


def _servo_facts(model: mujoco.MjModel, actuators: tuple[str, ...]) -> dict[str, Any]:
    return {
        "name": "model",
        "stiffness": {name: float(0.0 - model.actuator_biasprm[k, 1]) for k, name in enumerate(actuators)},
        "damping": {name: float(0.0 - model.actuator_biasprm[k, 2]) for k, name in enumerate(actuators)},
    }
