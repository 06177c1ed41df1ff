"""A case: what reality is like, what the user knows of it, and the recordings; all from a seed."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from benchmarks.blind import motions, reality, robots
from benchmarks.blind.dictionary import ARM, GRIPPER, KINDS, PLAIN, draw
from benchmarks.blind.effects.base import Effect
from tiago_mj.models import names

Array = NDArray[np.float64]

#: Version of generator and drawing; a case of another version is another case.
VERSION: Final = 1
TRIALS: Final = 10
RATE: Final = 25.0
#: Every this many trials the last is a test trial, from the end: what the oracle looks at. The diagnosis splits as it
#: likes; a trial is exchangeable with any other.
TEST: Final = (4, 9)


@dataclass(frozen=True)
class EffectChoice:
    """An effect of a case: contract name, targets by name (``"all"`` for every one), parameters."""

    name: str
    target: str | tuple[str, ...]
    parameters: dict[str, float]


@dataclass(frozen=True)
class Case:
    """Everything that decides a case's recordings.

    Attributes:
        seed: of everything drawn.
        setting: ``gripper``, ``arm`` or ``plain``.
        interface: ``velocity`` or ``position``.
        offset: of the object, as the user knows it [m].
        effects: none, one or two.
        spread: of the jitter on nominal numbers.
        other_source: whether masses are another publication's.
        placement: deviation of the object's place from trial to trial [m].
        without: effects that are deleted from the library for this case.
        trials, seconds: of the session.
    """

    seed: int
    setting: str = GRIPPER
    interface: str = "velocity"
    offset: float = 0.0
    effects: tuple[EffectChoice, ...] = ()
    spread: float = 0.04
    other_source: bool = False
    placement: float = 2e-4
    without: tuple[str, ...] = ()
    trials: int = TRIALS
    seconds: float = 10.0

    @property
    def kind(self) -> str:
        """``none``, ``one``, ``two``, ``outside`` or ``left_out``."""
        if any(not KINDS[effect.name].known for effect in self.effects):
            return "outside"
        if self.without:
            return "left_out"
        return ("none", "one", "two")[len(self.effects)]


@dataclass
class Made:
    """A simulated case: its recordings and what only the label may know."""

    case: Case
    robot: robots.Robot
    recorded: reality.Recorded
    setup: reality.Setup
    truth: dict[str, Any] = field(default_factory=dict)
    folder: Path | None = None
    servo: str = "pal"


ARM_JOINTS: Final = (*names.TORSO, *names.ARM[:4])
#: How far the arm's joints move from where they start, and how fast [m, rad; per s].
ARM_REACH: Final = 0.15
ARM_FASTEST: Final = 0.5
#: The arm moves above the table, where it meets nothing [m].
ARM_RAISED: Final = 0.3


def joints_of(setting: str) -> tuple[str, ...]:
    """Names of a setting's joints."""
    return {GRIPPER: names.FINGERS, ARM: names.TIAGO_JOINTS, PLAIN: ("hinge",)}[setting]


def effect_targets(setting: str, name: str, rng: np.random.Generator) -> str | tuple[str, ...]:
    """Targets of an effect: all, or one finger, one cell, one joint of the arm."""
    kind = KINDS[name]
    if kind.on == "none" or setting == PLAIN or name in ("supply_sag", "mount_resonance"):
        return "all"
    if setting == ARM:
        return (str(rng.choice(names.ARM[:4])),)
    if rng.random() < 0.6:
        return "all"
    return (str(rng.choice(names.SIDES if kind.on == "sensor" else names.FINGERS)),)


def choose(setting: str, name: str, rng: np.random.Generator) -> EffectChoice:
    """Draw an effect's targets and parameters."""
    return EffectChoice(name, effect_targets(setting, name, rng), draw(name, setting, rng))


