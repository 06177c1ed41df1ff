"""A hidden effect, found again: one is drawn, grasps are recorded with it, the diagnosis is given the recordings alone.

Its answer is then compared with the truth, in numbers and in a film of the measured, nominal and repaired grasp.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from tiago_mj.effects import EFFECTS
from tiago_mj.envs.flat import core_of
from tiago_mj.gap.pipeline import diagnose
from tiago_mj.gap.report import write
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.io import extra
from tiago_mj.io.deadline import Deadline
from tiago_mj.recordings import lint
from tiago_mj.recordings.record.environment import Plan, record
from tiago_mj.rollout.policies import make_policy
from tiago_mj.view import colours, drawing
from tiago_mj.view.film import Film
from tiago_mj.view.stage import well_seen

Array = NDArray[np.float64]
Frame = NDArray[np.uint8]

ENV: Final = "tiago_mj/GripperTactile-v0"
#: What may be hidden, and the ends between which its magnitude is drawn (log-uniform; units as declared).
HIDDEN: Final[Mapping[str, tuple[str, float, float]]] = {
    "coulomb_friction": ("force", 2.0, 4.0),
    "command_delay": ("seconds", 0.02, 0.04),
    "backlash": ("width", 0.0015, 0.004),
    "viscous_friction": ("damping", 30.0, 60.0),
}
#: Grasps that are recorded, and seconds after which the diagnosis tells the best so far: all of the demonstration is to
#: be over in 90 s on two processors.
EPISODES: Final = 4
BUDGET: Final = 50.0
#: Width and height of the two films [pixel], seen from before and above, along the fingers' way; of
#: the snapshots that were taken every second one is drawn.
FRAME: Final = (480, 264)
CAMERA: Final = drawing.Camera((0.638, 0.0, 0.62), 0.27, 180, -58)
EVERY: Final = 2
#: A robot of so many metres has differences that are drawn up to :data:`tiago_mj.view.stage.WELL_SEEN` of it.
SIZE: Final = 0.25
ROLES: Final = ("measured", "nominal", "repaired")
#: Load cell and joint whose signals are drawn.
SHOWN: Final = ("force.right", "position.gripper_right_finger_joint")


@dataclass(frozen=True)
class Answer:
    """Hidden effect, the answer of the diagnosis, and a film of both.

    Attributes:
        name, parameter, unit: of what was hidden.
        truth: its magnitude.
        diagnosis: the whole answer (:class:`tiago_mj.gap.result.Diagnosis`).
        folder: of its report.
        films: of the same commands in the three simulators, by role; empty where nothing could be rendered.
    """

    name: str
    parameter: str
    unit: str
    truth: float
    diagnosis: Any
    folder: Path
    films: Mapping[str, Film] = field(default_factory=dict)

    @property
    def right(self) -> bool:
        """Whether the best explanation is the effect, or one of its class."""
        said = {EFFECTS[effect.name].gap_class for effect in self.diagnosis.best.effects}
        return said == {EFFECTS[self.name].gap_class}

    @property
    def larger(self) -> int:
        """How many times larger than they are the film draws the simulators' distances from the robot."""
        return well_seen(SIZE, float(self._distances().max()))

    @property
    def departure(self) -> int:
        """Snapshot with which the film begins: there the nominal simulator is half as far from the robot as it gets."""
        away = self._distances()
        return int(np.argmax(away >= away.max() / 2))

    def _distances(self) -> Array:
        """Largest distance of a joint of the nominal simulator from the robot, a row for each snapshot, (n,) [m]."""
        measured, nominal = (np.array([one.qpos for one in self.films[role].snapshots]) for role in ROLES[:2])
        joints = list(core_of(self.films["measured"].env).wiring().qpos)
        return np.abs(nominal - measured)[:, joints].max(axis=1)

    @property
    def value(self) -> tuple[float, float, float] | None:
        """Estimated magnitude and its 90 % interval; None where another effect was named."""
        for effect in self.diagnosis.best.effects:
            if effect.name == self.name:
                found = effect.parameters[self.parameter]
                return found.value, found.low, found.high
        return None


def draw(seed: int) -> tuple[str, str, float]:
    """Draw the effect to hide: name, parameter and magnitude."""
    rng = np.random.default_rng([seed, len(HIDDEN)])
    name = list(HIDDEN)[seed % len(HIDDEN)]
    parameter, low, high = HIDDEN[name]
    return name, parameter, float(np.exp(rng.uniform(np.log(low), np.log(high))))


