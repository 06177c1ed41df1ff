"""The diagnosis: recordings in, verdict out. Each stage is a function of the ones before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.ahead import Ahead
from tiago_mj.gap.analysis import likeness, locate, task
from tiago_mj.gap.compared import Compared
from tiago_mj.gap.conclusion import concluded, simulations, unanswered
from tiago_mj.gap.detectors.proposals import Proposals, proposals
from tiago_mj.gap.faults import keeping
from tiago_mj.gap.inference import hypotheses, noise_model, step_tolerance
from tiago_mj.gap.inference.predictor import predictor
from tiago_mj.gap.report.contradiction import checked
from tiago_mj.gap.report.repaired import with_model
from tiago_mj.gap.request import Needs, Request, SoFar, begun_with
from tiago_mj.gap.result import Diagnosis
from tiago_mj.gap.search import select, shared
from tiago_mj.gap.search.state import Question, Ranked
from tiago_mj.gap.simulation import phases, replay, sizes
from tiago_mj.gap.simulation.along_a_motion import along_a_motion, efforts_along
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.gap.simulation.session import session as session_of
from tiago_mj.gap.torque import by_part, doubts, from_commands
from tiago_mj.gap.torque.band import most_informative
from tiago_mj.gap.torque.channels import Wanted
from tiago_mj.gap.torque.notes import of_method
from tiago_mj.gap.torque.predictor import EffortPredictor
from tiago_mj.gap.torque.second_numbers import with_second_numbers
from tiago_mj.gap.torque.shown import check_given, shown
from tiago_mj.io import mujoco_log
from tiago_mj.io.deadline import OutOfTimeError
from tiago_mj.io.journal import kept
from tiago_mj.recordings import like
from tiago_mj.recordings.recording import Trial

#: A sentence where like parts share their magnitudes.
TIED: Final = "{} are alike, and were asked to share one magnitude of each effect on the same joint (tie)."


def diagnose(trials: Sequence[Trial], **asked: Any) -> Diagnosis:
    """Diagnose recordings: read, replay, look at the readings, search, decide, try on the trials kept aside, tell.

    Args:
        trials: of one robot, with commands and what was measured.
        asked: fields of :class:`tiago_mj.gap.request.Request`, each of which may be left out.

    Raises:
        RecordingError: the recordings hold nothing that can be compared; one line.
        FaultError: of this program; it has the best answer until then.
        ValueError: the journal to go on with is of another diagnosis; one line.
    """
    request = Request(**asked)
    so_far = SoFar(Ahead(request.tick))
    with mujoco_log.counted() as warned:
        session = session_of(trials, env=request.env, model=request.model, given=request.given)
        tested = [session.trials[k] for k in session.subset("test")]
        question = task.ask(session.plant, tested, request.policy, trust=request.trust, seed=request.seed)
        with (
            kept(request.journal, lambda: begun_with(session, request), resume=request.resume) as so_far.journal,
            keeping(lambda fault: so_far.answer or so_far.timed(unanswered(session, request, so_far, fault))),
        ):
            try:
                found = _explained(session, request, so_far)
            except (OutOfTimeError, KeyboardInterrupt) as end:
                found = unanswered(session, request, so_far, end)
            so_far.answer = so_far.timed(found)
            found = task.told(with_model(so_far.answer, session.plant), question, request.deadline, so_far.tick)
            return checked(replace(found, notes=(*found.notes, *mujoco_log.sentences(warned))))


def beside_nominal(session: Session, asked: Request, so_far: SoFar) -> Compared:
    """Recordings beside what the nominal model predicts: of commands that are replayed, or of efforts along a motion.

    Raises:
        OutOfTimeError: the deadline was over before.
        RecordingError: the recordings hold nothing that can be compared; one line.
    """
    compare = _along_the_motion if along_a_motion(session.plant, session.trials) else _replayed
    found = compare(session, asked, so_far)
    targets, replays = found.session.plant.wiring.targets, found.predict.replays
    pool = shared.of_like_parts(found.proposed.pool, targets, found.session.trials, replays=replays)
    return replace(found, proposed=replace(found.proposed, pool=pool))


def _replayed(session: Session, asked: Request, so_far: SoFar) -> Compared:
    """Replay the commands and look at the readings."""
    plant, tick, deadline = session.plant, so_far.tick, asked.deadline
    tick("replaying", len(session.trials))
    begun = deadline.spent()
    predict, nominal = predictor(
        plant, session.trials, asked.usable, threads=asked.threads, seed=asked.seed, deadline=deadline
    )
    predict = replace(predict, simulated=tick.worked, journal=so_far.journal)
    base = predict.all_trials([()], range(len(session.trials)), keep=True)[0]
    so_far.tally = predict.tally
    simulated = deadline.spent()
    # The nominal model once as it is, once with finer steps, once as it is compared.
    a_simulation = (simulated - begun) / (len(session.trials) * (2 + step_tolerance.STEP_REFINEMENT))
    phase = phases.phases(plant, nominal)[:, : base.shape[1]]
    so_far.where = locate.locate(predict.data, base, phase, plant.period, asked.seed)
    # What follows the search: so many simulations, and three such tables (where, what remains, how far it closes).
    reserve = a_simulation * simulations(session) + 3 * (deadline.spent() - simulated)
    fastest = sizes.largest(session.trials, nominal.velocity)
    pool = hypotheses.candidates(plant, asked.names, fastest, sizes.sizes(plant, session.trials, nominal))
    with mujoco_log.counted(so_far.warned):
        proposed = proposals(predict, nominal, base, pool, session.subset(*FITTED))
    return Compared(session, predict, nominal, phase, proposed, a_simulation, reserve)


def _along_the_motion(session: Session, asked: Request, so_far: SoFar) -> Compared:
    """Compare efforts, or commands where these are efforts, with the torques of the measured motion."""
    trials, joints = efforts_along(session.plant, session.trials)
    check_given(trials, asked.given)
    deadline = asked.deadline
    wanted = Wanted(joints, asked.findings, session.plant.given, asked.seed, deadline)
    found = most_informative(session, trials, wanted, so_far.tick)
    along, plant = found.session, found.session.plant
    pool = hypotheses.candidates(plant, asked.names, None, sizes.sizes(plant, along.trials, found.motion))
    pool = with_second_numbers(shown(pool, found.predict.torques), found.predict, along.subset(*FITTED))
    begun = deadline.spent()
    predict = replace(found.predict, simulated=so_far.tick.worked, journal=so_far.journal)
    base = predict.all_trials([()], range(len(along.trials)), keep=True)[0]
    so_far.tally = predict.tally
    simulated = deadline.spent()
    phase = phases.phases(plant, found.motion)
    so_far.where = locate.locate(found.assumed, base, phase, plant.period, asked.seed)
    a_simulation = (simulated - begun) / max(predict.tally["simulations"], 1)
    reserve = a_simulation * simulations(along) + 3 * (deadline.spent() - simulated)
    proposed = Proposals(pool, (), None, (), found.assumed)
    seen = {candidate.effect for candidate in proposed.pool}
    return Compared(
        along,
        predict,
        found.motion,
        phase,
        proposed,
        a_simulation,
        reserve,
        notes=of_method(trials, replace(found, predict=predict)),
        findings=found.usable.findings,
        hidden=tuple(name for name in asked.names or EFFECTS if EFFECTS[name].nameable and name not in seen),
        sharp=predict.data,
    )


def _explained(session: Session, asked: Request, so_far: SoFar) -> Diagnosis:
    """Compare, search, decide, try on the trials kept aside."""
    compared = beside_nominal(session, asked, so_far)
    ranked = _searched(compared, asked, so_far)
    predict, fitted_on = compared.predict, compared.session.subset(*FITTED)
    if not isinstance(predict, EffortPredictor) or not ranked.complete:
        return _told(compared, ranked, asked, so_far)
    try:
        again = _doubting(session, asked, so_far) if doubts.doubted(predict, fitted_on, ranked.fits[0]) else None
    except OutOfTimeError:
        again = None
    if again is not None:
        return _told(*again, asked, so_far)
    so_far.search.ranked = ranked  # what was found stands
    found = _told(compared, ranked, asked, so_far)
    best = ranked.fits[0]
    told = {effect.name for effect in found.best.effects} == {part.effect for part in best.parts} != set()
    if not told or not found.complete or found.kind == "unknown":
        return found
    try:
        said = (doubts.IMITATED,) if doubts.imitated(predict, fitted_on, best) else ()
    except OutOfTimeError:
        said = ()
    return replace(found, notes=(*found.notes, *said))


def _doubting(session: Session, asked: Request, so_far: SoFar) -> tuple[Compared, Ranked] | None:
    """Compare and search with numbers uncertain that count as exact at first; None: the search came to no end.

    Raises:
        OutOfTimeError: the deadline was over before.
    """
    made = so_far.tally
    compared = beside_nominal(replace(session, plant=replace(session.plant, doubted=True)), asked, so_far)
    so_far.tally.update(made)
    ranked = _searched(compared, asked, so_far, already=made["physics_steps"])
    return (replace(compared, notes=(*compared.notes, doubts.SAID)), ranked) if ranked.complete else None


def _searched(compared: Compared, asked: Request, so_far: SoFar, already: int = 0) -> Ranked:
    """Explanations of what the nominal model leaves; ``already``: physics steps of a search before."""
    session, predict, proposed = compared.session, compared.predict, compared.proposed
    tick, deadline = so_far.tick, asked.deadline
    fitted_on = session.subset(*FITTED)
    said = [] if like.tied(session.trials) else like.prefixes(session.trials)
    searching = deadline.sooner(compared.reserve)
    steps = replay.physics_steps(session.plant, predict.on) if predict.replays else predict.data.value.shape[1]
    base = predict.all_trials([()], fitted_on)[0]
    question = Question(
        replace(predict, deadline=searching),
        noise_model.select_trials(proposed.data if compared.sharp is None else compared.sharp, fitted_on),
        fitted_on,
        proposed.pool,
        (*hypotheses.terms(session.plant), *hypotheses.own_numbers(session.plant, (c.effect for c in proposed.pool))),
        base,
        proposed.known,
        proposed.servo_motion,
        steps,
        already,
        assumed=None if compared.sharp is None else noise_model.select_trials(proposed.data, fitted_on),
        sets=partial(from_commands.sets, session, asked.names, asked.seed, searching) if predict.replays else None,
    )
    most = question.budget(select.MAX_EFFECTS)
    if np.isfinite(most):
        a_step = compared.a_simulation / max(steps, 1)
        so_far.needs = Needs(deadline, predict.tally, most, a_step, steps, compared.reserve)
    tick.measured_in(question.fitted_trials * question.steps, most)
    with mujoco_log.counted(so_far.warned):
        landing = compared.a_simulation * select.LANDING * question.first_trials
        ranked = by_part.searched(question, said, searching, landing, tick) if said else None
        if ranked is None:
            ranked = select.select(question, so_far=so_far.search, deadline=searching, landing=landing, tick=tick)
    so_far.search.ranked = ranked
    return ranked


def _told(compared: Compared, ranked: Ranked, asked: Request, so_far: SoFar) -> Diagnosis:
    """Decide, try on the trials kept aside."""
    session = compared.session
    said, tied = like.prefixes(session.trials), like.tied(session.trials)
    with mujoco_log.counted(so_far.warned):
        found = concluded(compared, asked, so_far, ranked)
        if said and found.best.effects and found.complete:
            found = likeness.beside(found, session, ranked, said)
    of_parts = (TIED.format(", ".join(said)),) if tied else ()
    return replace(
        found.with_verdict(not_excited=(*found.not_excited, *compared.hidden)),
        findings=(*asked.findings, *compared.findings),
        notes=(*found.notes, *of_parts, *compared.notes),
    )