def effects_of(case: Case) -> list[Effect]:
    """The case's effects, ready to run."""
    made = []
    for number, choice in enumerate(case.effects):
        kind = KINDS[choice.name]
        named = names.SIDES if kind.on == "sensor" else joints_of(case.setting)
        columns = list(range(len(named))) if choice.target == "all" else [named.index(t) for t in choice.target]
        made.append(kind.make(choice.parameters, columns, seed=case.seed * 10 + number))
    return made


def real_robot(case: Case, folder: Path | None) -> robots.Robot:
    """The case's robot; the same numbers every time."""
    jitter = robots.Jitter(np.random.default_rng([case.seed, 1]), case.spread)
    return robots.robot_of(case.setting, jitter, folder=folder, other_source=case.other_source)


def simulate(case: Case, folder: Path | None = None) -> Made:
    """Run a case.

    Args:
        case: what to run.
        folder: where the plain model lies.
    """
    robot = real_robot(case, folder)
    rng = np.random.default_rng([case.seed, 2])
    n = len(robot.joints)
    start = np.tile(robot.start[robot.qpos], (case.trials, 1))
    if case.setting == ARM:
        start[:, robot.joints.index(names.TORSO[0])] = ARM_RAISED
    offsets = case.offset + case.placement * rng.standard_normal(case.trials)
    interface = "direct" if case.setting == PLAIN else case.interface
    setup = reality.Setup(
        interface=interface,
        rate=RATE,
        rows=int(case.seconds * RATE),
        offsets=offsets,
        start=start,
        noise_seed=case.seed,
    )
    if case.setting == GRIPPER:
        programs = motions.finger_programs(case.trials, case.seed)
    else:
        moving = list(range(n)) if case.setting == PLAIN else [robot.joints.index(j) for j in ARM_JOINTS]
        reach, fastest = _limits(robot, case.setting)
        programs = [
            motions.joint_program(np.random.default_rng([case.seed, 8, k]), robot, moving, reach, fastest)
            for k in range(case.trials)
        ]
    conductor = motions.Conductor(programs, robot, interface, start, 1 / RATE)
    recorded = reality.simulate(robot, effects_of(case), setup, conductor)
    return Made(case, robot, recorded, setup, dict(robot.truth), folder)


def _limits(robot: robots.Robot, setting: str) -> tuple[Array, Array]:
    n = len(robot.joints)
    if setting == PLAIN:
        return np.full(n, 1.2), np.full(n, 4.0)
    torso = np.isin(robot.joints, names.TORSO)
    start = robot.start[robot.qpos]
    room = np.minimum(start - robot.low, robot.high - start)
    reach = np.where(torso, 0.0, np.minimum(ARM_REACH, np.maximum(room - 0.02, 0.01)))
    return reach, np.where(torso, 0.05, ARM_FASTEST)


# Files ---------------------------------------------------------------------------------------------------------------


def write(made: Made, folder: Path) -> None:
    """Write the recordings; nothing in them is more than a user would know."""
    folder.mkdir(parents=True, exist_ok=True)
    case, recorded, robot = made.case, made.recorded, made.robot
    if case.setting == PLAIN:
        (folder / robots.PLAIN_FILE).write_text(robots.PLAIN)
    for k in range(len(recorded.time)):
        name = f"trial-{k:02d}"
        columns = {"time": recorded.time[k]}
        for kind, values in (
            ("command", recorded.commands),
            ("position", recorded.position),
            ("velocity", recorded.velocity),
        ):
            columns.update({f"{kind}.{joint}": values[k, :, j] for j, joint in enumerate(robot.joints)})
        if robot.pads is not None:
            columns.update({f"force.{side}": recorded.force[k, :, s] for s, side in enumerate(names.SIDES)})
        table = pa.table({key: pa.array(values, from_pandas=True) for key, values in columns.items()})
        pq.write_table(table, folder / f"{name}.parquet", compression="zstd")
        (folder / f"{name}.json").write_text(json.dumps(sidecar(made, name, k), indent=1) + "\n")


