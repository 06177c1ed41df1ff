"""A case: what reality is like, what the user knows of it, and the recordings; all from a seed."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind import effort_sensors, motions, reality, robots, six_joints
from benchmarks.blind.dictionary import ARM, GRIPPER, PLAIN, SIX, draw, kind_of
from benchmarks.blind.effects.base import Effect
from benchmarks.blind.effects.coupled import CoupledMotor
from benchmarks.blind.effects.friction import Bristles, CoulombFriction
from benchmarks.blind.facts import Grid, converters
from tiago_mj.models import names

Array = NDArray[np.float64]

#: Version of generator and drawing; a case of another version is another case.
VERSION: Final = 8
TRIALS: Final = 10
#: Control rates [Hz]: of the real robot's controllers, and of the environments.
RATE: Final = 25.0
FAST_RATE: Final = 240.0
#: Seconds of a trial at each: what is simulated again and again in a diagnosis is kept short.
SECONDS: Final = 6.0
FAST_SECONDS: Final = (1.5, 2.5)
#: A trial of at most so many seconds begins with the fingers near the object, so that it has time to touch [s].
SHORT: Final = 4.0
#: Seconds for which the motions are written [s].
LONG: Final = 10.0
#: Opening there [m]; the object's radius is 20 mm and it may stand 5 mm off the middle.
NEAR: Final = (0.028, 0.034)
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
        setting: ``gripper``, ``arm``, ``plain`` or ``six``.
        interface: ``velocity`` or ``position``.
        offset: of the object, as the user knows it [m].
        effects: none, one or two.
        spread: of the jitter on nominal numbers.
        other_source: whether masses are another publication's.
        placement: deviation of the object's place from trial to trial [m].
        without: effects that are deleted from the library for this case.
        trials, seconds: of the session.
        rate: of control [Hz].
        version: of the generator that drew it.
        grids: converters of its sensors, which the sidecars state.
        narrow: how far joints move in the recordings that are no test trials, over how far they do in those.
        effort: what measures the drives' torques (:mod:`benchmarks.blind.effort_sensors`): recordings then hold these
            instead of commands; "": nothing.
        off_centre: deviation of each coordinate of the links' centres of mass, as a share of the link's reach.
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
    seconds: float = SECONDS
    rate: float = RATE
    version: int = VERSION
    grids: tuple[Grid, ...] = ()
    narrow: float = 1.0
    effort: str = ""
    off_centre: float = 0.0

    @property
    def kind(self) -> str:
        """``none``, ``one``, ``two``, ``outside`` or ``left_out``."""
        if any(not kind_of(effect.name).known for effect in self.effects):
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
#: Nobody jerks an arm of 14 kg [rad/s²].
ARM_ACCELERATION: Final = 2.0
#: The arm moves above the table, where it meets nothing [m].
ARM_RAISED: Final = 0.3


def joints_of(setting: str) -> tuple[str, ...]:
    """Names of a setting's joints."""
    return {GRIPPER: names.FINGERS, ARM: names.TIAGO_JOINTS, PLAIN: ("hinge",), SIX: six_joints.JOINTS}[setting]


def effect_targets(setting: str, name: str, rng: np.random.Generator) -> str | tuple[str, ...]:
    """Targets of an effect: all, or one finger, one cell, one joint of the arm."""
    kind = kind_of(name)
    if kind.on == "none" or setting == PLAIN or name in ("supply_sag", "mount_resonance"):
        return "all"
    if setting in (ARM, SIX):
        joints = names.ARM[:4] if setting == ARM else six_joints.JOINTS
        of_two = issubclass(kind.make, CoupledMotor)  # acts on the joint before as well
        return (str(rng.choice(joints[1:] if of_two else joints)),)
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
        kind = kind_of(choice.name)
        named = names.SIDES if kind.on == "sensor" else joints_of(case.setting)
        columns = list(range(len(named))) if choice.target == "all" else [named.index(t) for t in choice.target]
        made.append(kind.make(choice.parameters, columns, seed=case.seed * 10 + number))
    return made


def measured_with(case: Case, robot: robots.Robot) -> list[Effect]:
    """The case's effects, and the converters of its sensors; where efforts are measured dry friction is dry.

    MuJoCo's own grows with speed at first, up to 0.1 rad/s on a light joint: motion replayed under commands hardly
    shows that, torque along it does.
    """
    effects = [*effects_of(case), *converters(case.grids, robot)]
    if case.effort:
        rubbing = {column for effect in effects if isinstance(effect, Bristles) for column in effect.targets}
        rest = [column for column in range(len(robot.joints)) if column not in rubbing]
        effects.append(CoulombFriction({"force": 0.0}, rest))
    return effects


