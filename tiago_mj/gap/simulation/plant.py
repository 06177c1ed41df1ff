"""The nominal simulator of a set of recordings: which model, how it starts, how it is commanded and read.

It is built from a recording's sidecar, by the environments' own code: the diagnosis simulates exactly what
``gymnasium.make`` would.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import check_entries
from tiago_mj.effects.now import Wiring
from tiago_mj.effects.spec import Entry
from tiago_mj.effects.wiring import wire
from tiago_mj.envs.replay_specification import ReplaySpecification
from tiago_mj.gap.simulation.servo_gains import servo_gains
from tiago_mj.io.loading import is_file
from tiago_mj.io.quoting import quoted
from tiago_mj.models import scene
from tiago_mj.models.actuators import driven_joint, replayed_interfaces
from tiago_mj.models.bounded import check_speed, load_model, with_movable_masses
from tiago_mj.models.held_base import with_held_base
from tiago_mj.models.objects import KEYS, SHAPES, GraspObject
from tiago_mj.models.stated import uncertainty
from tiago_mj.recordings.grid import grid_step
from tiago_mj.recordings.lint.names import check_names
from tiago_mj.recordings.nominal_priors import grids, known_to
from tiago_mj.recordings.recording import RecordingError, Sidecar, Trial
from tiago_mj.recordings.robot import MODELS, Robot
from tiago_mj.registration import ENVIRONMENTS
from tiago_mj.sensing.load_cell import LoadCell
from tiago_mj.sensing.sources import PadForces

Array = NDArray[np.float64]

#: Longest physics step of a plain MJCF in the diagnosis [s]; its own where that is shorter.
PLAIN_TIMESTEP: Final = 1 / 500

#: A first measured position that is farther from the sidecar's than this contradicts it, (slide [m], hinge [rad]):
#: about three standard deviations of a poor encoder.
STARTS_ELSEWHERE: Final = (1e-4, 1e-3)


@dataclass(frozen=True)
class Start:
    """How one trial begins, and its object.

    Attributes:
        qpos: (nq,) [m, rad].
        qvel: (nv,).
        set_point: per actuator, (nactuators,) [m, rad].
        item: the object, or None.
        idle: of every input of the model, (nu,), what it is where nothing is commanded; None: 0.
    """

    qpos: Array
    qvel: Array
    set_point: Array
    item: GraspObject | None
    idle: Array | None = None


@dataclass(frozen=True)
class Plant:
    """What to simulate.

    Attributes:
        name: of the environment or model.
        model: compiled, nominal.
        wiring: its parts.
        max_timestep: longest physics step [s].
        period: nominal control period [s].
        cell: load cell, or None without force channels.
        pads: reads the pads' forces; None without.
        environment: arguments that make the environment, for policies; None for a plain model.
        file: of a plain model.
        relative: whether a command is a change from the measured position, as of controllers that follow it.
        known: how well the recordings say that numbers of the model are known
            (:mod:`tiago_mj.recordings.nominal_priors`).
        given: effects that are known already: part of every simulation, whatever else is tried.
        grids: step of the grid of every channel that is said to have one
            (:func:`tiago_mj.recordings.nominal_priors.grids`).
        effort_row: time between two recorded rows where efforts are compared along a motion [s]; None: commands are
            replayed.
        largest_effort: that was measured of every joint, where efforts are compared along a motion [N, N·m].
        doubted: whether numbers are uncertain that count as exact until the recordings say otherwise.
    """

    name: str
    model: mujoco.MjModel
    wiring: Wiring
    max_timestep: float
    period: float
    cell: LoadCell | None
    pads: PadForces | None
    environment: Mapping[str, Any] | None = None
    file: Path | None = None
    relative: bool = False
    starts: Mapping[str, Start] = field(default_factory=dict)
    known: Mapping[tuple[str, str | None], float] = field(default_factory=dict)
    given: tuple[Entry, ...] = ()
    grids: Mapping[str, float] = field(default_factory=dict)
    effort_row: float | None = None
    largest_effort: tuple[float, ...] = ()
    doubted: bool = False

    @property
    def substeps(self) -> int:
        """Physics steps in a control period."""
        return substeps(self.period, self.max_timestep)

    @property
    def joints(self) -> tuple[str, ...]:
        """Observed joints."""
        return self.wiring.targets.joint

    @property
    def actuators(self) -> tuple[str, ...]:
        """Commanded actuators."""
        return self.wiring.targets.command

    @property
    def sensors(self) -> tuple[str, ...]:
        """Load cells."""
        return self.wiring.targets.sensor


def substeps(period: float, longest: float) -> int:
    """How many physics steps of at most a length make a control period, both in seconds."""
    return math.ceil(period / longest - 1e-6)


def plant_of(
    trials: Sequence[Trial],
    *,
    env: str | None = None,
    model: Path | None = None,
    given: Sequence[Entry] = (),
) -> Plant:
    """The nominal simulator of trials that were recorded on one robot.

    Args:
        trials: all of one robot, interface and rate.
        env: environment id, where the sidecars do not say.
        model: MJCF file, where the sidecars do not say.
        given: effects that are known already; of the sensors, too.

    Raises:
        RecordingError: nothing says which robot, or what is said does not fit the columns; one line.
        ValueError: a given effect has a target that this robot does not have; one line.
    """
    first = trials[0].sidecar
    robot = str(model) if model else env or first.robot
    if not robot:
        raise RecordingError(
            f"{trials[0].source}: nothing says which robot this is: give --env ID or --model FILE.xml, or 'robot' in "
            "the sidecar"
        )
    file = model is not None or robot.endswith(MODELS)
    plant = _plain(trials, Path(robot)) if file else _environment(trials, robot)
    gains = servo_gains(plant.model, plant.wiring, trials)
    given = (*gains.given, *given)
    check_entries(given, plant.model, plant.wiring)
    known = {**uncertainty(plant.model), **gains.known, **known_to(trials)}
    return replace(plant, known=known, given=given, grids=grids(trials, given))


# Environments --------------------------------------------------------------------------------------------------------


def environment_arguments(sidecar: Sidecar) -> dict[str, Any]:
    """Arguments of ``gymnasium.make`` that a sidecar gives."""
    arguments: dict[str, Any] = {}
    if sidecar.rate_hz:
        arguments["control_hz"] = float(sidecar.rate_hz)
    if sidecar.interface in ("velocity", "position"):
        arguments["control"] = sidecar.interface
    servo = sidecar.servo or {}
    if servo.get("name") in scene.SERVOS:
        arguments["servo"] = servo["name"]
    sensing = sidecar.sensing or {}
    wanted = ("scale", "contact_unit", "average", "noise", "bias")
    keys = {key: sensing[key] for key in wanted if sensing.get(key) is not None}
    if keys:
        try:
            arguments["sensing"] = LoadCell(**keys)
        except (TypeError, ValueError) as fault:
            raise RecordingError(f"sensing in the sidecar: {fault}") from fault
    return arguments


def grasp_object(said: Mapping[str, Any] | None) -> tuple[GraspObject | None, float]:
    """Object and offset [m] that a sidecar describes; what it does not say is the default object's."""
    if not said:
        return None, 0.0
    changes: dict[str, Any] = {}
    for key, (name, factor) in KEYS.items():
        if key != "shape" and said.get(key) is not None:
            changes[name] = float(said[key]) * factor
    if said.get("shape") in SHAPES:
        changes["shape"] = said["shape"]
    return GraspObject(**changes), float(said.get("offset_m") or 0.0)


