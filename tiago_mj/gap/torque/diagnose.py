"""Diagnosis of recordings that hold motion and effort but no commands."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import mujoco
import numpy as np

from tiago_mj.effects import EFFECTS, Entry
from tiago_mj.gap.analysis import outcome
from tiago_mj.gap.result import Diagnosis, Explanation, Named, Place, Remains, Stopped, Value
from tiago_mj.gap.result import Verdict as Said
from tiago_mj.gap.torque import intervals, notes, tables
from tiago_mj.gap.torque.band import clearest
from tiago_mj.gap.torque.channels import Usable
from tiago_mj.gap.torque.evidence import Evidence
from tiago_mj.gap.torque.judge import Verdict, judge
from tiago_mj.gap.torque.pool import OWN
from tiago_mj.gap.torque.search import Scored, Search
from tiago_mj.gap.torque.terms import ON_THE_EFFORT, Term
from tiago_mj.io.deadline import Deadline, OutOfTimeError
from tiago_mj.recordings.nominal_priors import known_to
from tiago_mj.recordings.recording import Finding, RecordingError, Trial

#: 90 % of a normal distribution lie within so many standard deviations.
NINETY: Final = 1.645
#: Units of what is told by torques alone, in proportion to the motors' constants.
OF_TORQUE: Final = ("N", "N·m", "N·s/m", "N·m·s/rad", "kg", "kg·m²")


def diagnose_inverse(
    trials: tuple[Trial, ...],
    model: mujoco.MjModel,
    joints: Sequence[str],
    *,
    findings: Sequence[Finding] = (),
    robot: str,
    seed: int,
    version: str,
    names: Collection[str] | None = None,
    given: Sequence[Entry] = (),
    tick: Callable[[str], None] = lambda stage: None,
    deadline: Deadline | None = None,
) -> Diagnosis:
    """Which unmodelled effect makes a robot's joint efforts differ from what its model needs for the same motion.

    Args:
        trials: each with positions of the same joints [rad, m] and efforts [N·m, N]; commands are not used, velocities
            are derived from the positions.
        model: nominal; contacts, joint limits and gravity compensation are switched off in a copy of it.
        joints: whose efforts are explained. Every joint that has a position takes part in the motion.
        findings: of the lint; channels that it discredits are left out.
        robot: name for the report.
        seed: of the split and the bootstraps.
        version: of the package.
        names: effects to consider; None for the whole library.
        given: effects that are known already: part of the torque that every explanation predicts.
        tick: told what begins, or goes on.
        deadline: by which there is an answer; None: there is none.

    Returns:
        The diagnosis. The noise floor is what the effort channels' noise leaves after the low-pass; "closed" is
        computed on blocks that were neither fitted nor chosen on, rows at rest left out. Where time or the user ended
        the search, it is not complete, and what leads so far is its best.

    Raises:
        OutOfTimeError: the deadline was over before anything could be compared.
        RecordingError: nothing moves, no effort can be used, the recording is too short, or what is given changes
            the log of efforts; one line.
        ValueError: the model lacks a joint.
    """
    began = clock.perf_counter()
    if not trials:
        raise RecordingError("no recording was given: name a file or a folder")
    if not any(
        np.nanmax(p) > np.nanmin(p) for trial in trials for p in trial.positions.values() if np.isfinite(p).any()
    ):
        raise RecordingError(f"{trials[0].source}: no joint moves: torque along a motion needs a motion")
    check_given(trials, given)
    by = deadline or Deadline()
    usable, evidence = clearest(trials, model, joints, findings, seed, known_to(trials), names, given, tick, by)
    if len(evidence.blocks.names) < 2:
        files = ", ".join(dict.fromkeys(trial.source for trial in trials))
        raise RecordingError(f"{files}: the motion is too short to choose between explanations: record longer")
    said = Told(trials, usable, tuple(findings), robot, seed, version, tuple(given), began)
    evidence.torques.deadline = Deadline()
    search, begun = Search(evidence, tick), clock.perf_counter()
    null = search.score(())
    where = tables.where(evidence, null, seed)
    # What is told where the search ends early: one more fit, and tables like that one before, after and of the rest.
    evidence.torques.deadline = by.sooner(3 * (clock.perf_counter() - begun))
    verdict = None
    try:
        verdict = judge(search, seed)
        spans = intervals.strengths(evidence, verdict.best, seed)
        forms = intervals.shapes(search, verdict.best)
        stage = _stage(search, verdict)
    except (OutOfTimeError, KeyboardInterrupt) as end:
        evidence.torques.deadline = Deadline()
        return _ended_early(search, said, where, null, verdict.best if verdict else search.leader(), end)

    def explained(scored: Scored) -> Explanation:
        own = scored is verdict.best
        effects = tuple(_named(evidence, scored, k, spans if own else {}, forms if own else {}) for k in scored.terms)
        place = next(k for k, one in enumerate(verdict.ranking) if one is scored)
        return Explanation(
            effects, float(verdict.probability[place]), float(verdict.gains[place]), verdict.evidence[place]
        )

    best = explained(verdict.best)
    left = [c for c, remains in enumerate(verdict.remains) if remains]
    return Diagnosis(
        verdict=Said(
            verdict.kind,
            best.effects,
            best.probability,
            tuple(explained(one) for one in verdict.alternatives),
            Remains(bool(left), tables.where(evidence, verdict.best, seed, left)[:6] if left else ()),
            _not_excited(evidence),
        ),
        where=where,
        stage=stage,
        shrink=verdict.shrink,
        ranking=tuple(explained(one) for one in verdict.ranking),
        findings=(*findings, *usable.findings),
        next_motion=None,
        splits=_splits(evidence),
        robot=robot,
        complete=True,
        seed=seed,
        version=version,
        seconds=clock.perf_counter() - began,
        overlays=tables.overlays(evidence, verdict.null, verdict.best),
        notes=notes.sentences(trials, usable, search, verdict),
        given=tuple(given),
    )


@dataclass(frozen=True)
class Told:
    """What a diagnosis repeats of what it was given; fields as the arguments of :func:`diagnose_inverse`."""

    trials: tuple[Trial, ...]
    usable: Usable
    findings: tuple[Finding, ...]
    robot: str
    seed: int
    version: str
    given: tuple[Entry, ...]
    began: float


def _ended_early(
    search: Search, told: Told, where: tuple[Place, ...], null: Scored, best: Scored, ended: BaseException
) -> Diagnosis:
    """The answer of a search that did not come to its end: what leads, and what that leaves of the gap."""
    e = search.evidence
    gap = tables.shrink(e, null, best, told.seed)
    lead = Explanation(tuple(_named(e, best, k, {}, {}) for k in best.terms), math.nan, math.nan)
    pool = {term.effect for term in e.terms}
    return Diagnosis(
        verdict=Said("effect" if best.terms else "unknown", lead.effects, math.nan, not_excited=_not_excited(e)),
        where=where,
        stage=None,
        shrink=gap,
        ranking=(lead,),
        findings=(*told.findings, *told.usable.findings),
        next_motion=None,
        splits=_splits(e),
        robot=told.robot,
        complete=False,
        seed=told.seed,
        version=told.version,
        seconds=clock.perf_counter() - told.began,
        overlays=tables.overlays(e, null, best),
        notes=(outcome.early_end(ended), *notes.of_method(told.trials, told.usable, search)),
        given=told.given,
        stopped=replace(Stopped.by(ended, 0.0), tried=len(search.looked_at & pool), effects=len(pool)),
    )


def _splits(evidence: Evidence) -> dict[str, tuple[str, ...]]:
    """Names of the blocks by what they are for."""
    names = evidence.blocks.names
    return {part: tuple(names[b] for b in getattr(evidence.blocks, part)) for part in ("train", "validation", "test")}


def check_given(trials: Sequence[Trial], given: Sequence[Entry]) -> None:
    """Refuse what is said of the log of efforts itself: along a motion it is the log that has to be put right.

    Raises:
        RecordingError: one line.
    """
    for entry in given:
        if entry.name in ON_THE_EFFORT:
            raise RecordingError(
                f"{trials[0].source}: {entry.name} cannot be given where efforts are explained along a motion: put "
                "the log right (--map with scale, or the time of its rows), and take it out of --effects"
            )


def _named(
    evidence: Evidence,
    scored: Scored,
    index: int,
    spans: dict[int, tuple[float, float]],
    forms: dict[int, dict[str, tuple[float, float] | None]],
) -> Named:
    """One term as an effect with parameters."""
    term, strength = evidence.terms[index], scored.strengths[index]
    low, high = _with_gain(term, strength, *spans.get(index, (None, None)))
    parameters = {
        term.parameter: Value(
            term.identity + strength,
            None if low is None else term.identity + min(low, strength),
            None if high is None else term.identity + max(high, strength),
            term.unit,
        )
    }
    for name, value in term.shape:
        ends = forms.get(index, {}).get(name)
        shortest, longest = (min(ends[0], value), max(ends[1], value)) if ends else (None, None)
        parameters[name] = Value(value, shortest, longest, dict(term.shape_units)[name])
    return Named(term.effect, term.target, parameters)


def _with_gain(term: Term, strength: float, low: float | None, high: float | None) -> tuple[float | None, float | None]:
    """An interval of a strength that counts how well the motors' constants are known, where it is told by torques: no
    recording of efforts tells that."""
    if low is None or high is None or term.unit not in OF_TORQUE:
        return low, high
    reach = NINETY * OWN["torque_constant"] * abs(strength)
    return strength - float(np.hypot(strength - low, reach)), strength + float(np.hypot(high - strength, reach))


def _not_excited(evidence: Evidence) -> tuple[str, ...]:
    """Effects that, at the size of their default, would change no channel by as much as its noise."""
    seen = set()
    cols = evidence.course.columns
    used = evidence.moving
    for term, unit in zip(evidence.terms, evidence.units, strict=True):
        change = abs(term.magnitude) * unit[:, cols]
        for c in range(len(cols)):
            if used[:, c].any() and float((change[used[:, c], c] ** 2).mean()) > evidence.floor.noise[c] ** 2:
                seen.add(term.effect)
    return tuple(name for name in EFFECTS if name not in seen)


def _stage(search: Search, verdict: Verdict) -> str | None:
    """Stage of the effect without which the best explanation would lose most."""
    losses: dict[str, float] = {}
    for name in search.names(verdict.best):
        rest = search.score(k for k in verdict.best.terms if search.evidence.terms[k].effect != name)
        losses[EFFECTS[name].stage] = losses.get(EFFECTS[name].stage, 0.0) + rest.bic - verdict.best.bic
    return max(losses, key=lambda stage: losses[stage], default=None)
