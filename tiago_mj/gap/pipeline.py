"""The diagnosis: recordings in, verdict out. Each stage is a function of the ones before."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import tiago_mj
from tiago_mj import mujoco_log
from tiago_mj.effects import Entry
from tiago_mj.gap.ahead import Ahead, AheadInTime, Listener
from tiago_mj.gap.analysis import task
from tiago_mj.gap.conclusion import concluded
from tiago_mj.gap.data.recording import Finding, Trial
from tiago_mj.gap.detectors.proposals import proposals
from tiago_mj.gap.inference import hypotheses, noise_model
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.report.consistency import checked
from tiago_mj.gap.report.repaired import with_model
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.search import select
from tiago_mj.gap.search.state import Question
from tiago_mj.gap.simulation import replay, sizes
from tiago_mj.gap.simulation.along_a_motion import along_a_motion, efforts_along
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.gap.simulation.session import session as session_of
from tiago_mj.gap.torque import diagnose_inverse


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
    budget: float | None = None,
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
        budget: seconds after which the best verdict so far is given.
        policy: ``pi`` or a file, whose return the nominal and the repaired simulator predict; None: not asked.
        trust: load that file although loading runs what it holds.
        tick: told how far it is.

    Raises:
        RecordingError: the recordings hold nothing that can be compared; one line.
    """
    asked = Request(
        tuple(findings), usable, env, model, names, tuple(given), seed, threads, budget, policy, trust, Ahead(tick)
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
    budget: float | None
    policy: str | None
    trust: bool
    tick: Ahead


def _diagnosed(trials: Sequence[Trial], asked: Request) -> Diagnosis:
    """Read, replay, look at the readings, search, decide, try on the trials kept aside, tell."""
    begun, tick = time.monotonic(), asked.tick
    session = session_of(trials, env=asked.env, model=asked.model, given=asked.given)
    plant = session.plant
    question = _question(session, asked)
    if along_a_motion(plant, session.trials):
        return task.told(with_model(_along_the_motion(session, asked), plant), question)

    tick("replaying", len(session.trials))
    replaying = time.monotonic()
    predict, nominal = predictor(plant, session.trials, asked.usable, threads=asked.threads, seed=asked.seed)
    predict = replace(predict, simulated=tick.worked)
    base = predict.all_trials([()], range(len(session.trials)), keep=True)[0]
    fastest = np.abs(nominal.velocity).max(axis=(0, 1))
    pool = hypotheses.candidates(plant, asked.names, fastest, sizes.sizes(plant, session.trials, nominal))
    fitted_on = session.indices(*FITTED)
    proposed = proposals(predict, nominal, base, pool, fitted_on)
    # What follows the search simulates about as much as what came before it.
    reserve = time.monotonic() - replaying

    searched = Question(
        predict,
        noise_model.select_trials(proposed.data, fitted_on),
        fitted_on,
        proposed.pool,
        hypotheses.terms(plant),
        base[fitted_on],
        proposed.known,
        proposed.servo_motion,
        replay.physics_steps(plant, predict.on),
    )
    tick.measured_in(searched.fitted_trials * searched.steps, searched.budget)
    ranked = select.select(
        searched,
        out_of_time=lambda: asked.budget is not None and time.monotonic() - begun > asked.budget - reserve,
        tick=tick,
    )
    until = None if asked.budget is None else begun + asked.budget
    found = concluded(
        session, proposed, ranked, nominal, seed=asked.seed, threads=asked.threads, until=until, tick=tick
    )
    found = replace(found, findings=asked.findings, seconds=time.monotonic() - begun)
    return task.told(with_model(found, plant), question, tick)


def _question(session: Session, asked: Request) -> task.Asked | None:
    """A policy whose return is to be predicted; None: not asked."""
    if asked.policy is None:
        return None
    tested = [session.trials[k] for k in session.indices("test")]
    return task.ask(session.plant, tested, asked.policy, trust=asked.trust, seed=asked.seed)


def _along_the_motion(session: Session, asked: Request) -> Diagnosis:
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
    )