def real_robot(case: Case, folder: Path | None) -> robots.Robot:
    """The case's robot; the same numbers every time."""
    jitter = robots.Jitter(np.random.default_rng([case.seed, 1]), case.spread, case.off_centre)
    return robots.robot_of(case.setting, jitter, folder=folder, other_source=case.other_source, fine=True)


def simulate(case: Case, folder: Path | None = None) -> Made:
    """Run a case.

    Args:
        case: what to run.
        folder: where the plain model lies.
    """
    robot = real_robot(case, folder)
    setup = setup_of(case, robot, case.trials, round(case.seconds * case.rate), case.seed)
    n, pace = len(robot.joints), case.seconds / LONG
    if case.setting == GRIPPER:
        if case.seconds <= SHORT:
            near = np.random.default_rng([case.seed, 9]).uniform(*NEAR, case.trials)
            setup = replace(setup, start=np.tile(near[:, None], (1, n)))
        styles = [motions.Style(pace=pace, start=float(at)) for at in setup.start[:, 0]]
        programs = motions.finger_programs(case.trials, case.seed, styles)
    else:
        moving = [robot.joints.index(j) for j in ARM_JOINTS] if case.setting == ARM else list(range(n))
        reach, fastest = reach_and_speed(robot, case.setting)
        programs = [
            motions.joint_program(
                np.random.default_rng([case.seed, 8, k]),
                robot,
                moving,
                reach if k in TEST else case.narrow * reach,
                fastest,
                pace,
            )
            for k in range(case.trials)
        ]
    smooth = {ARM: ARM_ACCELERATION, SIX: six_joints.ACCELERATION}.get(case.setting)
    conductor = motions.Conductor(programs, robot, setup.interface, setup.start, 1 / case.rate, smooth)
    recorded = reality.simulate(robot, measured_with(case, robot), setup, conductor)
    return Made(case, robot, recorded, setup, dict(robot.truth), folder)


def play(case: Case, commands: Array, repeats: int, folder: Path | None = None) -> Made:
    """The same reality moves again: given commands (rows, n), a few times."""
    robot = real_robot(case, folder)
    setup = setup_of(case, robot, repeats, len(commands), case.seed + 1)
    recorded = reality.simulate(robot, measured_with(case, robot), setup, np.tile(commands, (repeats, 1, 1)))
    return Made(case, robot, recorded, setup, dict(robot.truth), folder)


def setup_of(case: Case, robot: robots.Robot, trials: int, rows: int, seed: int) -> reality.Setup:
    """How trials of a case begin.

    Where efforts are measured, servos go from one set point to the next in a straight line, as drives do: after a jump
    the torque falls until the next, and what is read at its end would look like less damping.
    """
    start = np.tile(robot.start[robot.qpos], (trials, 1))
    if case.setting == ARM:
        start[:, robot.joints.index(names.TORSO[0])] = ARM_RAISED
    return reality.Setup(
        interface="direct" if case.setting in robots.MODELS and not case.effort else case.interface,
        rate=case.rate,
        rows=rows,
        offsets=case.offset + case.placement * np.random.default_rng([seed, 2]).standard_normal(trials),
        start=start,
        noise_seed=seed,
        effort=effort_sensors.sensor(case.effort, case.seed, robot) if case.effort else None,
    )


def reach_and_speed(robot: robots.Robot, setting: str) -> tuple[Array, Array]:
    """How far joints move to either side of their start [m, rad], and how fast [m/s, rad/s]; (n,) each."""
    n = len(robot.joints)
    if setting == PLAIN:
        return np.full(n, 1.2), np.full(n, 2.5)
    if setting == SIX:
        return np.full(n, six_joints.REACH), np.full(n, six_joints.FASTEST)
    torso = np.isin(robot.joints, names.TORSO)
    start = robot.start[robot.qpos]
    room = np.minimum(start - robot.low, robot.high - start)
    reach = np.where(torso, 0.0, np.minimum(ARM_REACH, np.maximum(room - 0.02, 0.01)))
    return reach, np.where(torso, 0.05, ARM_FASTEST)


ARM_ENVIRONMENT: Final = "tiago_mj/TIAGoTactile-v0"