def _environment(trials: Sequence[Trial], robot: str) -> Plant:
    name = robot.removeprefix("tiago_mj/")
    if name not in ENVIRONMENTS:
        known = {value: key for key, value in _BY_ROBOT.items()}
        if robot in known:
            name = known[robot]
        else:
            raise RecordingError(
                f"{trials[0].source}: robot {quoted(robot)} is neither an environment "
                f"({', '.join(ENVIRONMENTS)}) nor an MJCF file: mend 'robot' in the sidecar or give --env or "
                "--model"
            )
    arguments = environment_arguments(trials[0].sidecar)
    replayed = _core(name, arguments).replay_specification()
    starts = {}
    for trial in trials:
        if trial.sidecar.robot != trials[0].sidecar.robot or trial.sidecar.interface != trials[0].sidecar.interface:
            raise RecordingError(
                f"{trial.source}: another robot or interface than {trials[0].source}: diagnose them apart"
            )
        starts[trial.name] = _environment_start(replayed, trial)
    return Plant(
        name=name,
        model=replayed.model,
        wiring=replayed.wiring,
        max_timestep=replayed.model.opt.timestep,
        period=replayed.period,
        cell=replayed.cell,
        pads=replayed.pads,
        environment={"id": f"tiago_mj/{name}", **arguments},
        relative=_relative(trials),
        starts=starts,
    )


