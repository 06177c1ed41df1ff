"""A hidden effect, found again: one is drawn, grasps are recorded with it, the diagnosis is given the recordings alone.

Its answer is then compared with the truth, in numbers and in a film of the measured, nominal and repaired grasp.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
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
from tiago_mj.view.film import Film

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
#: Width and height of each of the film's three pictures [pixel].
FRAME: Final = (320, 288)
PANES: Final = ("measured", "nominal", "repaired")
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
        panes: films of the same commands in the three simulators, by name; empty where nothing could be rendered.
    """

    name: str
    parameter: str
    unit: str
    truth: float
    diagnosis: Any
    folder: Path
    panes: Mapping[str, Film] = field(default_factory=dict)

    @property
    def right(self) -> bool:
        """Whether the best explanation is the effect, or one of its class."""
        said = {EFFECTS[effect.name].gap_class for effect in self.diagnosis.best.effects}
        return said == {EFFECTS[self.name].gap_class}

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
    panes = _filmed(plan.effects, folder / "calibration.yaml", commands, int(test.rpartition("-")[2]))
    return Answer(name, parameter, EFFECTS[name].parameters[parameter].unit[0], truth, found, folder, panes)


def _filmed(hidden: Any, calibration: Path, commands: Mapping[str, Array], seed: int) -> dict[str, Film]:
    """Films of one grasp: measured, by the nominal and by the repaired simulator."""
    panes: dict[str, Film] = {}
    for pane, effects in zip(PANES, (hidden, None, str(calibration)), strict=True):
        width, height = FRAME
        env = gymnasium.make(ENV, render_mode="rgb_array", width=width, height=height, effects=effects)
        try:
            film = _replayed(env, pane, commands, seed)
        except gymnasium.error.DependencyNotInstalled:
            return {}
        finally:
            env.close()
        panes[pane] = film
    return panes


def _replayed(env: gymnasium.Env[Any, Any], pane: str, commands: Mapping[str, Array], seed: int) -> Film:
    core: Any = core_of(env)

    def caption(time: float) -> str:
        right, left = np.maximum(core.state.force_contact, 0.0)
        return f"{pane}   {right:4.1f} N  {left:4.1f} N"

    film = Film(env, caption)
    film.check()
    env.reset(seed=seed)
    film(0)
    sent = np.stack([commands[name] for name in core.joints], axis=1)[:-1]
    for step, command in enumerate(sent, 1):
        env.step(np.clip(command / core.velocity_limit, -1.0, 1.0))
        film(step)
    return film


def side_by_side(answer: Answer, done: Callable[[int], None] = lambda frames: None) -> list[Frame]:
    """Frames of the film with its three pictures in a row, each (height, 3 · width, 3)."""
    drawn = 0
    panes: list[Sequence[Frame]] = []
    for pane in PANES:
        panes.append(answer.panes[pane].draw(processes=None, done=partial(_further, done, drawn)))
        drawn += len(panes[-1])
    return [np.concatenate(row, axis=1) for row in zip(*panes, strict=True)]


def _further(done: Callable[[int], None], before: int, frames: int) -> None:
    done(before + frames)
