"""The diagnosis: recordings in, verdict out. Each stage is a function of the ones before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import tiago_mj
from tiago_mj.gap.ahead import Ahead, AheadInTime
from tiago_mj.gap.analysis import locate, task
from tiago_mj.gap.conclusion import concluded, provisional, simulations, unanswered
from tiago_mj.gap.detectors.proposals import proposals
from tiago_mj.gap.faults import keeping
from tiago_mj.gap.inference import hypotheses, noise_model
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.report.consistency import checked
from tiago_mj.gap.report.repaired import with_model
from tiago_mj.gap.request import Needs, Request, SoFar
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.search import select
from tiago_mj.gap.search.state import Question
from tiago_mj.gap.simulation import phases, replay, sizes
from tiago_mj.gap.simulation.along_a_motion import along_a_motion, efforts_along
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.gap.simulation.session import session as session_of
from tiago_mj.gap.torque import diagnose_inverse
from tiago_mj.io import mujoco_log
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.recordings.recording import Trial


def diagnose(trials: Sequence[Trial], **asked: Any) -> Diagnosis:
    """Diagnose recordings: read, replay, look at the readings, search, decide, try on the trials kept aside, tell.

    Args:
        trials: of one robot, with commands and what was measured.
        asked: fields of :class:`tiago_mj.gap.request.Request`, each of which may be left out.

    Raises:
        RecordingError: the recordings hold nothing that can be compared; one line.
        FaultError: of this program; it has the best answer until then.
    """
    request = Request(**asked)
    so_far = SoFar(Ahead(request.tick))
    with mujoco_log.counted() as warned:
        session = session_of(trials, env=request.env, model=request.model, given=request.given)
        question = _question(session, request)
        explain = _along_the_motion if along_a_motion(session.plant, session.trials) else _forward
        with keeping(lambda fault: so_far.answer or so_far.timed(unanswered(session, request, so_far, fault))):
            try:
                found = explain(session, request, so_far)
            except (OutOfTimeError, KeyboardInterrupt) as end:
                found = unanswered(session, request, so_far, end)
            so_far.answer = so_far.timed(found)
            found = task.told(with_model(so_far.answer, session.plant), question, request.deadline, so_far.tick)
            return checked(replace(found, notes=(*found.notes, *mujoco_log.sentences(warned))))


def _forward(session: Session, asked: Request, so_far: SoFar) -> Diagnosis:
    """Replay the commands, look at the readings, search, decide, try on the trials kept aside."""
    plant, tick, deadline = session.plant, so_far.tick, asked.deadline
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
    if np.isfinite(question.budget):
        so_far.needs = Needs(deadline, predict.tally, question.budget, a_simulation / max(steps, 1), steps, reserve)
    tick.measured_in(question.fitted_trials * question.steps, question.budget)
    with mujoco_log.counted(so_far.warned):
        ranked = select.select(
            question,
            so_far=so_far.search,
            deadline=searching,
            landing=a_simulation * select.LANDING * question.first_trials,
            tick=tick,
        )
        return concluded(session, asked, so_far, proposed, ranked, nominal)


def _question(session: Session, asked: Request) -> task.Asked | None:
    """A policy whose return is to be predicted; None: not asked."""
    tested, play = [session.trials[k] for k in session.indices("test")], asked.policy
    return None if play is None else task.ask(session.plant, tested, play, trust=asked.trust, seed=asked.seed)


def _along_the_motion(session: Session, asked: Request, so_far: SoFar) -> Diagnosis:
    """Explain the efforts along the measured motion, or the commands where they are efforts."""
    plant = session.plant
    trials, joints = efforts_along(plant, session.trials)
    found = diagnose_inverse(
        trials,
        plant.model,
        joints,
        findings=asked.findings,
        robot=plant.name,
        seed=asked.seed,
        version=tiago_mj.__version__,
        names=asked.names,
        given=plant.given,
        tick=AheadInTime(asked.tick),
        deadline=asked.deadline,
    )
    found = replace(found, command=asked.command)
    return (
        found if found.stopped is None else provisional(found, replace(found.stopped, seconds=asked.deadline.spent()))
    )
