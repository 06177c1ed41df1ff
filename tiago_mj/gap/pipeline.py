"""The diagnosis: recordings in, verdict out. Each stage is a function of the ones before."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import tiago_mj
from tiago_mj.effects import Entry
from tiago_mj.gap.ahead import Ahead, AheadInTime, Listener
from tiago_mj.gap.analysis import locate, task
from tiago_mj.gap.conclusion import concluded, provisional, simulations, unanswered
from tiago_mj.gap.detectors.proposals import proposals
from tiago_mj.gap.inference import hypotheses, noise_model
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.report.consistency import checked
from tiago_mj.gap.report.repaired import with_model
from tiago_mj.gap.result import Diagnosis, Place, Stopped, TrialModels
from tiago_mj.gap.search import select
from tiago_mj.gap.search.state import Question
from tiago_mj.gap.simulation import phases, replay, sizes
from tiago_mj.gap.simulation.along_a_motion import along_a_motion, efforts_along
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.gap.simulation.session import session as session_of
from tiago_mj.gap.torque import diagnose_inverse
from tiago_mj.io import mujoco_log
from tiago_mj.io.deadline import Deadline, OutOfTimeError
from tiago_mj.recordings.recording import Finding, Trial


def diagnose(
    trials: Sequence[Trial],
    *,
    findings: Sequence[Finding] = (),
    usable: noise_model.Usable | None = None,
    env: str | None = None,
    model: Path | None = None,
    names: Sequence[str] | None = None,
    given: Sequence[Entry] = (),
    seed: int = 0,
    threads: int = 0,
    deadline: Deadline | None = None,
    policy: str | None = None,
    trust: bool = False,
    tick: Listener = lambda stage, done, left: None,
) -> Diagnosis:
    """Diagnose recordings of commands and what was measured.

    Args:
        trials: of one robot.
        findings: of the lint, for the report.
        usable: channels that the lint trusts, of all trials or by their sources; None for all.
        env, model: what to simulate where the recordings do not say.
        names: effects to consider; None for the whole library.
        given: effects that are known already: part of the nominal simulator, and of what is found beside them.
        seed: of effects that draw at random and of the bootstrap.
        threads: of the simulations; the answer does not depend on it.
        deadline: by which there is an answer, what was found until then; None: there is none.
        policy: ``pi`` or a file, whose return the nominal and the repaired simulator predict; None: not asked.
        trust: load that file although loading runs what it holds.
        tick: told how far it is.

    Raises:
        RecordingError: the recordings hold nothing that can be compared; one line.
    """
    asked = Request(
        tuple(findings),
        usable,
        env,
        model,
        names,
        tuple(given),
        seed,
        threads,
        deadline or Deadline(),
        policy,
        trust,
        Ahead(tick),
    )
    with mujoco_log.counted() as warned:
        found = _diagnosed(trials, asked)
    return checked(replace(found, notes=(*found.notes, *mujoco_log.sentences(warned))))


@dataclass(frozen=True)
class Request:
    """What :func:`diagnose` was asked, apart from the recordings; fields as its arguments."""

    findings: tuple[Finding, ...]
    usable: noise_model.Usable | None
    env: str | None
    model: Path | None
    names: Sequence[str] | None
    given: tuple[Entry, ...]
    seed: int
    threads: int
    deadline: Deadline
    policy: str | None
    trust: bool
    tick: Ahead


@dataclass
class _SoFar:
    """What is known while a diagnosis runs: the answer where it ends early.

    Attributes:
        where: the gap of the nominal model.
        search: what the search has found.
        needs: given what was done, how many seconds the whole takes at most; None where nothing tells.
        tally: of simulations (:class:`tiago_mj.gap.inference.predictor.Predictor`).
        warned: MuJoCo's warnings of models that were tried, which are not the user's, by kind.
    """

    where: tuple[Place, ...] = ()
    search: select.PartialResult = field(default_factory=select.PartialResult)
    needs: Callable[[], float | None] = lambda: None
    tally: Counter[str] = field(default_factory=Counter)
    warned: Counter[str] = field(default_factory=Counter)

    def trial_models(self) -> TrialModels | None:
        """How the simulations went; None: there was none."""
        if not self.tally:
            return None
        return TrialModels(self.tally["simulations"], self.tally["diverged"], dict(sorted(self.warned.items())))


def _diagnosed(trials: Sequence[Trial], asked: Request) -> Diagnosis:
    """Read, replay, look at the readings, search, decide, try on the trials kept aside, tell."""
    begun = time.monotonic()
    session = session_of(trials, env=asked.env, model=asked.model, given=asked.given)
    question = _question(session, asked)
    so_far = _SoFar()
    try:
        explain = _along_the_motion if along_a_motion(session.plant, session.trials) else _forward
        found = explain(session, asked, so_far)
    except (OutOfTimeError, KeyboardInterrupt) as end:
        found = unanswered(session, so_far.where, so_far.search.ranked, end, asked.seed)
    if not found.complete:
        search = so_far.search
        stopped = found.stopped or replace(
            Stopped.by(found.ended, 0.0), tried=len(search.tried), effects=search.effects, needs=so_far.needs()
        )
        found = provisional(found, replace(stopped, seconds=asked.deadline.spent()))
    found = replace(
        found,
        findings=found.findings or asked.findings,
        trial_models=so_far.trial_models(),
        seconds=time.monotonic() - begun,
    )
    return task.told(with_model(found, session.plant), question, asked.deadline, asked.tick)


def _forward(session: Session, asked: Request, so_far: _SoFar) -> Diagnosis:
    """Replay the commands, look at the readings, search, decide, try on the trials kept aside."""
    plant, tick, deadline = session.plant, asked.tick, asked.deadline
    tick("replaying", len(session.trials))
    begun = deadline.spent()
    predict, nominal = predictor(
        plant, session.trials, asked.usable, threads=asked.threads, seed=asked.seed, deadline=deadline
    )
    predict = replace(predict, simulated=tick.worked)
    base = predict.all_trials([()], range(len(session.trials)), keep=True)[0]
    so_far.tally = predict.tally
    simulated = deadline.spent()
    # The nominal model once as it is, once with finer steps, once as it is compared.
    a_simulation = (simulated - begun) / (len(session.trials) * (2 + noise_model.STEP_REFINEMENT))
    phase = phases.phases(plant, predict.on, nominal)[:, : base.shape[1]]
    so_far.where = locate.locate(predict.data, base, phase, plant.period, asked.seed)
    # What follows the search: so many simulations, and three such tables (where, what remains, how far it closes).
    reserve = a_simulation * simulations(session) + 3 * (deadline.spent() - simulated)
    fastest = np.abs(nominal.velocity).max(axis=(0, 1))
    pool = hypotheses.candidates(plant, asked.names, fastest, sizes.sizes(plant, session.trials, nominal))
    fitted_on = session.indices(*FITTED)
    with mujoco_log.counted(so_far.warned):
        proposed = proposals(predict, nominal, base, pool, fitted_on)
    searching = deadline.sooner(reserve)
    steps = replay.physics_steps(plant, predict.on)
    question = Question(
        replace(predict, deadline=searching),
        noise_model.select_trials(proposed.data, fitted_on),
        fitted_on,
        proposed.pool,
        hypotheses.terms(plant),
        base[fitted_on],
        proposed.known,
        proposed.servo_motion,
        steps,
    )
    before, already = deadline.spent(), predict.tally["physics_steps"]

    def needs() -> float | None:
        """By the search's own limit of physics steps, at its speed so far."""
        done = predict.tally["physics_steps"] - already
        a_step = (deadline.spent() - before) / done if done > steps else a_simulation / max(steps, 1)
        if not np.isfinite(question.budget):
            return None
        return max(before + a_step * (question.budget - already) + reserve, deadline.spent())

    so_far.needs = needs
    tick.measured_in(question.fitted_trials * question.steps, question.budget)
    with mujoco_log.counted(so_far.warned):
        ranked = select.select(
            question,
            so_far=so_far.search,
            deadline=searching,
            landing=a_simulation * select.LANDING * question.first_trials,
            tick=tick,
        )
        return concluded(
            session, proposed, ranked, nominal, seed=asked.seed, threads=asked.threads, deadline=deadline, tick=tick
        )


def _question(session: Session, asked: Request) -> task.Asked | None:
    """A policy whose return is to be predicted; None: not asked."""
    if asked.policy is None:
        return None
    tested = [session.trials[k] for k in session.indices("test")]
    return task.ask(session.plant, tested, asked.policy, trust=asked.trust, seed=asked.seed)


def _along_the_motion(session: Session, asked: Request, so_far: _SoFar) -> Diagnosis:
    """Explain the efforts along the measured motion, or the commands where they are efforts."""
    plant = session.plant
    trials, joints = efforts_along(plant, session.trials)
    return diagnose_inverse(
        trials,
        plant.model,
        joints,
        findings=asked.findings,
        robot=plant.name,
        seed=asked.seed,
        version=tiago_mj.__version__,
        names=asked.names,
        given=plant.given,
        tick=AheadInTime(asked.tick.listener),
        deadline=asked.deadline,
    )