_BY_ROBOT: Final = {
    "GripperTactile-v0": "gripper_ta11",
    "TIAGoTactile-v0": "tiago_ta11",
    "TIAGoPALGripper-v0": "tiago_pal_gripper",
}


def _core(name: str, arguments: Mapping[str, Any]) -> Any:
    """The environment behind an id, built with arguments that may not all be its own."""
    try:
        env: Any = gymnasium.make(f"tiago_mj/{name}", disable_env_checker=True, **arguments).unwrapped
    except (TypeError, ValueError) as fault:
        raise RecordingError(f"the sidecar does not fit {name}: {fault}") from fault
    return getattr(env, "core", env)


def _environment_start(replayed: ReplaySpecification, trial: Trial) -> Start:
    item, offset = grasp_object(trial.sidecar.object)
    if replayed.item is None:
        item = None
    elif item is None:
        item, offset = replayed.item, replayed.offset
    return _initial(replayed.model, replayed.wiring, trial, replayed.start_qpos(item, offset), item)


def _relative(trials: Sequence[Trial]) -> bool:
    """Whether commands are changes from the measured position: ``"command_reference": "measured"`` in the sidecars."""
    said = {trial.sidecar.raw.get("command_reference") for trial in trials}
    if len(said) > 1:
        raise RecordingError("some sidecars have a command_reference and others have another: diagnose them apart")
    reference = said.pop()
    if reference not in (None, "measured"):
        raise RecordingError(
            f"{trials[0].source}: command_reference in the sidecar is {quoted(reference)}: write "
            '"measured", or leave it out'
        )
    if reference and trials[0].sidecar.interface != "position":
        raise RecordingError(
            f'{trials[0].source}: commands from the measured position need "interface": "position" in the sidecar'
        )
    return reference is not None


def _initial(model: mujoco.MjModel, wiring: Wiring, trial: Trial, qpos: Array, item: GraspObject | None) -> Start:
    """Start of a trial: what its sidecar says, unless its first measured row says clearly otherwise.

    A reading on a grid says less: of what it leaves open that is nearest to where the servo holds the joint.
    """
    said = trial.sidecar.initial or {}
    qvel = np.zeros(model.nv)
    for k, joint in enumerate(wiring.targets.joint):
        measured = trial.positions.get(joint)
        position = said.get("position", {}).get(joint)
        if measured is not None and np.isfinite(measured).any():
            seen = float(measured[np.isfinite(measured)][0])
            if position is None or abs(seen - position) > STARTS_ELSEWHERE[0 if wiring.targets.slides[k] else 1]:
                position = seen
        if position is not None:
            qpos[wiring.qpos[k]] = position
        qvel[wiring.dof[k]] = said.get("velocity", {}).get(joint, 0.0)
    set_point = qpos[wiring.qpos[list(wiring.targets.actuated)]].copy()
    for k, actuator in enumerate(wiring.targets.command):
        joint = wiring.targets.joint[wiring.targets.actuated[k]]
        value = said.get("set_point", {}).get(joint, said.get("set_point", {}).get(actuator))
        if value is not None:
            set_point[k] = value
            address = wiring.qpos[wiring.targets.actuated[k]]
            read = np.asarray(trial.positions.get(joint, ()))
            around = grid_step(read[np.isfinite(read)], least=2) / 2
            if around and not said.get("velocity", {}).get(joint):  # it rests within half a step of what it reads
                qpos[address] = np.clip(value, qpos[address] - around, qpos[address] + around)
    return Start(qpos, qvel, set_point, item)