def sidecar(made: Made, name: str, k: int) -> dict[str, Any]:
    """What a user knows of a trial."""
    case, robot = made.case, made.robot
    initial = dict(zip(robot.joints, made.setup.start[k].tolist(), strict=True))
    out: dict[str, Any] = {
        "schema": "tiago_mj.recording/1",
        "trial": name,
        "robot": {GRIPPER: "tiago_mj/GripperTactile-v0", ARM: ARM_ENVIRONMENT, PLAIN: robots.PLAIN_FILE}[case.setting],
        "rate_hz": made.setup.rate,
        "interface": "position" if case.setting == PLAIN else case.interface,
        "initial": {"position": initial, "set_point": initial},
        "source": {"tool": "benchmarks/blind", "version": VERSION},
    }
    if case.setting != PLAIN:
        out["servo"] = {"name": made.servo}
    if case.setting == GRIPPER:
        thing = robots.nominal_object()
        out["sensing"] = {"scale": 100.0, "contact_unit": 100 * 2000 / 330, "average": 1}
        out["object"] = {
            "shape": thing.shape,
            "radius_m": thing.width / 2,
            "height_m": thing.height,
            "mass_kg": thing.mass,
            "stiffness": thing.stiffness,
            "damping": thing.damping,
            "friction": thing.friction,
            "offset_m": case.offset,
        }
    return out


ARM_ENVIRONMENT: Final = "tiago_mj/TIAGoTactile-v0"


def label(made: Made) -> dict[str, Any]:
    """The truth, as far as the case alone says it; the oracle adds its part."""
    case = made.case
    out = asdict(case)
    out["kind"] = case.kind
    out["classes"] = [KINDS[effect.name].group for effect in case.effects]
    out["truth"] = made.truth
    if case.effects:
        out["effective"] = effective(made)
    return out


def effective(made: Made) -> dict[str, float]:
    """Parameters of a single effect as they stand against the *nominal* numbers, which is all that can be measured.

    A servo 4 % stiffer than its data sheet with an effect of 0.8 is one of 0.832; where nominal numbers and effect do
    not mix, the parameter is the drawn one and is not listed.
    """
    case = made.case
    if len(case.effects) != 1:
        return {}
    choice = case.effects[0]
    real = real_robot(case, made.folder)
    nominal = robots.robot_of(case.setting, robots.Jitter(np.random.default_rng(0), 0.0), folder=made.folder)
    named = names.SIDES if KINDS[choice.name].on == "sensor" else real.joints
    columns = list(range(len(named))) if choice.target == "all" else [named.index(t) for t in choice.target]
    value = next(iter(choice.parameters.values()))
    first = next(iter(choice.parameters))

    def factor(a: Any, b: Any) -> dict[str, float]:
        return {first: value * float(np.mean(np.asarray(a) / np.asarray(b)))}

    def added(a: Any, b: Any) -> dict[str, float]:
        return {first: value + float(np.mean(np.asarray(a) - np.asarray(b)))}

    name = choice.name
    if name in ("servo_stiffness", "torque_constant"):
        return factor(real.stiffness[columns], nominal.stiffness[columns])
    if name == "servo_damping":
        return added(real.damping[columns], nominal.damping[columns])
    if name == "viscous_friction":
        dof = real.dof[columns]
        return added(real.model.dof_damping[dof], nominal.model.dof_damping[dof])
    if name == "coulomb_friction":
        dof = real.dof[columns]
        return added(real.model.dof_frictionloss[dof], nominal.model.dof_frictionloss[dof])
    if name == "force_gain":
        return factor(real.units[columns], nominal.units[columns])
    if real.item is None or nominal.item is None:
        return {}
    if name in ("contact_stiffness", "contact_damping", "contact_friction"):
        field_name = name.removeprefix("contact_")
        return factor(getattr(real.item, field_name), getattr(nominal.item, field_name))
    if name == "object_mass":
        return factor(real.item.mass, nominal.item.mass)
    if name == "object_size":
        return added(real.item.width / 2, nominal.item.width / 2)
    if name == "object_offset":
        return added(made.setup.offsets, case.offset)
    return {}
