"""What a diagnosis is asked, and what is known while it runs."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

import tiago_mj
from tiago_mj.effects import EFFECTS, Entry
from tiago_mj.gap.ahead import Ahead, Listener
from tiago_mj.gap.inference.noise_model import Usable
from tiago_mj.gap.inference.predictor import REPEATED
from tiago_mj.gap.result import Diagnosis, Place, Stopped, TrialModels
from tiago_mj.gap.search.select import PartialResult
from tiago_mj.gap.simulation.session import Session
from tiago_mj.io.deadline import Deadline
from tiago_mj.io.journal import Journal, digest
from tiago_mj.recordings.recording import KINDS, Finding


@dataclass(frozen=True, kw_only=True)
class Request:
    """What is asked of recordings.

    Attributes:
        findings: of the lint, for the report.
        usable: channels that the lint trusts, of all trials or by their sources; None for all.
        env, model: what to simulate where the recordings do not say.
        names: effects to consider; None for the whole library.
        given: effects that are known already: part of the nominal simulator, and of what is found beside them.
        seed: of effects that draw at random and of the bootstrap.
        threads: of the simulations; the answer does not depend on it.
        deadline: by which there is an answer, what was found until then.
        policy: ``pi`` or a file, whose return the nominal and the repaired simulator predict; None: not asked.
        trust: load that file although loading runs code that it holds.
        tick: told how far it is.
        command: the command line that asks, for the page.
        journal: file in which finished work is kept until the answer is whole; None: nowhere.
        resume: go on with what is there, as an earlier run that did not come to its end left it.
        numbers: whether the repair has the nominal model's numbers as fitted, as far as validation trials confirm them.
    """

    findings: Sequence[Finding] = ()
    usable: Usable | None = None
    env: str | None = None
    model: Path | None = None
    names: Sequence[str] | None = None
    given: Sequence[Entry] = ()
    seed: int = 0
    threads: int = 0
    deadline: Deadline = field(default_factory=Deadline)
    policy: str | None = None
    trust: bool = False
    tick: Listener = lambda stage, done, left: None
    command: str = ""
    journal: Path | None = None
    resume: bool = False
    numbers: bool = True


def begun_with(session: Session, asked: Request) -> dict[str, str]:
    """What finished work of a diagnosis depends on, by what a user calls it: the version, and digests."""
    trials, plant = session.trials, session.plant
    recorded = [
        (t.name, t.time, *(getattr(t, kind) for kind in KINDS.values()), replace(t.sidecar, robot="", raw={}))
        for t in trials
    ]
    model = np.zeros(mujoco.mj_sizeModel(plant.model), np.uint8)
    mujoco.mj_saveModel(plant.model, None, model)
    return {
        "version": tiago_mj.__version__,
        "recordings": digest((recorded, asked.usable)),
        "model": digest((model, plant.max_timestep, plant.period)),
        "options": digest((tuple(asked.names or EFFECTS), plant.given, asked.seed)),
    }


@dataclass
class Needs:
    """Seconds that the whole diagnosis takes at most: by the limit of physics steps of its search, at the pace so far.

    Attributes:
        deadline: whose seconds count.
        tally: of simulations, ``physics_steps`` among them.
        budget: physics steps after which the search ends.
        step: seconds of one before the search began.
        few: steps of the search from which on its own pace counts.
        reserve: seconds of what follows the search.
    """

    deadline: Deadline
    tally: Counter[str]
    budget: float
    step: float
    few: int
    reserve: float

    def __post_init__(self) -> None:
        self.began, self.already = self.deadline.spent(), self.tally["physics_steps"]

    def __call__(self) -> float:
        """Of the whole, given what was done."""
        spent, done = self.deadline.spent(), self.tally["physics_steps"] - self.already
        step = (spent - self.began) / done if done > self.few else self.step
        return max(self.began + step * (self.budget - self.already) + self.reserve, spent)


@dataclass
class SoFar:
    """What is known while a diagnosis runs: the answer where it ends early.

    Attributes:
        tick: told what begins.
        where: the gap of the nominal model.
        search: what the search has found.
        needs: given what was done, how many seconds the whole takes at most; None where nothing tells.
        tally: of simulations (:class:`tiago_mj.gap.inference.predictor.Predictor`).
        warned: MuJoCo's warnings of models that were tried, which are not the user's, by kind.
        answer: the whole, as soon as there is one.
        journal: of finished work.
        begun: when it began [s, of the clock].
    """

    tick: Ahead
    where: tuple[Place, ...] = ()
    search: PartialResult = field(default_factory=PartialResult)
    needs: Callable[[], float | None] = lambda: None
    tally: Counter[str] = field(default_factory=Counter)
    warned: Counter[str] = field(default_factory=Counter)
    answer: Diagnosis | None = None
    journal: Journal = field(default_factory=Journal)
    begun: float = field(default_factory=time.monotonic)

    def timed(self, found: Diagnosis) -> Diagnosis:
        """A diagnosis with what it took."""
        return replace(found, trial_models=self.trial_models, seconds=time.monotonic() - self.begun)

    @property
    def trial_models(self) -> TrialModels | None:
        """How the simulations went; None: there was none."""
        count = self.tally
        simulated = count["simulations"] - count[REPEATED["simulations"]]
        known = TrialModels(simulated, count["diverged"], dict(sorted(self.warned.items())))
        return known if count else None

    def stopped(self, ended: BaseException | None, seconds: float) -> Stopped:
        """How far it was when something ended it; None: the time."""
        found = Stopped.by(ended, seconds)
        return replace(found, tried=len(self.search.tried), effects=self.search.effects, needs=self.needs())