def _held(model: mujoco.MjModel, wiring: Wiring, trial: Trial, start: Start) -> Start:
    """With the first commands as what plain position servos held before it, where nothing says what that was and the
    robot stands stiller under them than under its own position: it sags below what it holds."""
    said = (trial.sidecar.initial or {}).get("set_point")
    plain = wiring.servo & (wiring.act < 0)
    if said or wiring.interface != "position" or not plain.any():
        return start
    first = start.set_point.copy()
    for k, name in enumerate(wiring.targets.command):
        sent = trial.commands.get(name)
        known = np.flatnonzero(np.isfinite(sent if sent is not None else np.nan))
        if plain[k] and len(known):
            first[k] = np.asarray(sent)[known[0]]
    data = mujoco.MjData(model)

    def acceleration(points: Array) -> float:
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        data.ctrl[:] = 0.0 if start.idle is None else start.idle
        data.ctrl[wiring.ctrl] = points
        mujoco.mj_forward(model, data)
        return float(np.abs(data.qacc).max())

    return replace(start, set_point=first) if acceleration(first) < acceleration(start.set_point) else start


def _idle(model: mujoco.MjModel, wiring: Wiring, qpos: Array) -> Array:
    """Inputs of actuators that nothing commands, (nu,): a plain position servo holds its joint where it starts, another
    actuator has the first keyframe's input. Of the others it is 0 until their first command."""
    idle = np.array(model.key_ctrl[0]) if model.nkey else np.zeros(model.nu)
    for actuator in range(model.nu):
        address = int(model.actuator_ctrladr[actuator])
        if actuator in wiring.actuators:
            idle[address] = 0.0
        elif driven_joint(model, actuator) and replayed_interfaces(model, actuator)[:1] == ("position",):
            joint = int(model.actuator_trnid[actuator, 0])
            idle[address] = model.actuator_gear[actuator, 0] * qpos[model.jnt_qposadr[joint]]
    return idle


# Plain models --------------------------------------------------------------------------------------------------------


def _plain(trials: Sequence[Trial], path: Path) -> Plant:
    if not is_file(path):
        raise RecordingError(f"no model file {quoted(str(path))}: give --model FILE.xml")
    model = load_model(path, f"{path.name} does not compile", RecordingError)
    if trials[0].sidecar.raw.get("base") == "fixed":
        model = with_held_base(path, RecordingError)
    elif model.body_simple.any():
        model = with_movable_masses(path)
    check_speed(model, path.name, RecordingError)
    robot = Robot.of_model(model)
    for finding in check_names(trials, robot.joints, robot.actuators, ()):
        if finding.refuses:
            raise RecordingError(f"{finding} ({finding.code})")
    commands = dict.fromkeys(name for trial in trials for name in trial.commands)
    measured = dict.fromkeys(name for trial in trials for name in (*trial.positions, *trial.velocities))
    by_command = [model.joint(int(model.actuator_trnid[model.actuator(name).id, 0])).name for name in commands]
    joints = tuple(dict.fromkeys([*(name for name in measured if name in robot.joints), *by_command]))
    interface = trials[0].sidecar.interface or "position"
    try:
        wiring = wire(model, joints=joints, actuators=tuple(commands), interface=interface)
    except ValueError as fault:
        raise RecordingError(f"{trials[0].source}: {fault}") from fault
    base = np.array(model.key_qpos[0] if model.nkey else model.qpos0)
    starts = {}
    for trial in trials:
        start = _initial(model, wiring, trial, base.copy(), None)
        starts[trial.name] = _held(model, wiring, trial, replace(start, idle=_idle(model, wiring, start.qpos)))
    rate = trials[0].sidecar.rate_hz
    period = 1 / rate if rate else float(np.median(np.diff(trials[0].time)))
    return Plant(
        name=path.name,
        model=model,
        wiring=wiring,
        max_timestep=min(model.opt.timestep, PLAIN_TIMESTEP),
        period=period,
        cell=None,
        pads=None,
        file=path.resolve(),
        relative=_relative(trials),
        starts=starts,
    )