def find(seed: int, folder: Path, tick: Callable[..., None]) -> Answer:
    """Hide an effect, record grasps, diagnose them, write the report.

    Args:
        seed: of what is hidden, and of the grasps.
        folder: for ``report.html`` and its numbers.
        tick: told how far it is, as :func:`tiago_mj.gap.pipeline.diagnose` does.

    Raises:
        ModuleNotFoundError: the extra ``gap`` is not installed; says how to.
    """
    extra.load("pandas", "the diagnosis")
    limits = extra.load("threadpoolctl", "the diagnosis").threadpool_limits

    name, parameter, truth = draw(seed)
    plan = Plan(ENV, {}, {name: {parameter: truth}}, None, "pi")
    policy = partial(make_policy, "pi", seed=seed, trust=False)
    trials = list(record(plan, policy, episodes=EPISODES, seed=100 * seed))
    findings = lint.inspect_all(trials, plant_of(trials))
    with limits(1):
        found = diagnose(
            trials,
            findings=findings,
            usable=lint.believed(trials, findings),
            seed=seed,
            deadline=Deadline(BUDGET),
            tick=tick,
        )
    write(found, folder)
    test = found.splits["test"][0]
    commands = next(trial.commands for trial in trials if trial.name == test)
    films = _filmed(plan.effects, folder / "calibration.yaml", commands, int(test.rpartition("-")[2]))
    return Answer(name, parameter, EFFECTS[name].parameters[parameter].unit[0], truth, found, folder, films)


def _filmed(hidden: Any, calibration: Path, commands: Mapping[str, Array], seed: int) -> dict[str, Film]:
    """Films of one grasp: measured, by the nominal and by the repaired simulator."""
    films: dict[str, Film] = {}
    for role, effects in zip(ROLES, (hidden, None, str(calibration)), strict=True):
        width, height = FRAME
        env = gymnasium.make(ENV, render_mode="rgb_array", width=width, height=height, effects=effects)
        try:
            films[role] = _replayed(env, commands, seed)
        except gymnasium.error.DependencyNotInstalled:
            return {}
        finally:
            env.close()
    return films


def _replayed(env: gymnasium.Env[Any, Any], commands: Mapping[str, Array], seed: int) -> Film:
    core: Any = core_of(env)
    film = Film(env)
    film.check()
    env.reset(seed=seed)
    film(0)
    sent = np.stack([commands[name] for name in core.joints], axis=1)[:-1]
    for step, command in enumerate(sent, 1):
        env.step(np.clip(command / core.velocity_limit, -1.0, 1.0))
        film(step)
    return film


def haunted_films(answer: Answer, done: Callable[[int], None] = lambda frames: None) -> dict[str, list[Frame]]:
    """Frames of the robot with the ghost of its simulator, each (height, width, 3): of the nominal
    simulator, and of the repaired one."""
    model, larger, first = core_of(answer.films["measured"].env).model, answer.larger, answer.departure
    films: dict[str, list[Frame]] = {}
    for role in ROLES[1:]:
        pairs = zip(answer.films["measured"].snapshots, answer.films[role].snapshots, strict=True)
        shown = [haunted(robot, simulated, role, larger) for robot, simulated in list(pairs)[first::EVERY]]
        told = partial(_further, done, len(shown) * len(films))
        films[role] = drawing.draw(model, shown, size=FRAME, camera=CAMERA, processes=None, done=told)
    return films


def haunted(robot: drawing.Snapshot, simulated: drawing.Snapshot, role: str, larger: int) -> drawing.Snapshot:
    """Snapshot of the robot with the ghost of a simulator, whose distance is drawn larger than it is; the caption has
    the force on the right pad in both."""
    qpos = robot.qpos + larger * (simulated.qpos - robot.qpos)
    here, there = (max(one.forces[0].newtons, 0.0) + 0.0 for one in (robot, simulated))
    caption = f"robot {here:.1f} N      {role} simulator {there:.1f} N"
    return replace(robot, caption=caption, ghost=drawing.Ghost(qpos, colours.LOOKS[role].colour))


def _further(done: Callable[[int], None], before: int, frames: int) -> None:
    done(before + frames)
