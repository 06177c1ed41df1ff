"""From explanations to an answer: which of them stands, what it does on trials kept aside, what to record next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

import tiago_mj
from tiago_mj.effects import Entry
from tiago_mj.gap.ahead import Ahead
from tiago_mj.gap.analysis import fitted_numbers, held_out, locate, outcome, place, promises, shrink, unexplained
from tiago_mj.gap.analysis.recorded import Recorded
from tiago_mj.gap.analysis.remainder import LEFT, remainder, weighed_share, with_accounted
from tiago_mj.gap.compared import Compared
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.design.next_motion import next_motion
from tiago_mj.gap.detectors.proposals import Proposals
from tiago_mj.gap.inference import noise_model
from tiago_mj.gap.inference.fit import Fitted
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.report.repaired import entry
from tiago_mj.gap.request import Request, SoFar
from tiago_mj.gap.result import (
    Closing,
    Diagnosis,
    Explanation,
    NextMotion,
    Overlay,
    Place,
    Remains,
    ResidualShape,
    Shrink,
    Stopped,
    Verdict,
)
from tiago_mj.gap.search.state import Ranked
from tiago_mj.gap.simulation.replay import Run
from tiago_mj.gap.simulation.session import FITTED, Session
from tiago_mj.io.deadline import OutOfTimeError

Array = NDArray[np.float64]
T = TypeVar("T")

#: Trials drawn in the report.
OVERLAYS: Final = 1
#: Explanations that are tried on the validation trials, and simulations of a test trial for what is left of it, with
#: and without the explanation: for how long that takes, on the safe side.
SHOWN: Final = 12
REMAINDERS: Final = 20
#: A sentence where there was no time for the numbers of the nominal model.
NO_TIME_FOR_NUMBERS: Final = (
    "There was no time to find out which of the simulator's own numbers the validation trials confirm as fitted: the "
    "repair has none of them."
)


@dataclass(frozen=True)
class Tried:
    """What is said, and what it does on the trials that were kept aside.

    Attributes:
        judged: the verdict.
        repaired: prediction with its best explanation, of all trials, (ntrials, T, C).
        closing: how far that closes the gap.
        said: sentences on what the trials kept aside changed.
    """

    judged: verdict.Judged
    repaired: Array
    closing: Shrink
    said: tuple[str, ...]


def concluded(compared: Compared, asked: Request, so_far: SoFar, ranked: Ranked) -> Diagnosis:
    """Decide between explanations, try the verdict on the trials that were kept aside, and tell it.

    Args:
        compared: the recordings beside the nominal model.
        asked: what is asked of them.
        so_far: what is known.
        ranked: explanations.

    Raises:
        OutOfTimeError: the deadline was over before the answer was.
    """
    seed, tick = asked.seed, so_far.tick
    session, proposed, phase = compared.session, compared.proposed, compared.phase
    plant, data = session.plant, proposed.data
    recorded = Recorded(session, data, phase, seed)
    everything, fitted_on = range(len(session.trials)), session.subset(*FITTED)
    part = noise_model.select_trials(data if compared.sharp is None else compared.sharp, fitted_on)
    placed, ranked = _unless_ended(ranked, partial(place.refined, plant, ranked, part, fitted_on), None)
    ranked = placed or ranked
    ranked = replace(ranked, predict=replace(ranked.predict, deadline=asked.deadline))
    # Before and after are what the simulator itself does: as the environment with these effects, or the repaired model.
    simulator, left_open = ranked.predict.as_simulated(), outcome.left_open(plant, ranked)
    base = simulator.all_trials([left_open.get(outcome.nominal(ranked), ())], everything)[0]
    judged, gains = _judged(recorded, proposed, ranked, base)
    found = _tried(recorded, proposed, ranked, judged, left_open, base)
    (following, late), ranked = _chosen(recorded, part, ranked, judged, asked, tick)
    tick("writing", 1)
    judged, best = found.judged, ranked.fits[found.judged.rivals[0]]
    where = locate.locate(data, base, phase, plant.period, seed)
    left = locate.locate(data, found.repaired, phase, plant.period, seed)
    looks: tuple[ResidualShape | None, str] = (None, "")
    look = partial(unexplained.by_the_best, session, data, ranked, found.judged, compared.nominal)
    (shape, later), ranked = _unless_ended(ranked, look, looks)
    explanations = outcome.explanations(plant, ranked, judged.probability, gains)
    answer = Diagnosis(
        **_known(session, asked),
        verdict=_verdict(judged, explanations, left, ranked),
        where=where,
        stage=outcome.stage(best) if best.parts and judged.kind != "unknown" else unexplained.stage(shape, where),
        shrink=found.closing,
        ranking=tuple(explanations[k] for k in _ranked(judged)),
        next_motion=following if judged.kind == "ambiguous" else None,
        complete=ranked.complete,
        physics_steps=ranked.predict.physics_steps,
        overlays=_overlays(recorded, base, found.repaired),
        notes=(*found.said, *(said for said in (late, later) if said), *outcome.notes(session, proposed.tones, ranked)),
        asides=outcome.asides(session.trials) if ranked.predict.replays else (),
        residual_shape=shape,
    )
    if not ranked.complete:
        return provisional(answer, so_far.stopped(ranked.ended, asked.deadline.spent()))
    if asked.numbers:
        answer = _with_numbers(answer, recorded, ranked, best, base)
    return replace(answer, physics_steps=ranked.predict.physics_steps)


def _verdict(
    judged: verdict.Judged, explanations: Sequence[Explanation], left: Sequence[Place], ranked: Ranked
) -> Verdict:
    """What is said: of which explanations, and what remains."""
    shown = [k for k in judged.rivals if ranked.fits[k].parts or judged.kind == "no_gap"]
    likeliest = explanations[judged.rivals[0]]
    return Verdict(
        judged.kind,
        () if judged.kind == "no_gap" else likeliest.effects,
        likeliest.probability,
        tuple(explanations[k] for k in (shown[:1] if judged.kind == "no_gap" else shown)),
        Remains(
            judged.remains and judged.kind != "no_gap",
            tuple(place for place in left[:5] if place.share > 0) if judged.remains else (),
        ),
        ranked.not_excited,
    )


def _chosen(
    recorded: Recorded, part: Data, ranked: Ranked, judged: verdict.Judged, asked: Request, tick: Ahead
) -> tuple[tuple[NextMotion | None, str], Ranked]:
    """The motion to record next where rivals are left, or a sentence on why there is none; and the search, as one that
    came to no end where something ended the choice."""
    chosen: tuple[NextMotion | None, str] = (None, "")
    if judged.kind != "ambiguous" or not ranked.complete or not ranked.predict.replays:
        return chosen, ranked
    tick("next motion", 1)
    rivals = [(ranked.fits[k], judged.probability[k]) for k in judged.rivals]
    how = Run(asked.threads, asked.seed, asked.deadline)
    choose = partial(next_motion, recorded.plant, recorded.session.trials[0], part, ranked.weight, rivals, how)
    return _unless_ended(ranked, partial(_if_time, choose), chosen)


def _with_numbers(answer: Diagnosis, recorded: Recorded, ranked: Ranked, best: Fitted, base: Array) -> Diagnosis:
    """The answer with the nominal numbers that the validation trials confirm beside its explanation, and with what the
    simulator with both leaves on the test trials; with a sentence where the time was over before."""
    session, data = recorded.session, recorded.data
    try:
        numbers, joint = fitted_numbers.confirmed(session, ranked, data, best)
        answer = replace(answer, open_numbers=fitted_numbers.open_numbers(session.plant, best, numbers))
        if not numbers:
            return answer
        simulator, everything = ranked.predict.as_simulated(), range(len(data.value))
        repaired = simulator.all_trials([(*best.effects(), *(entry(one.effect) for one in numbers))], everything)[0]
    except OutOfTimeError:
        return replace(answer, notes=(*answer.notes, NO_TIME_FOR_NUMBERS))
    except KeyboardInterrupt:
        return replace(answer, notes=(*answer.notes, NO_TIME_FOR_NUMBERS), interrupted=True)
    answer = replace(answer, numbers=numbers, numbers_joint=joint, overlays=_overlays(recorded, base, repaired))
    gap = shrink.shrink(recorded, base, repaired)
    if gap.before is None or gap.after is None:
        return answer
    left = Closing(gap.before, gap.after, gap.closed, gap.low, gap.high)
    return replace(answer, shrink=replace(answer.shrink, with_numbers=left))


def _overlays(recorded: Recorded, base: Array, repaired: Array) -> tuple[Overlay, ...]:
    """Curves of a test trial, without and with the repair."""
    shown = (recorded.test or range(len(recorded.session.trials)))[:OVERLAYS]
    return tuple(outcome.overlay(recorded, base, repaired, k) for k in shown)


def unanswered(session: Session, asked: Request, so_far: SoFar, ended: BaseException) -> Diagnosis:
    """The answer where something ended the work before what was found could be judged.

    Args:
        session: the recordings.
        asked: what is asked of them.
        so_far: what is known.
        ended: the time, the user, or a fault.
    """
    best, where, ranked = Explanation((), math.nan), so_far.where, so_far.search.ranked
    if ranked is not None:
        unknown = np.full(len(ranked.fits), np.nan)
        best = outcome.explanations(session.plant, ranked, unknown, unknown)[0]
    answer = Diagnosis(
        **_known(session, asked),
        verdict=Verdict("effect" if best.effects else "unknown", best.effects, best.probability),
        where=where,
        stage=locate.stage(where) if where else None,
        shrink=Shrink(None, None, 1.0, None, None, None),
        ranking=(best,) if ranked is not None else (),
        next_motion=None,
        complete=False,
        notes=(outcome.early_end(ended),),
    )
    return provisional(answer, so_far.stopped(ended, asked.deadline.spent()))


def _known(session: Session, asked: Request) -> dict[str, Any]:
    """What every answer repeats of what it was given."""
    return {
        "findings": tuple(asked.findings),
        "splits": session.splits,
        "robot": session.plant.name,
        "seed": asked.seed,
        "version": tiago_mj.__version__,
        "seconds": 0.0,
        "given": session.plant.given,
        "command": asked.command,
    }


def provisional(found: Diagnosis, stopped: Stopped) -> Diagnosis:
    """The answer of a search that did not come to its end: it has no probabilities, and where nothing is named it does
    not say that there is no gap."""

    def without(one: Explanation) -> Explanation:
        return replace(one, probability=math.nan)

    said = replace(found.verdict, probability=math.nan, alternatives=tuple(map(without, found.alternatives)))
    if not said.effects:
        said = replace(said, kind="unknown", alternatives=(), remains=Remains())
    return replace(
        found,
        verdict=said,
        ranking=tuple(map(without, found.ranking)),
        next_motion=None,
        complete=False,
        stopped=stopped,
        interrupted=stopped.why == "interrupted",
    )


def simulations(session: Session) -> int:
    """How many trials :func:`concluded` simulates at most, all explanations together."""
    tests, judging = (len(session.subset(name)) for name in ("test", "validation"))
    judging = judging or len(session.subset(*FITTED))
    return 3 * len(session.trials) + SHOWN * judging + REMAINDERS * tests


def _if_time(choose: Callable[[], NextMotion | None]) -> tuple[NextMotion | None, str]:
    """A next motion; or else a sentence, where there was no time to choose it."""
    try:
        return choose(), ""
    except OutOfTimeError:
        return None, "The time budget left no time to choose the motion to record next."


def _judged(recorded: Recorded, proposed: Proposals, ranked: Ranked, base: Array) -> tuple[verdict.Judged, Array]:
    """The verdict before the trials kept aside are looked at, and what each explanation gains on validation trials."""
    by, session = verdict.calibration(replays=ranked.predict.replays), recorded.session
    judging = session.subset("validation").without(ranked.excluded)
    found = held_out.validated(
        recorded,
        ranked.predict,  # what is judged is the explanation, not who plays it back
        base,
        ranked.fits,
        outcome.nominal(ranked),
        judging or session.subset(*FITTED),
    )
    beaten = found.far_worse(by.fails, recorded.seed) if judging else None
    judged = verdict.judge(ranked, strange=bool(proposed.tones), refuted=beaten)
    return promises.standing(judged, [verdict.option(fit, ranked) for fit in ranked.fits], by), found.gains


def _tried(
    recorded: Recorded,
    proposed: Proposals,
    ranked: Ranked,
    judged: verdict.Judged,
    left_open: Mapping[int, tuple[Entry, ...]],
    base: Array,
) -> Tried:
    """The verdict, once the trials kept aside were looked at."""
    by = verdict.calibration(replays=ranked.predict.replays)
    repair = partial(_repaired, ranked.predict.as_simulated(), ranked, left_open, recorded.data, base)
    close = partial(shrink.shrink, recorded, base)
    leave = partial(remainder, recorded, ranked.predict, weight=ranked.weight, allowed=by.remains)
    best = ranked.fits[judged.rivals[0]]
    repaired = repair(judged.rivals[0])
    closing = close(repaired)
    if not recorded.test or not ranked.complete:  # what is provisional needs no more than how far it closes the gap
        return Tried(judged, repaired, closing, ())
    rest = leave(fit=best)
    closed, none, weighed, along = closing.closed, None, None, not ranked.predict.replays
    # Where the object stood may hide it; along a motion the model's masses may, which act on the same torques.
    if closed is not None and closed <= (promises.LARGER_PART if along else promises.CLOSES):
        none = leave(fit=ranked.fits[outcome.nominal(ranked)])
        closed = max(closed, shrink.gone(none.gap, rest.gap))
    share = closed if along else closing.closed
    if none is not None and closed is not None and closed <= promises.CLOSES:
        closed = weighed = weighed_share(recorded, ranked.predict, best, rest, none)
    own_model = recorded.plant.environment is None
    aside = promises.Aside(
        closed,
        rest.gap,
        rest.misfit,
        held_out.can_close(best),
        comparable=False,
        loud=bool(rest.loud),
        without=None if none is None else none.gap,
        larger_part=not proposed.tones
        and promises.is_larger_part(closing.low, rest.gap, rest.misfit, by, own_model=own_model),
        smaller_part="force" not in recorded.data.kinds
        and share is not None
        and share < promises.LARGER_PART
        and rest.gap > LEFT,
    )
    options = [verdict.option(fit, ranked) for fit in ranked.fits]
    kept, said = promises.aside(judged, aside, options, by, measured_on_readings=ranked.known > 0)
    if kept.rivals[0] != judged.rivals[0]:
        best, repaired = ranked.fits[kept.rivals[0]], repair(kept.rivals[0])
        closing, rest, none, weighed = close(repaired), leave(fit=best), None, None
    said += held_out.spoiled(recorded, ranked.predict, best)
    return Tried(kept, repaired, with_accounted(closing, rest, none, weighed), said)


def _repaired(
    simulator: Predictor, ranked: Ranked, left_open: Mapping[int, tuple[Entry, ...]], data: Data, base: Array, best: int
) -> Array:
    """What the simulator predicts with an explanation, by its index, (ntrials, T, C)."""
    fit = ranked.fits[best]
    if not fit.parts:
        return base
    return simulator.all_trials([(*fit.effects(), *left_open.get(best, ()))], range(len(data.value)))[0]


def _ranked(judged: verdict.Judged) -> list[int]:
    """Indices of the explanations: those that are not ruled out, the best first, then the others by probability."""
    rest = [k for k in range(len(judged.probability)) if k not in judged.rivals]
    return [*judged.rivals, *sorted(rest, key=lambda k: -judged.probability[k])]


def _unless_ended(ranked: Ranked, work: Callable[[], T], otherwise: T) -> tuple[T, Ranked]:
    """What the work gives, and the search as it was; where the time or the user ends the work, a substitute, and the
    search as one that came to no end."""
    try:
        return work(), ranked
    except (OutOfTimeError, KeyboardInterrupt) as end:
        return otherwise, replace(ranked, complete=False, ended=ranked.ended or end)
